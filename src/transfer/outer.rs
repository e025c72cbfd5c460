//! The outer loop: flow, move body and garments along, start again from there.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::activity::{Active, narrow_band};
use super::align::Motion;
use super::boundary::{Boundary, is_inside};
use super::domain::{Domain, Lattice};
use super::extension::extend;
use super::field::{Field, InnerInfo, Problem};
use super::gap::{Gap, near};
use super::{Error, Info, Input, Output, Params, Stop};
use crate::device::Device;
use crate::geometry::{Surface, outer_skin, submesh};
use crate::model::{TriMesh, Vec3};

/// An outer iteration that leaves more than this share of the gap has stalled.
const STALLED: f64 = 0.9;

/// Where the lattice starts in each outer iteration, in cells along the diagonal: what one
/// lattice cannot represent the next one may (p99 gap of a heavy man 1.5 mm without, 1.1 with).
const SHIFTS: [f64; 4] = [0.0, 0.5, 0.25, 0.75];

/// The body's outer skin.
struct Skin {
    triangles: Vec<[u32; 3]>,
    /// Index of each skin point in the body.
    of_body: Vec<u32>,
}

impl Skin {
    fn points(&self, body: &[Vec3]) -> Vec<Vec3> {
        self.of_body.iter().map(|&i| body[i as usize]).collect()
    }

    fn mesh(&self, body: &[Vec3]) -> TriMesh {
        TriMesh { points: self.points(body), triangles: self.triangles.clone() }
    }
}

/// Points that drift along, with the gradient of the composed map at each.
#[derive(Clone)]
struct Drift {
    name: String,
    points: Vec<Vec3>,
    gradient: Vec<Matrix3<f64>>,
    /// Cells of the last extension.
    extra_cells: usize,
    cg_iterations: usize,
    converged: bool,
}

impl Drift {
    fn new(name: String, points: &[Vec3], motion: &Motion) -> Drift {
        Drift {
            name,
            points: points.iter().map(|p| motion.apply(p)).collect(),
            gradient: vec![motion.linear; points.len()],
            extra_cells: 0,
            cg_iterations: 0,
            converged: true,
        }
    }

    /// Moves along with `field` and its extension to these points.
    fn advect(&mut self, flow: &Flow<'_>, field: &Field, surface: &Surface) -> Result<(), Error> {
        let extension = extend(flow.device, flow.params, field, surface, &self.points, flow.reach)
            .map_err(|e| e.within(&self.name))?;
        if let Some((extra, info)) = &extension {
            self.extra_cells = extra.domain.cells.len();
            self.cg_iterations += info.cg_iterations.iter().sum::<usize>();
            self.converged &= info.converged;
        } else {
            self.extra_cells = 0;
        }
        for (p, gradient) in self.points.iter_mut().zip(&mut self.gradient) {
            let beyond = || extension.as_ref().and_then(|(extra, _)| extra.sample(p));
            let (u, slope) = field.sample(p).or_else(beyond).expect("every point has an active cell");
            *p += u;
            *gradient = (Matrix3::identity() + slope) * *gradient;
        }
        Ok(())
    }

    fn determinant_min(&self) -> f64 {
        self.gradient.iter().map(Matrix3::determinant).fold(f64::INFINITY, f64::min)
    }
}

/// What stays the same in all outer iterations.
struct Flow<'a> {
    device: &'a Device,
    params: &'a Params,
    skin: Skin,
    target: Vec<Vec3>,
    reach: f64,
}

/// What the outer loop did.
struct Course {
    inner: Vec<InnerInfo>,
    gaps: Vec<f64>,
    stop: Stop,
}

/// What moves.
#[derive(Clone)]
struct State {
    body: Drift,
    garments: Vec<Drift>,
    gap: Gap,
    active_cells: usize,
}

pub(super) fn run(device: &Device, input: &Input<'_>, params: &Params) -> Result<Output, Error> {
    let (skin_mesh, of_body) = submesh(input.source, &outer_skin(input.source));
    if skin_mesh.triangles.is_empty() {
        return Err(Error::Empty);
    }
    let areas = skin_mesh.point_areas();
    let skin = Skin { triangles: skin_mesh.triangles, of_body };
    let motion = Motion::best(&skin_mesh.points, &skin.points(&input.target.points), &areas);
    let (lo, hi) = input.source.bounds().ok_or(Error::Empty)?;
    let flow = Flow { device, params, skin, target: input.target.points.clone(), reach: (hi - lo).norm() };
    let mut state = State {
        body: Drift::new("body".to_owned(), &input.source.points, &motion),
        garments: input
            .garments
            .iter()
            .enumerate()
            .map(|(g, points)| Drift::new(format!("garment {g}"), points, &motion))
            .collect(),
        gap: Gap::default(),
        active_cells: 0,
    };
    state.gap = flow.skin_gap(&state, &areas);
    let course = flow.iterate(&mut state, &areas)?;
    let garments = input.garments.concat();
    let mut weights = areas.clone();
    if !garments.is_empty() {
        let close = near(&skin_mesh.points, &garments, params.near);
        weights.iter_mut().zip(close).filter(|(_, close)| !close).for_each(|(w, _)| *w = 0.0);
    }
    Ok(flow.report(input, state, course, &areas, &weights))
}

