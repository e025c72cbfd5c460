//! The inner loop: Picard's fixed point on one domain, with Anderson's acceleration.
//!
//! The matrix `S` is constant (paper section 4.1: the linearised form is used in every
//! iteration, with a bias for the nonlinear part); each iteration solves
//!
//! ```text
//! S du = f - S u + B^T q(u),        u += du
//! ```
//!
//! for the increment, so that `f32` on the device suffices. Where cells expand, `q` takes
//! back all of the volume term's stiffness, and the plain loop contracts by 3/4 at worst.
//! [`Anderson`]'s combination of the last iterates makes up for that, and for what a linear
//! solve leaves as well: so each increment is given a single conjugate gradient iteration
//! with a multigrid cycle ([`super::multigrid`]), and 5 to 8 of them do for all.
//!
//! A cycle comes within a third of the exact inverse, so the increment of the whole residual
//! tells how far the solution is: converged means that none moves a node further than the
//! tolerance. With [`Params::exact`] the residual itself decides, in `f64` ([`super::exact`]).

use serde::{Deserialize, Serialize};

use super::Params;
use super::anderson::Anderson;
use super::boundary::Boundary;
use super::domain::Domain;
use super::element;
use super::exact::{self, Exact};
use super::multigrid::Multigrid;
use super::stencil::{Extent, Stencil};
use super::terms::{Shares, Terms};
use super::volume::{PRESSURE, RESIDUAL};
use crate::device::{Buffer, Device, DeviceError};
use crate::model::Vec3;
use crate::solve::cg::{Cg, CgParams, Operator};

/// Iterations of a tight solve: each gains a factor of about 2.5.
const EXACT_ITERATIONS: usize = 100;

/// What the inner loop did.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct InnerInfo {
    /// Conjugate gradient iterations for each increment.
    pub cg_iterations: Vec<usize>,
    /// Farthest that a node moved in each iteration [m].
    pub changes_m: Vec<f64>,
    /// Residual before each iteration, relative to the first since the problem last changed, in
    /// the norm of the multigrid cycle; of an exact solve in the Euclidean norm, with the final one.
    pub residuals: Vec<f64>,
    /// Whether the last change is below the tolerance (of an exact solve: the residual is).
    pub converged: bool,
}

impl InnerInfo {
    /// Adds what was done after a change of what is asked for.
    pub(super) fn then(&mut self, more: InnerInfo) {
        self.cg_iterations.extend(more.cg_iterations);
        self.changes_m.extend(more.changes_m);
        self.residuals.extend(more.residuals);
        self.converged &= more.converged;
    }
}

/// A displacement field on a domain.
#[derive(Clone, Debug)]
pub struct Field {
    /// The active cells.
    pub domain: Domain,
    /// Displacement of each node [m].
    pub displacement: Vec<Vec3>,
}

impl Field {
    /// Displacement [m] and its gradient at `p`, if an active cell holds it.
    pub fn sample(&self, p: &Vec3) -> Option<(Vec3, nalgebra::Matrix3<f64>)> {
        let (cell, local) = self.domain.locate(p)?;
        let (shape, gradient) = (element::shape(local), element::shape_gradient(local));
        let mut value = Vec3::zeros();
        let mut slope = nalgebra::Matrix3::zeros();
        for (a, &node) in self.domain.cell_nodes[cell].iter().enumerate() {
            let u = self.displacement[node as usize];
            value += u * shape[a];
            slope += u * Vec3::from(gradient[a]).transpose() / self.domain.lattice.cell;
        }
        Some((value, slope))
    }
}

/// The discrete problem on one domain.
pub struct Problem<'a> {
    device: &'a Device,
    params: &'a Params,
    exact: Option<Exact<'a>>,
    domain: &'a Domain,
    boundary: Boundary,
    fixed: &'a [bool],
    stencil: Stencil,
    multigrid: Multigrid,
    cg: Cg,
    cell_nodes: Buffer<[u32; 8]>,
    node_cells: Buffer<[u32; 8]>,
    shares: Buffer<u32>,
    pressure: Buffer<f32>,
    load: Buffer<f32>,
    u: Buffer<f32>,
    image: Buffer<f32>,
    residual: Buffer<f32>,
    increment: Buffer<f32>,
    nodes: usize,
    cells: usize,
    cell: f64,
}

