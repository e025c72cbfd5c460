//! The outer loop: flow, move the body along, start again from there.

use super::activity::{Active, narrow_band};
use super::align::Motion;
use super::boundary::Boundary;
use super::domain::{Domain, Lattice};
use super::field::{Field, InnerInfo, Problem};
use super::gap::Gap;
use super::prepared::{Course, Drift, Flow, Prepared, Skin, Step};
use super::{Error, Params, Stop};
use crate::device::Device;
use crate::geometry::{Surface, outer_skin, submesh};
use crate::model::{TriMesh, Vec3};

/// An outer iteration that leaves more than this share of the gap has stalled.
const STALLED: f64 = 0.9;

/// Where the lattice starts in each outer iteration, in cells along the diagonal: what one
/// lattice cannot represent the next one may (p99 gap of a heavy man 1.5 mm without, 1.1 with).
const SHIFTS: [f64; 4] = [0.0, 0.5, 0.25, 0.75];

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
        let (mut steps, mut inner, mut gaps) = (Vec::new(), Vec::new(), Vec::new());
        let mut last = self.gap(&self.drift.points).p99;
        // No look at the gap beforehand: a body that is already there passes through the
        // same solve as any other.
        while inner.len() < params.outer_iterations {
            let (step, info) = self.solve(device, params, inner.len() + 1)?;
            let mut next = self.drift.clone();
            step.advect(device, flow, &self.skin.triangles, &mut next)?;
            let gap = self.gap(&next.points).p99;
            inner.push(info);
            gaps.push(gap);
            let reached = gap <= params.gap_p99;
            let stalled = gap > STALLED * last;
            if reached || gap < last {
                self.drift = next;
                last = gap;
                steps.push(step);
            }
            if reached || stalled {
                let stop = if reached { Stop::Reached } else { Stop::Stalled };
                return Ok((steps, Course { inner, gaps, stop }));
            }
        }
        Ok((steps, Course { inner, gaps, stop: Stop::Limit }))
    }

    /// The flow of outer iteration `turn` (from 1), from where the body is now.
    fn solve(&self, device: &Device, params: &Params, turn: usize) -> Result<(Step, InnerInfo), Error> {
        let surface = Surface::new(self.skin.mesh(&self.drift.points));
        let (domain, active) = band(&surface, params, turn)?;
        let cut: Vec<u32> = (0..active.len() as u32).filter(|&i| active[i as usize].cut).collect();
        let targets = self.skin.of(self.target);
        let displacement: Vec<Vec3> =
            surface.mesh().points.iter().zip(&targets).map(|(p, q)| q - p).collect();
        let beta = if turn == 1 { params.beta } else { params.beta * params.stiffening };
        let boundary = Boundary::new(&domain, &surface, &displacement, &cut, beta, params.quadrature);
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let problem = Problem::new(device, params, &domain, &boundary, &[], &u)?;
        let info = problem.solve(&mut u)?;
        if !u.iter().all(|u| u.iter().all(|c| c.is_finite())) {
            return Err(Error::Diverged { outer: turn });
        }
        Ok((Step::new(Field { domain, displacement: u }, surface), info))
    }

    /// The gap of the outer skin with the body's points at `points`.
    fn gap(&self, points: &[Vec3]) -> Gap {
        Gap::measure(&self.skin.of(points), &self.skin.of(self.target), self.areas)
    }
}

/// The narrow band around `surface` in outer iteration `turn`.
fn band(surface: &Surface, params: &Params, turn: usize) -> Result<(Domain, Vec<Active>), Error> {
    let (lo, hi) = surface.mesh().bounds().ok_or(Error::Empty)?;
    let origin = lo.add_scalar(-params.cell * SHIFTS[turn % SHIFTS.len()]);
    let lattice = Lattice { origin, cell: params.cell };
    let margin = 2.0 * params.band;
    Domain::check_size((hi - lo).add_scalar(margin) / params.cell)?;
    let active = narrow_band(surface, lattice, params.band, &lo, &hi);
    let cells = active.iter().map(|a| (a.cell, a.kind)).collect();
    Ok((Domain::new(lattice, cells)?, active))
}
