//! The outer loop: flow, move the body along, start again from there.

use super::align::Motion;
use super::closing::Closing;
use super::domain::Domain;
use super::field::InnerInfo;
use super::gap::Gap;
use super::prepared::{Course, Drift, Flow, Prepared, Skin, Step};
use super::turn::Turn;
use super::{Error, Params, Stop};
use crate::device::Device;
use crate::geometry::{Split, Surface, outer_skin, submesh};
use crate::model::{TriMesh, Vec3};

/// Longest edge of the skin that is followed [m]; longer ones are split. The flow rounds off what bends
/// at the body's vertices: what they alone miss is several times what the skin between them does, and
/// to close that would push the skin past its target.
const EDGE: f64 = 0.01;

/// A closing iteration that leaves more than this share of the gap has stalled: what is left lies in
/// creases.
const STALLED: f64 = 0.9;

/// Closing divides the gap of a flow by less than this. On the band's cells it is tried where that
/// would reach what is asked for; otherwise refinement comes at once.
const GAIN: f64 = 5.0;

/// Where a gap of less than this share of a cell is asked for, the flow is refined in any case: closing
/// moves the skin and not the space around.
const COARSE: f64 = 0.05;

/// What an outer iteration does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    /// Solves the flow in the whole band.
    Band,
    /// Closes what is left near the skin, to be taken back if that is not enough.
    TryClosing,
    /// Solves the last flow of the whole band once more, with finer cells near the skin.
    Refine,
    /// Closes what is left near the skin.
    Close,
}

/// The body on its way to the target: its points, then the middles of its skin's edges.
struct Body<'a> {
    source_points: usize,
    skin: &'a Skin,
    split: &'a Split,
    /// Where the skin's points and middles go to [m].
    target: &'a [Vec3],
    /// Area of each on the source [m^2].
    areas: &'a [f64],
    drift: Drift,
}

/// What was done so far.
#[derive(Default)]
struct Done {
    steps: Vec<Step>,
    closings: Vec<Closing>,
    inner: Vec<InnerInfo>,
    gaps: Vec<f64>,
}

/// Solves the flow from `source` to `target`, outer iteration by outer iteration; its course
/// and its end depend on the body pair alone. The input has been checked.
pub(super) fn prepare(
    device: &Device,
    source: &TriMesh,
    target: &[Vec3],
    params: &Params,
) -> Result<Prepared, Error> {
    let (lo, hi) = source.bounds().ok_or(Error::Empty)?;
    Domain::check_size((hi - lo) / params.cell)?;
    let (skin_mesh, of_body) = submesh(source, &outer_skin(source));
    if skin_mesh.triangles.is_empty() {
        return Err(Error::Empty);
    }
    let areas = skin_mesh.point_areas();
    let skin = Skin { triangles: skin_mesh.triangles.clone(), of_body };
    let target_skin = skin.of(target);
    let motion = Motion::best(&skin_mesh.points, &target_skin, &areas);
    let split = Split::new(&skin_mesh.triangles, &[&skin_mesh.points, &target_skin], EDGE);
    let whole = TriMesh { points: split.points(&skin_mesh.points), triangles: split.triangles.clone() };
    let points = [&source.points[..], &whole.points[skin_mesh.points.len()..]].concat();
    let mut body = Body {
        source_points: source.points.len(),
        skin: &skin,
        split: &split,
        target: &split.points(&target_skin),
        areas: &whole.point_areas(),
        drift: Drift::new(&points, &motion),
    };
    let (steps, closings) = (Vec::new(), Vec::new());
    let flow = Flow { params: params.clone(), motion, reach: (hi - lo).norm(), steps, closings };
    let (done, stop) = body.iterate(device, &flow)?;
    let mut moved = body.drift;
    moved.points.truncate(source.points.len());
    let body_gap = Gap::measure(&moved.points, target, &source.point_areas());
    Ok(Prepared {
        flow: Flow { steps: done.steps, closings: done.closings, ..flow },
        source_skin: skin_mesh.points,
        target_skin,
        skin,
        areas,
        course: Course { inner: done.inner, gaps: done.gaps, stop },
        body_gap,
        body_converged: moved.converged,
        body: moved.points,
        target_surface: std::sync::OnceLock::new(),
    })
}

