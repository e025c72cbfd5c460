//! The outer loop: flow, move the body along, start again from there.

use super::align::Motion;
use super::field::InnerInfo;
use super::gap::Gap;
use super::prepared::{Course, Drift, Flow, Prepared, Skin, Step};
use super::turn::{Turn, Work};
use super::{Error, Params, Stop};
use crate::device::Device;
use crate::geometry::{Surface, outer_skin, submesh};
use crate::model::{TriMesh, Vec3};

/// A closing iteration that leaves more than this share of the gap has stalled: what is left lies in
/// creases, and further ones would take as long for ever less.
const STALLED: f64 = 0.75;

/// A closing step on the band's cells divides the gap of bodies by about this at best, so it is
/// tried where that would reach what is asked for; otherwise refinement comes at once.
const GAIN: f64 = 3.0;

/// The body on its way to the target.
struct Body<'a> {
    target: &'a [Vec3],
    skin: &'a Skin,
    areas: &'a [f64],
    drift: Drift,
}

/// Solves the flow from `source` to `target`, outer iteration by outer iteration; its course
/// and its end depend on the body pair alone. The input has been checked.
pub(super) fn prepare(
    device: &Device,
    source: &TriMesh,
    target: &[Vec3],
    params: &Params,
) -> Result<Prepared, Error> {
    let (skin_mesh, of_body) = submesh(source, &outer_skin(source));
    if skin_mesh.triangles.is_empty() {
        return Err(Error::Empty);
    }
    let areas = skin_mesh.point_areas();
    let skin = Skin { triangles: skin_mesh.triangles, of_body };
    let motion = Motion::best(&skin_mesh.points, &skin.of(target), &areas);
    let (lo, hi) = source.bounds().ok_or(Error::Empty)?;
    let flow = Flow { params: params.clone(), motion, reach: (hi - lo).norm(), steps: Vec::new() };
    let drift = Drift::new(&source.points, &flow.motion);
    let mut body = Body { target, skin: &skin, areas: &areas, drift };
    let (steps, course) = body.iterate(device, &flow)?;
    let body_gap = Gap::measure(&body.drift.points, target, &source.point_areas());
    let moved = body.drift;
    Ok(Prepared {
        flow: Flow { steps, ..flow },
        source_skin: skin_mesh.points,
        target_skin: skin.of(target),
        skin,
        areas,
        course,
        body_gap,
        body_converged: moved.converged,
        body: moved.points,
        target_surface: std::sync::OnceLock::new(),
    })
}

impl Body<'_> {
    fn iterate(&mut self, device: &Device, flow: &Flow) -> Result<(Vec<Step>, Course), Error> {
        let params = &flow.params;
        let (mut steps, mut inner, mut gaps) = (Vec::<Step>::new(), Vec::new(), Vec::new());
        let mut last = self.gap(&self.drift.points).p99;
        let (mut before, mut work) = (self.drift.clone(), Work::Band);
        // No look at the gap beforehand: a body that is already there passes through the
        // same solve as any other.
        while inner.len() < params.outer_iterations {
            let refined = if work == Work::Refine { band_step(&mut steps) } else { None };
            match work {
                Work::Refine if refined.is_none() => work = Work::Close, // the flow led away
                Work::Refine => (self.drift, last) = (before.clone(), f64::INFINITY),
                Work::Band => before = self.drift.clone(),
                Work::TryClosing | Work::Close => {}
            }
            let turn = Turn::new(device, params, inner.len() + 1, work, steps.is_empty());
            let (step, info) = self.solve(&turn, refined)?;
            let mut next = self.drift.clone();
            step.advect(device, flow, &self.skin.triangles, &mut next)?;
            let gap = self.gap(&next.points).p99;
            inner.push(info);
            gaps.push(gap);
            let reached = gap <= params.gap_p99;
            // Finer cells may close what coarse ones could not.
            let stalled = gap > STALLED * last && work == Work::Close;
            if reached || gap < last {
                self.drift = next;
                last = gap;
                steps.push(step);
            }
            if reached || stalled {
                let stop = if reached { Stop::Reached } else { Stop::Stalled };
                return Ok((steps, Course { inner, gaps, stop }));
            }
            work = next_work(params, work, inner.len(), gap);
        }
        Ok((steps, Course { inner, gaps, stop: Stop::Limit }))
    }

    /// The flow of an outer iteration from where the body is now, or `refined` with finer cells.
    fn solve(&self, turn: &Turn<'_>, refined: Option<Step>) -> Result<(Step, InnerInfo), Error> {
        let targets = self.skin.of(self.target);
        let displacement = |surface: &Surface| -> Vec<Vec3> {
            surface.mesh().points.iter().zip(&targets).map(|(p, q)| q - p).collect()
        };
        if let Some(mut step) = refined {
            let surface = step.surface.get().expect("solved just now");
            let (fine, info) = turn.refine(surface, &displacement(surface), &mut step.field)?;
            step.fine = Some(fine);
            return Ok((step, info));
        }
        let surface = Surface::new(self.skin.mesh(&self.drift.points));
        let (field, info) = turn.solve(&surface, &displacement(&surface))?;
        Ok((Step::new(field, surface, turn.work.closes()), info))
    }

    /// The gap of the outer skin with the body's points at `points`.
    fn gap(&self, points: &[Vec3]) -> Gap {
        Gap::measure(&self.skin.of(points), &self.skin.of(self.target), self.areas)
    }
}

/// What comes after `done` outer iterations, the last of which did `work` and left `gap` [m].
fn next_work(params: &Params, work: Work, done: usize, gap: f64) -> Work {
    match work {
        Work::Band if done < params.coarse_iterations => Work::Band,
        Work::Band if params.refinement > 1 && gap <= GAIN * params.gap_p99 => Work::TryClosing,
        Work::Band | Work::TryClosing if params.refinement > 1 => Work::Refine,
        _ => Work::Close,
    }
}

/// Takes the last step that was solved in the whole band, and those that closed after it, away.
fn band_step(steps: &mut Vec<Step>) -> Option<Step> {
    let band = steps.iter().rposition(|step| !step.closing)?;
    steps.drain(band..).next()
}