impl<'a> Problem<'a> {
    /// Sets up the system. `fixed` nodes (an empty list is none) keep the displacement that
    /// `start` gives them.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(
        device: &'a Device,
        params: &'a Params,
        domain: &'a Domain,
        boundary: Boundary,
        fixed: &'a [bool],
        start: &[Vec3],
    ) -> Result<Problem<'a>, DeviceError> {
        let terms = Terms::new(domain, params.nu, params.gamma, &boundary);
        let (nodes, cells) = (domain.nodes.len(), domain.cells.len());
        let is_fixed = |i: usize| fixed.get(i) == Some(&true);
        let node_cells: Vec<[u32; 8]> = (0..nodes)
            .map(|i| if is_fixed(i) { [super::domain::NONE; 8] } else { domain.node_cells[i] })
            .collect();
        let shares: Vec<u32> = Shares::new(domain, &boundary).volume.into_iter().map(u32::from).collect();
        Ok(Problem {
            device,
            params,
            domain,
            fixed,
            exact: params.exact.then(|| Exact::new(params, domain, &boundary, fixed)),
            stencil: Stencil::new(device, domain, &terms, fixed)?,
            multigrid: Multigrid::new(device, domain, &terms, fixed)?,
            cg: Cg::new(device, 3 * nodes)?.looking_every(1),
            cell_nodes: device.upload("transfer cell nodes", &domain.cell_nodes)?,
            node_cells: device.upload("transfer node cells", &node_cells)?,
            shares: device.upload("transfer shares", &shares)?,
            pressure: device.zeros("transfer pressure", cells)?,
            load: device.upload("transfer load", &flat(&loads(&boundary, fixed, start)))?,
            u: device.upload("transfer displacement", &flat(start))?,
            image: device.zeros("transfer image", 3 * nodes)?,
            residual: device.zeros("transfer residual", 3 * nodes)?,
            increment: device.zeros("transfer increment", 3 * nodes)?,
            nodes,
            cells,
            cell: domain.lattice.cell,
            boundary,
        })
    }

    /// Holds the fixed nodes at their displacement in `u` from now on.
    ///
    /// # Errors
    /// As [`Device::write`].
    pub fn hold(&self, u: &[Vec3]) -> Result<(), DeviceError> {
        self.device.write(&self.load, &flat(&loads(&self.boundary, self.fixed, u)))
    }

    /// Asks on the boundary for as much more as `u` misses, and solves again from there.
    ///
    /// # Errors
    /// A device's failure.
    pub fn solve_augmented(&mut self, u: &mut [Vec3]) -> Result<InnerInfo, DeviceError> {
        self.boundary.augment(self.domain, u);
        self.hold(u)?;
        self.solve(u)
    }

    /// Runs the fixed point from `u`, which it leaves at the solution.
    ///
    /// # Errors
    /// A device's failure.
    pub fn solve(&self, u: &mut [Vec3]) -> Result<InnerInfo, DeviceError> {
        if let Some(exact) = &self.exact {
            return self.solve_exactly(exact, u);
        }
        let mut info = InnerInfo::default();
        let mut acceleration = Anderson::default();
        let mut first = 0.0;
        let from_rest = u.iter().all(|u| *u == Vec3::zeros());
        for turn in 0..self.params.inner_iterations {
            // From rest the first turn is linear, as if the volume had not changed yet.
            let linear = turn == 0 && from_rest;
            self.find_residual(u, !linear)?;
            let (step, norm) = self.increment(&mut info)?;
            if turn == 0 {
                first = norm;
            }
            info.residuals.push(if first > 0.0 { norm / first } else { 0.0 });
            let change = step.iter().map(|d| d.norm()).fold(0.0, f64::max);
            info.changes_m.push(change);
            if !change.is_finite() {
                return Ok(info);
            }
            info.converged = change <= self.params.inner_tolerance;
            if linear {
                u.iter_mut().zip(&step).for_each(|(u, d)| *u += d);
            } else {
                acceleration.advance(u, step, norm);
            }
            if info.converged {
                break;
            }
        }
        Ok(info)
    }

    fn solve_exactly(&self, exact: &Exact<'_>, u: &mut [Vec3]) -> Result<InnerInfo, DeviceError> {
        let mut info = InnerInfo::default();
        let mut acceleration = Anderson::default();
        let mut first = 0.0;
        for turn in 0..=EXACT_ITERATIONS {
            let residual = exact.residual(&self.boundary, u);
            let norm = residual.iter().map(Vec3::norm_squared).sum::<f64>().sqrt();
            if turn == 0 {
                first = norm;
            }
            info.residuals.push(if first > 0.0 { norm / first } else { 0.0 });
            info.converged = norm <= exact::TOLERANCE * first;
            if info.converged || !norm.is_finite() || turn == EXACT_ITERATIONS {
                break;
            }
            self.device.write(&self.residual, &flat(&residual))?;
            let (step, _) = self.increment(&mut info)?;
            info.changes_m.push(step.iter().map(|d| d.norm()).fold(0.0, f64::max));
            acceleration.advance(u, step, norm);
        }
        Ok(info)
    }

    /// Leaves `f - S u + B^T q(u)` in `residual`, `q` being zero without `bias`.
    fn find_residual(&self, u: &[Vec3], bias: bool) -> Result<(), DeviceError> {
        let (device, p) = (self.device, self.params);
        let extent = |n: usize, coefficient: f64| Extent {
            n: n as u32,
            coefficient: coefficient as f32,
            second: self.cell as f32,
            pad: 0,
        };
        device.write(&self.u, &flat(u))?;
        self.stencil.apply(device, &self.u, &self.image)?;
        if bias {
            let cells = extent(self.cells, p.gamma);
            device.run(
                &PRESSURE,
                self.cells,
                &cells,
                &[&self.cell_nodes, &self.shares, &self.u, &self.pressure],
            )?;
        }
        let quarter_face = extent(self.nodes, 0.25 * self.cell * self.cell);
        let buffers: [&dyn crate::device::AnyBuffer; 5] =
            [&self.node_cells, &self.load, &self.image, &self.pressure, &self.residual];
        device.run(&RESIDUAL, self.nodes, &quarter_face, &buffers)
    }

    /// The increment for what stands in `residual`, and the residual's norm.
    fn increment(&self, info: &mut InnerInfo) -> Result<(Vec<Vec3>, f64), DeviceError> {
        let (device, p) = (self.device, self.params);
        let limits = CgParams { tolerance: p.cg_tolerance, max_iterations: p.cg_iterations };
        let cycle = self.multigrid.over(&self.stencil);
        let (residual, increment) = (&self.residual, &self.increment);
        let (cg, norm) =
            self.cg.solve_from_zero(device, &self.stencil, &cycle, residual, increment, &limits)?;
        info.cg_iterations.push(cg.iterations);
        let d = device.read(increment)?;
        let d = d.chunks_exact(3).map(|d| Vec3::new(d[0].into(), d[1].into(), d[2].into()));
        Ok((d.collect(), norm))
    }
}

/// The load on each node. A fixed node's row is the identity: with its displacement in `u` as load
/// its residual is zero.
fn loads(boundary: &Boundary, fixed: &[bool], u: &[Vec3]) -> Vec<Vec3> {
    let is_fixed = |i: usize| fixed.get(i) == Some(&true);
    let load = |i: usize| boundary.load.get(i).copied().unwrap_or_default();
    (0..u.len()).map(|i| if is_fixed(i) { u[i] } else { load(i) }).collect()
}

fn flat(u: &[Vec3]) -> Vec<f32> {
    u.iter().flat_map(|u| [u.x as f32, u.y as f32, u.z as f32]).collect()
}
