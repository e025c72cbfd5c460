//! The matrix of a Newton step: `H_elastic + M / h^2 + sum over stencils of w w^T (x) B`.

use super::contact::operator::Stencils;
use super::contact::stencil::Stencil;
use super::elastic::Elastic;
use super::factored::Factored;
use crate::device::{Buffer, Device, DeviceError};
use crate::model::Vec3;
use crate::solve::bsr::{BlockDiagonal, Bsr};
use crate::solve::cg::{Cg, CgInfo, CgParams, Operator};

/// Work space for the systems of one garment.
pub struct System {
    cg: Cg,
    mass: Buffer<f32>,
    diagonal_slots: Buffer<u32>,
    inverse: BlockDiagonal,
    right: Buffer<f32>,
    solution: Buffer<f32>,
    masses: Vec<f64>,
    factored: Factored,
    /// Inertia (1/h^2) up to which a factor is cheaper than block-Jacobi, as seen so far [1/s^2].
    factor_below: f64,
    nodes: usize,
}

/// Iterations of block-Jacobi that cost as much as a factor, over the square root of the number
/// of nodes (a factor's operations grow with the nodes to the power of 1.5).
const FACTOR_COST: f64 = 3.0;

struct Matrix<'a> {
    elastic: &'a Bsr,
    stencils: &'a Stencils,
    mass: &'a Buffer<f32>,
    inertia: f64,
}

impl Operator for Matrix<'_> {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        self.elastic.apply(device, x, y)?;
        self.stencils.add_product(device, self.inertia, self.mass, x, y)
    }
}

impl System {
    /// For nodes of these masses [kg].
    ///
    /// # Errors
    /// A device's failure.
    pub fn new(device: &Device, masses: &[f64], diagonal_slots: &[u32]) -> Result<System, DeviceError> {
        let nodes = masses.len();
        let mass: Vec<f32> = masses.iter().map(|&m| m as f32).collect();
        Ok(System {
            cg: Cg::new(device, 3 * nodes)?,
            mass: device.upload("node masses", &mass)?,
            diagonal_slots: device.upload("diagonal slots", diagonal_slots)?,
            inverse: BlockDiagonal { blocks: device.zeros("inverse diagonal", nodes)? },
            right: device.zeros("right-hand side", 3 * nodes)?,
            solution: device.zeros("newton direction", 3 * nodes)?,
            masses: masses.to_vec(),
            factored: Factored::default(),
            factor_below: 0.0,
            nodes,
        })
    }

    /// The Newton direction `-H^-1 gradient` [m] where nodes and vertices are and `elastic` is linearised;
    /// `inertia` is 1/h^2 [1/s^2], `moved` the displacements since the start of the step [m].
    ///
    /// # Errors
    /// A device's failure.
    #[allow(clippy::too_many_arguments)] // a linear system and how to solve it
    pub fn direction(
        &mut self,
        device: &Device,
        (elastic, nodes, vertices): (&Elastic, &[Vec3], &[Vec3]),
        list: &[Stencil],
        moved: &[Vec3],
        inertia: f64,
        gradient: &[Vec3],
        params: &CgParams,
    ) -> Result<(Vec<Vec3>, CgInfo), DeviceError> {
        let stencils = Stencils::new(device, self.nodes, list, moved)?;
        // A scale of order one keeps tiny forces away from f32's denormals.
        let scale = gradient.iter().map(Vec3::amax).fold(0.0, f64::max);
        if scale == 0.0 {
            return Ok((vec![Vec3::zeros(); self.nodes], CgInfo { converged: true, ..CgInfo::default() }));
        }
        let worth = (FACTOR_COST * (self.nodes as f64).sqrt()) as usize;
        let mut spent = 0;
        if inertia > self.factor_below {
            let short = CgParams { max_iterations: params.max_iterations.min(worth), ..*params };
            let found =
                self.jacobi(device, elastic.hessian(), &stencils, inertia, (gradient, scale), &short)?;
            if found.1.converged || params.max_iterations <= worth {
                return Ok(found);
            }
            spent = found.1.iterations;
            self.factor_below = inertia;
        }
        let second = stencils.second_derivatives(device)?;
        let weights: Vec<f64> = self.masses.iter().map(|m| m * inertia).collect();
        let found = self.factored.direction(
            device,
            (elastic, nodes, vertices),
            (list, &second),
            &weights,
            gradient,
            params,
        )?;
        let (direction, mut info) = match found {
            Some(found) => found,
            None => self.jacobi(device, elastic.hessian(), &stencils, inertia, (gradient, scale), params)?,
        };
        info.iterations += spent;
        Ok((direction, info))
    }

    /// The direction by conjugate gradients on the device; `scale` is the gradient's size.
    fn jacobi(
        &self,
        device: &Device,
        elastic: &Bsr,
        stencils: &Stencils,
        inertia: f64,
        (gradient, scale): (&[Vec3], f64),
        params: &CgParams,
    ) -> Result<(Vec<Vec3>, CgInfo), DeviceError> {
        let (mass, inverse) = (&self.mass, &self.inverse);
        stencils.invert_diagonal(device, inertia, mass, elastic, &self.diagonal_slots, inverse)?;
        let matrix = Matrix { elastic, stencils, mass, inertia };
        let right: Vec<f32> =
            gradient.iter().flat_map(|g| [g.x, g.y, g.z]).map(|g| (-g / scale) as f32).collect();
        device.write(&self.right, &right)?;
        device.write(&self.solution, &vec![0.0; right.len()])?;
        let info = self.cg.solve(device, &matrix, inverse, &self.right, &self.solution, params)?;
        let direction = device.read(&self.solution)?;
        let direction =
            direction.chunks(3).map(|d| Vec3::new(d[0].into(), d[1].into(), d[2].into()) * scale).collect();
        Ok((direction, info))
    }
}
