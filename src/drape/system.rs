//! The matrix of a Newton step: `H_elastic + M / h^2 + sum over stencils of w w^T (x) B`.

use super::contact::operator::Stencils;
use super::contact::stencil::Stencil;
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
    nodes: usize,
}

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
            nodes,
        })
    }

    /// The Newton direction `-H^-1 gradient` [m]; `inertia` is 1/h^2 [1/s^2], `moved` the
    /// displacements since the start of the step [m].
    ///
    /// # Errors
    /// A device's failure.
    #[allow(clippy::too_many_arguments)] // a linear system and how to solve it
    pub fn direction(
        &self,
        device: &Device,
        elastic: &Bsr,
        list: &[Stencil],
        moved: &[Vec3],
        inertia: f64,
        gradient: &[Vec3],
        params: &CgParams,
    ) -> Result<(Vec<Vec3>, CgInfo), DeviceError> {
        let stencils = Stencils::new(device, self.nodes, list, moved)?;
        let (mass, inverse) = (&self.mass, &self.inverse);
        stencils.invert_diagonal(device, inertia, mass, elastic, &self.diagonal_slots, inverse)?;
        let matrix = Matrix { elastic, stencils: &stencils, mass, inertia };
        // A scale of order one keeps tiny forces away from f32's denormals.
        let scale = gradient.iter().map(Vec3::amax).fold(0.0, f64::max);
        if scale == 0.0 {
            return Ok((vec![Vec3::zeros(); self.nodes], CgInfo { converged: true, ..CgInfo::default() }));
        }
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
