//! Geometric multigrid on the sparse grid, as a preconditioner for conjugate gradients.
//!
//! One V-cycle [Brandt 1977; Trottenberg et al. 2001]: a sweep of the [smoother](relax) on
//! each grid on the way down and one on the way up, and a dense solve on the coarsest. Each
//! coarser grid has cells twice the size and the Galerkin system ([`coarsen`]): cut cells,
//! the boundary's mass, cells without a volume term and the ragged edge of the band are on
//! it with what they are worth, and no coarse boundary condition has to be made up. The
//! sweep up undoes the order of the sweep down, so the cycle is symmetric positive definite.
//!
//! Rigid motions, which a vector smoother would leave for last, lie in the span of trilinear
//! interpolation, so the coarse grids see them exactly.

pub mod coarsen;
mod exchange;
mod relax;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, Matrix3};

use super::domain::Domain;
use super::stencil::{Extent, Stencil};
use super::terms::Terms;
use crate::device::{Buffer, Device, DeviceError, Kernel};
use crate::solve::cg::Operator;
use crate::solve::dense::Dense;
use coarsen::{coarser, galerkin, links};
use exchange::{PROLONG, RESTRICT};
use relax::{RELAX, START, Smoother, System};

/// All kernels of this module.
pub(super) const KERNELS: [&Kernel; 4] = [&RELAX, &START, &RESTRICT, &PROLONG];

/// Nodes of a grid that is solved at once: 3 x 125 unknowns cost less than one more grid.
const COARSEST: usize = 125;

/// A preconditioner for the system of a domain.
#[derive(Debug)]
pub struct Multigrid {
    levels: Vec<Level>,
    coarsest: Dense,
}

/// A grid with the way to the next coarser one.
#[derive(Debug)]
struct Level {
    /// `None` for the finest: the caller has it.
    matrix: Option<Stencil>,
    smoother: Smoother,
    nodes: usize,
    image: Buffer<f32>,
    children: Buffer<[u32; 27]>,
    parents: Buffer<[u32; 8]>,
    /// The next grid's right-hand side and solution.
    coarse_b: Buffer<f32>,
    coarse_x: Buffer<f32>,
}

impl Multigrid {
    /// For the system of `terms` with `fixed` nodes (if any) held.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(
        device: &Device,
        domain: &Domain,
        terms: &Terms,
        fixed: &[bool],
    ) -> Result<Multigrid, DeviceError> {
        let mut levels = Vec::new();
        let mut below: Option<(Domain, Terms)> = None;
        loop {
            let (fine, terms) = below.as_ref().map_or((domain, terms), |(d, t)| (d, t));
            let fixed = if levels.is_empty() { fixed } else { &[] };
            if fine.nodes.len() <= COARSEST {
                let coarsest = Dense::new(device, &inverse(fine, terms, fixed))?;
                return Ok(Multigrid { levels, coarsest });
            }
            let coarse = coarser(fine);
            let links = links(fine, fixed, &coarse);
            let (nodes, above) = (fine.nodes.len(), coarse.nodes.len());
            let matrix = match levels.is_empty() {
                true => None,
                false => Some(Stencil::new(device, fine, terms, &[])?),
            };
            levels.push(Level {
                matrix,
                smoother: Smoother::new(device, fine)?,
                nodes,
                image: device.zeros("transfer image", 3 * nodes)?,
                children: device.upload("transfer children", &links.children)?,
                parents: device.upload("transfer parents", &links.parents)?,
                coarse_b: device.zeros("transfer coarse load", 3 * above)?,
                coarse_x: device.zeros("transfer coarse displacement", 3 * above)?,
            });
            let terms = galerkin(fine, terms, fixed, &coarse);
            below = Some((coarse, terms));
        }
    }

    /// Nodes of each grid, the finest first.
    pub fn nodes(&self) -> Vec<usize> {
        let levels = self.levels.iter().map(|level| level.nodes);
        levels.chain([self.coarsest.size() / 3]).collect()
    }

    /// Memory on the device, without the finest grid's matrix [bytes].
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum::<usize>() + 4 * self.coarsest.size().pow(2)
    }

    /// The preconditioner over the finest grid's matrix.
    pub fn over<'a>(&'a self, finest: &'a Stencil) -> Cycle<'a> {
        Cycle { multigrid: self, finest }
    }
}

