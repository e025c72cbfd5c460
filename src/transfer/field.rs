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
//! back all of the volume term's stiffness, and the plain loop contracts by 3/4 at worst:
//! Anderson's combination of the last iterates [Walker and Ni 2011] halves the number of
//! iterations. Converged means: no node of the last increment moves further than the
//! tolerance, and every linear solve reached its own.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::Params;
use super::boundary::Boundary;
use super::domain::{Domain, Kind};
use super::element;
use super::stencil::{Elements, Extent, Stencil};
use super::volume::{PRESSURE, RESIDUAL};
use crate::device::{Buffer, Device, DeviceError};
use crate::model::Vec3;
use crate::solve::cg::{Cg, CgParams, Operator};

/// Iterates that Anderson's acceleration combines.
const DEPTH: usize = 5;

/// What the inner loop did.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct InnerInfo {
    /// Conjugate gradient iterations of each linear solve.
    pub cg_iterations: Vec<usize>,
    /// Farthest that a node moved in each iteration [m].
    pub changes_m: Vec<f64>,
    /// Relative residual of the last linear solve.
    pub cg_residual: f64,
    /// Whether the last change is below the tolerance and all linear solves converged.
    pub converged: bool,
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
    stencil: Stencil,
    cg: Cg,
    cell_nodes: Buffer<[u32; 8]>,
    node_cells: Buffer<[u32; 8]>,
    open: Buffer<u32>,
    pressure: Buffer<f32>,
    load: Buffer<f32>,
    u: Buffer<f32>,
    image: Buffer<f32>,
    residual: Buffer<f32>,
    increment: Buffer<f32>,
    nodes: usize,
    cells: usize,
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
        domain: &Domain,
        boundary: &Boundary,
        fixed: &[bool],
        start: &[Vec3],
    ) -> Result<Problem<'a>, DeviceError> {
        let elements = Elements::new(params.cell, params.nu, params.gamma);
        let (nodes, cells) = (domain.nodes.len(), domain.cells.len());
        let is_fixed = |i: usize| fixed.get(i) == Some(&true);
        // A fixed node's row is the identity: with its value as load its residual is zero.
        let load =
            |i: usize| if is_fixed(i) { start[i] } else { boundary.load.get(i).copied().unwrap_or_default() };
        let node_cells: Vec<[u32; 8]> = (0..nodes)
            .map(|i| if is_fixed(i) { [super::domain::NONE; 8] } else { domain.node_cells[i] })
            .collect();
        let open: Vec<u32> = domain.kinds.iter().map(|&kind| u32::from(kind == Kind::Open)).collect();
        Ok(Problem {
            device,
            params,
            stencil: Stencil::new(device, domain, &elements, boundary, fixed)?,
            cg: Cg::new(device, 3 * nodes)?,
            cell_nodes: device.upload("transfer cell nodes", &domain.cell_nodes)?,
            node_cells: device.upload("transfer node cells", &node_cells)?,
            open: device.upload("transfer open cells", &open)?,
            pressure: device.zeros("transfer pressure", cells)?,
            load: device.upload("transfer load", &flat(&(0..nodes).map(load).collect::<Vec<_>>()))?,
            u: device.upload("transfer displacement", &flat(start))?,
            image: device.zeros("transfer image", 3 * nodes)?,
            residual: device.zeros("transfer residual", 3 * nodes)?,
            increment: device.zeros("transfer increment", 3 * nodes)?,
            nodes,
            cells,
        })
    }

    /// Runs the fixed point from `u`, which it leaves at the solution.
    ///
    /// # Errors
    /// A device's failure.
    pub fn solve(&self, u: &mut [Vec3]) -> Result<InnerInfo, DeviceError> {
        let mut info = InnerInfo::default();
        let mut acceleration = Anderson::default();
        let mut solved = true;
        for turn in 0..self.params.inner_iterations {
            // The first turn is linear, as if the volume had not changed yet.
            let step = self.picard(u, turn > 0, &mut info, &mut solved)?;
            let change = step.iter().map(|d| d.norm()).fold(0.0, f64::max);
            info.changes_m.push(change);
            if !change.is_finite() {
                return Ok(info);
            }
            if change <= self.params.inner_tolerance {
                u.iter_mut().zip(&step).for_each(|(u, d)| *u += d);
                info.converged = solved;
                return Ok(info);
            }
            acceleration.advance(u, step, turn > 0);
        }
        Ok(info)
    }

    /// The increment of one iteration.
    fn picard(
        &self,
        u: &[Vec3],
        bias: bool,
        info: &mut InnerInfo,
        solved: &mut bool,
    ) -> Result<Vec<Vec3>, DeviceError> {
        let (device, p) = (self.device, self.params);
        let extent = |n: usize, coefficient: f64| Extent {
            n: n as u32,
            coefficient: coefficient as f32,
            second: p.cell as f32,
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
                &[&self.cell_nodes, &self.open, &self.u, &self.pressure],
            )?;
        }
        let quarter_face = extent(self.nodes, 0.25 * p.cell * p.cell);
        let buffers: [&dyn crate::device::AnyBuffer; 5] =
            [&self.node_cells, &self.load, &self.image, &self.pressure, &self.residual];
        device.run(&RESIDUAL, self.nodes, &quarter_face, &buffers)?;
        device.write(&self.increment, &vec![0.0; 3 * self.nodes])?;
        let limits = CgParams { tolerance: p.cg_tolerance, max_iterations: p.cg_iterations };
        let inverse = &self.stencil.diagonal_inverse;
        let cg = self.cg.solve(device, &self.stencil, inverse, &self.residual, &self.increment, &limits)?;
        info.cg_iterations.push(cg.iterations);
        info.cg_residual = cg.residual;
        *solved &= cg.converged;
        let d = device.read(&self.increment)?;
        Ok(d.chunks_exact(3).map(|d| Vec3::new(d[0].into(), d[1].into(), d[2].into())).collect())
    }
}