impl Body<'_> {
    fn iterate(&mut self, device: &Device, flow: &Flow) -> Result<(Done, Stop), Error> {
        let params = &flow.params;
        let mut done = Done::default();
        let mut last = self.gap(&self.drift.points);
        let (mut before, mut work) = (self.drift.clone(), Work::Band);
        // No look at the gap beforehand: a body that is already there passes through the
        // same solve as any other.
        while done.gaps.len() < params.outer_iterations {
            if work == Work::Refine && done.steps.is_empty() {
                work = Work::Close; // the flow led away
            }
            let coarse = match work {
                Work::Refine => {
                    (self.drift, last) = (before.clone(), f64::INFINITY);
                    done.closings.clear();
                    done.steps.pop()
                }
                Work::Band => {
                    before = self.drift.clone();
                    None
                }
                Work::TryClosing | Work::Close => None,
            };
            let (part, next) = self.advance(device, flow, work, coarse, &mut done)?;
            let gap = self.gap(&next.points);
            done.gaps.push(gap);
            // A small gap is asked for in the mean as well, and a closing costs next to nothing.
            let rough = must_refine(params) && matches!(work, Work::Band | Work::Refine);
            let reached = gap <= params.gap_p99 && !rough;
            let stalled = gap > STALLED * last && work == Work::Close;
            if reached || gap < last {
                (self.drift, last) = (next, gap);
                match part {
                    Part::Flow(step) => done.steps.push(*step),
                    Part::Closing(closing) => done.closings.push(closing),
                }
            }
            if reached || stalled {
                return Ok((done, if reached { Stop::Reached } else { Stop::Stalled }));
            }
            work = next_work(params, work, done.gaps.len(), gap);
        }
        Ok((done, Stop::Limit))
    }

    /// Does `work`, which for a refinement is that of the `coarse` step: what it adds, and where it
    /// takes the body.
    fn advance(
        &self,
        device: &Device,
        flow: &Flow,
        work: Work,
        coarse: Option<Step>,
        done: &mut Done,
    ) -> Result<(Part, Drift), Error> {
        let mut next = self.drift.clone();
        if matches!(work, Work::TryClosing | Work::Close) {
            let closing = self.closing();
            next.close(&closing);
            return Ok((Part::Closing(closing), next));
        }
        let turn = Turn { device, params: &flow.params, number: done.gaps.len() + 1 };
        let (step, info) = self.solve(&turn, coarse)?;
        step.advect(device, flow, &self.skin.triangles, &mut next)?;
        done.inner.push(info);
        Ok((Part::Flow(Box::new(step)), next))
    }

    /// The flow of an outer iteration from where the body is now, or `refined` with finer cells.
    fn solve(&self, turn: &Turn<'_>, refined: Option<Step>) -> Result<(Step, InnerInfo), Error> {
        let displacement = |surface: &Surface| -> Vec<Vec3> {
            surface.mesh().points.iter().zip(self.target).map(|(p, q)| q - p).collect()
        };
        if let Some(mut step) = refined {
            let surface = step.surface.get().expect("solved just now");
            let (fine, info) = turn.refine(surface, &displacement(surface), &mut step.field)?;
            step.fine = Some(fine);
            return Ok((step, info));
        }
        let surface = Surface::new(self.skin.mesh(&self.drift.points));
        let (field, info) = turn.solve(&surface, &displacement(&surface))?;
        Ok((Step::new(field, surface), info))
    }

    /// What closes the gap of the skin where it is now.
    fn closing(&self) -> Closing {
        let points = self.whole_skin(&self.drift.points);
        let missing = self.target.iter().zip(&points).map(|(q, p)| q - p).collect();
        let mesh = TriMesh { points, triangles: self.split.triangles.clone() };
        let areas = mesh.point_areas();
        Closing::new(mesh.points, missing, areas)
    }

    /// The skin's points and middles with the body's at `points`.
    fn whole_skin(&self, points: &[Vec3]) -> Vec<Vec3> {
        let mut skin = self.skin.of(points);
        skin.extend(&points[self.source_points..]);
        skin
    }

    /// The 99th percentile of the outer skin's gap with the body's points at `points` [m].
    fn gap(&self, points: &[Vec3]) -> f64 {
        Gap::measure(&self.whole_skin(points), self.target, self.areas).p99
    }
}

/// What an outer iteration adds.
enum Part {
    Flow(Box<Step>),
    Closing(Closing),
}

/// Whether the gap asked for is too small for the band's cells.
fn must_refine(params: &Params) -> bool {
    params.refinement > 1 && params.gap_p99 < COARSE * params.cell
}

/// What comes after `done` outer iterations, the last of which did `work` and left `gap` [m].
fn next_work(params: &Params, work: Work, done: usize, gap: f64) -> Work {
    let may_close = !must_refine(params) && gap <= GAIN * params.gap_p99;
    match work {
        Work::Band if done < params.coarse_iterations => Work::Band,
        Work::Band if params.refinement > 1 && may_close => Work::TryClosing,
        Work::Band | Work::TryClosing if params.refinement > 1 => Work::Refine,
        _ => Work::Close,
    }
}
