//! The outer loop: flow, move the body along, start again from there.

use super::activity::{Active, narrow_band};
use super::align::Motion;
use super::boundary::Boundary;
use super::domain::{Domain, Kind, Lattice, NONE};
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
            let turn = Turn::new(params, inner.len());
            let (step, info) = self.solve(device, params, &turn)?;
            let mut next = self.drift.clone();
            step.advect(device, flow, &self.skin.triangles, &mut next)?;
            let gap = self.gap(&next.points).p99;
            inner.push(info);
            gaps.push(gap);
            let reached = gap <= params.gap_p99;
            // Finer cells may close what coarse ones could not.
            let stalled = gap > STALLED * last && inner.len() > params.coarse_iterations;
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

    /// The flow of an outer iteration, from where the body is now.
    fn solve(&self, device: &Device, params: &Params, turn: &Turn) -> Result<(Step, InnerInfo), Error> {
        let surface = Surface::new(self.skin.mesh(&self.drift.points));
        let (domain, active) = turn.band(&surface)?;
        let targets = self.skin.of(self.target);
        let displacement: Vec<Vec3> =
            surface.mesh().points.iter().zip(&targets).map(|(p, q)| q - p).collect();
        let boundary = Boundary::new(&domain, &surface, &displacement, &active, turn.beta, params.quadrature);
        let fixed = if turn.closing { rim(&domain, &active) } else { Vec::new() };
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let info = Problem::new(device, params, &domain, &boundary, &fixed, &u)?.solve(&mut u)?;
        if !u.iter().all(|u| u.iter().all(|c| c.is_finite())) {
            return Err(Error::Diverged { outer: turn.number });
        }
        Ok((Step::new(Field { domain, displacement: u }, surface, turn.closing), info))
    }

    /// The gap of the outer skin with the body's points at `points`.
    fn gap(&self, points: &[Vec3]) -> Gap {
        Gap::measure(&self.skin.of(points), &self.skin.of(self.target), self.areas)
    }
}

/// What one outer iteration is solved with.
struct Turn {
    /// From 1.
    number: usize,
    closing: bool,
    cell: f64,
    band: f64,
    beta: f64,
}

impl Turn {
    /// After `done` iterations. A closing one keeps `beta h^2 / nu`.
    fn new(params: &Params, done: usize) -> Turn {
        let closing = done >= params.coarse_iterations;
        let refinement = if closing { params.refinement } else { 1.0 };
        let stiffening = if done == 0 { 1.0 } else { params.stiffening };
        Turn {
            number: done + 1,
            closing,
            cell: params.cell / refinement,
            band: if closing { params.closing_band } else { params.band },
            beta: params.beta * stiffening * refinement * refinement,
        }
    }

    /// The narrow band around `surface`.
    fn band(&self, surface: &Surface) -> Result<(Domain, Vec<Active>), Error> {
        let (lo, hi) = surface.mesh().bounds().ok_or(Error::Empty)?;
        let origin = lo.add_scalar(-self.cell * SHIFTS[self.number % SHIFTS.len()]);
        let lattice = Lattice { origin, cell: self.cell };
        Domain::check_size((hi - lo).add_scalar(2.0 * self.band) / self.cell)?;
        let active = narrow_band(surface, lattice, self.band, &lo, &hi);
        let cells = active.iter().map(|a| (a.cell, a.kind)).collect();
        Ok((Domain::new(lattice, cells)?, active))
    }
}

/// Nodes at the outer edge of a band: next to a missing cell, and to none near the surface.
fn rim(domain: &Domain, active: &[Active]) -> Vec<bool> {
    let far =
        |cell: u32| cell == NONE || (domain.kinds[cell as usize] == Kind::Open && !active[cell as usize].cut);
    let rim = |cells: &[u32; 8]| cells.contains(&NONE) && cells.iter().all(|&cell| far(cell));
    domain.node_cells.iter().map(rim).collect()
}