impl Level {
    fn bytes(&self) -> usize {
        let vectors = self.image.len() + self.coarse_b.len() + self.coarse_x.len();
        let matrix = self.matrix.as_ref().map_or(0, Stencil::bytes);
        4 * (vectors + self.nodes + 27 * self.children.len() + 8 * self.nodes) + matrix
    }
}

/// One V-cycle, see [`Multigrid::over`].
#[derive(Clone, Copy, Debug)]
pub struct Cycle<'a> {
    multigrid: &'a Multigrid,
    finest: &'a Stencil,
}

impl Cycle<'_> {
    fn descend(
        &self,
        device: &Device,
        depth: usize,
        b: &Buffer<f32>,
        x: &Buffer<f32>,
    ) -> Result<(), DeviceError> {
        let Some(level) = self.multigrid.levels.get(depth) else {
            return self.multigrid.coarsest.apply(device, b, x);
        };
        let matrix = level.matrix.as_ref().unwrap_or(self.finest);
        let extent = |n: usize| Extent { n: n as u32, coefficient: 0.0, second: 0.0, pad: 0 };
        let coarse = level.children.len();
        let system = System { matrix, b, x };
        level.smoother.start(device, system)?;
        matrix.apply(device, x, &level.image)?;
        device.run(
            &RESTRICT,
            coarse,
            &extent(coarse),
            &[&level.children, b, &level.image, &level.coarse_b],
        )?;
        self.descend(device, depth + 1, &level.coarse_b, &level.coarse_x)?;
        device.run(&PROLONG, level.nodes, &extent(level.nodes), &[&level.parents, &level.coarse_x, x])?;
        level.smoother.finish(device, system)
    }
}

impl Operator for Cycle<'_> {
    fn apply(&self, device: &Device, b: &Buffer<f32>, x: &Buffer<f32>) -> Result<(), DeviceError> {
        self.descend(device, 0, b, x)
    }
}

/// The inverse of the whole matrix; a node that nothing holds or moves stays where it is.
fn inverse(domain: &Domain, terms: &Terms, fixed: &[bool]) -> DMatrix<f64> {
    let n = 3 * domain.nodes.len();
    let mut matrix = DMatrix::<f64>::zeros(n, n);
    let mut add = |i: usize, j: usize, block: Matrix3<f64>| {
        let mut place = matrix.fixed_view_mut::<3, 3>(3 * i, 3 * j);
        place += block;
    };
    let free = |i: u32| fixed.get(i as usize) != Some(&true);
    for (nodes, &element) in domain.cell_nodes.iter().zip(&terms.element_of_cell) {
        let element = &terms.elements[element as usize];
        for (a, b) in (0..64).map(|k| (k / 8, k % 8)).filter(|&(a, b)| free(nodes[a]) && free(nodes[b])) {
            let block = element.fixed_view::<3, 3>(3 * a, 3 * b).into_owned();
            add(nodes[a] as usize, nodes[b] as usize, block);
        }
    }
    for (cell, mass) in &terms.masses {
        let nodes = domain.cell_nodes[*cell as usize];
        for (a, b) in (0..64).map(|k| (k / 8, k % 8)).filter(|&(a, b)| free(nodes[a]) && free(nodes[b])) {
            add(nodes[a] as usize, nodes[b] as usize, Matrix3::identity() * mass[a][b]);
        }
    }
    let scale = matrix.diagonal().max();
    for i in 0..n {
        // Without a boundary the rigid motions are free: they are held by next to nothing.
        let least = if matrix[(i, i)] == 0.0 { 1.0 } else { 1e-7 * scale };
        matrix[(i, i)] += least;
    }
    matrix.cholesky().map_or_else(|| DMatrix::identity(n, n), |c| c.inverse())
}