impl Flow<'_> {
    /// The outer loop. Its end depends on the body pair alone.
    fn iterate(&self, state: &mut State, areas: &[f64]) -> Result<Course, Error> {
        let (mut inner, mut gaps) = (Vec::new(), Vec::new());
        // No look at the gap beforehand: a body that is already there passes through the
        // same solve as any other.
        while inner.len() < self.params.outer_iterations {
            let mut next = state.clone();
            let info = self.outer(&mut next, inner.len() + 1)?;
            next.gap = self.skin_gap(&next, areas);
            inner.push(info);
            gaps.push(next.gap.p99);
            if next.gap.p99 <= self.params.gap_p99 {
                *state = next;
                return Ok(Course { inner, gaps, stop: Stop::Reached });
            }
            let stalled = next.gap.p99 > STALLED * state.gap.p99;
            if next.gap.p99 < state.gap.p99 {
                *state = next;
            }
            if stalled {
                return Ok(Course { inner, gaps, stop: Stop::Stalled });
            }
        }
        Ok(Course { inner, gaps, stop: Stop::Limit })
    }

    fn outer(&self, state: &mut State, turn: usize) -> Result<InnerInfo, Error> {
        let surface = Surface::new(self.skin.mesh(&state.body.points));
        let (domain, active) = self.domain(&surface, turn)?;
        let cut: Vec<u32> = (0..active.len() as u32).filter(|&i| active[i as usize].cut).collect();
        let targets = self.skin.points(&self.target);
        let displacement: Vec<Vec3> =
            surface.mesh().points.iter().zip(&targets).map(|(p, q)| q - p).collect();
        let p = self.params;
        let beta = if turn == 1 { p.beta } else { p.beta * p.stiffening };
        let boundary = Boundary::new(&domain, &surface, &displacement, &cut, beta, p.quadrature);
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let problem = Problem::new(self.device, p, &domain, &boundary, &[], &u)?;
        let info = problem.solve(&mut u)?;
        if !u.iter().all(|u| u.iter().all(|c| c.is_finite())) {
            return Err(Error::Diverged { outer: turn });
        }
        state.active_cells = domain.cells.len();
        let field = Field { domain, displacement: u };
        state.body.advect(self, &field, &surface)?;
        for garment in &mut state.garments {
            garment.advect(self, &field, &surface)?;
        }
        Ok(info)
    }

    fn domain(&self, surface: &Surface, turn: usize) -> Result<(Domain, Vec<Active>), Error> {
        let (lo, hi) = surface.mesh().bounds().ok_or(Error::Empty)?;
        let lattice = Lattice {
            origin: lo.add_scalar(-self.params.cell * SHIFTS[turn % SHIFTS.len()]),
            cell: self.params.cell,
        };
        let margin = 2.0 * self.params.band;
        Domain::check_size((hi - lo).add_scalar(margin) / self.params.cell)?;
        let active = narrow_band(surface, lattice, self.params.band, &lo, &hi);
        let cells = active.iter().map(|a| (a.cell, a.kind)).collect();
        Ok((Domain::new(lattice, cells)?, active))
    }

    fn skin_gap(&self, state: &State, areas: &[f64]) -> Gap {
        Gap::measure(&self.skin.points(&state.body.points), &self.skin.points(&self.target), areas)
    }

    fn report(
        &self,
        input: &Input<'_>,
        state: State,
        course: Course,
        areas: &[f64],
        near_areas: &[f64],
    ) -> Output {
        let gap = self.skin_gap(&state, near_areas);
        let skin_gap = self.skin_gap(&state, areas);
        let body_areas = input.source.point_areas();
        let body_gap = Gap::measure(&state.body.points, &self.target, &body_areas);
        let target = Surface::new(self.skin.mesh(&self.target));
        let band_iterations: usize = course.inner.iter().flat_map(|i| &i.cg_iterations).sum();
        let solved = state.body.converged && course.inner.iter().all(|i| i.converged);
        let infos = state.garments.iter().map(|garment| Info {
            gap_max_m: gap.max,
            gap_p99_m: gap.p99,
            gap_mean_m: gap.mean,
            body_gap_p99_m: body_gap.p99,
            skin_gap_p99_m: skin_gap.p99,
            active_cells: state.active_cells + garment.extra_cells,
            outer_iterations: course.inner.len(),
            cg_iterations: band_iterations + garment.cg_iterations,
            converged: solved && garment.converged && gap.p99 <= self.params.gap_accepted,
            stop: course.stop,
            determinant_min: garment.determinant_min(),
            points_inside: garment.points.par_iter().filter(|p| is_inside(&target, p)).count(),
            skin_gaps_p99_m: course.gaps.clone(),
            inner: course.inner.clone(),
        });
        Output {
            infos: infos.collect(),
            garments: state.garments.iter().map(|g| g.points.clone()).collect(),
            body: state.body.points,
        }
    }
}