fn flat(u: &[Vec3]) -> Vec<f32> {
    u.iter().flat_map(|u| [u.x as f32, u.y as f32, u.z as f32]).collect()
}

/// Anderson's acceleration of a fixed point, type II.
#[derive(Default)]
struct Anderson {
    iterates: Vec<Vec<Vec3>>,
    steps: Vec<Vec<Vec3>>,
}

impl Anderson {
    /// Moves `u` on by `step`, corrected by what the last iterates teach; `remember` is
    /// false for a step that is not the fixed point's own.
    fn advance(&mut self, u: &mut [Vec3], step: Vec<Vec3>, remember: bool) {
        if !remember {
            u.iter_mut().zip(&step).for_each(|(u, d)| *u += d);
            return;
        }
        let weights = self.weights(&step);
        let last = u.to_vec();
        for i in 0..u.len() {
            let mut next = last[i] + step[i];
            for (k, w) in weights.iter().enumerate() {
                let (from, found) = (self.iterates[k][i], self.steps[k][i]);
                next -= ((last[i] + step[i]) - (from + found)) * *w;
            }
            u[i] = next;
        }
        if self.steps.len() == DEPTH {
            self.iterates.remove(0);
            self.steps.remove(0);
        }
        self.iterates.push(last);
        self.steps.push(step);
    }

    /// Weights that make `step - sum w (step - step_k)` smallest.
    fn weights(&self, step: &[Vec3]) -> Vec<f64> {
        let n = self.steps.len();
        let difference = |k: usize, i: usize| step[i] - self.steps[k][i];
        let mut normal = DMatrix::zeros(n, n);
        let mut right = DVector::zeros(n);
        for i in 0..step.len() {
            for k in 0..n {
                let d = difference(k, i);
                right[k] += d.dot(&step[i]);
                for l in k..n {
                    normal[(k, l)] += d.dot(&difference(l, i));
                }
            }
        }
        normal.fill_lower_triangle_with_upper_triangle();
        let scale = normal.diagonal().max();
        for k in 0..n {
            normal[(k, k)] += 1e-10 * scale;
        }
        normal.cholesky().map_or_else(|| vec![0.0; n], |c| c.solve(&right).as_slice().to_vec())
    }
}
