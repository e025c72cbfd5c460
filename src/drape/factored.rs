//! Newton directions of long steps: conjugate gradients on the host with a Cholesky factor.
//!
//! In a long step hardly any inertia is left and block-Jacobi needs thousands of iterations. The
//! factor holds inertia, elasticity and all contact that couples nodes which elasticity couples
//! too: everything but pairs of the cloth with itself, of which it has the diagonal blocks. So
//! without self-contact one iteration is enough, and its sparsity is that of the cloth for good.

use std::cell::OnceCell;

use super::contact::stencil::Stencil;
use crate::device::{Device, DeviceError};
use crate::model::Vec3;
use crate::solve::block_cholesky::{Block, BlockFactor, BlockPattern, product};
use crate::solve::bsr::Bsr;
use crate::solve::cg::{CgInfo, CgParams};

/// Times that the preconditioner's inertia is raised tenfold where rounding of the `f32` matrix
/// left it indefinite.
const MOST_SHIFTS: usize = 8;

/// Solver of one garment's systems.
#[derive(Debug, Default)]
pub struct Factored {
    pattern: OnceCell<Option<BlockPattern>>,
}

/// The matrix: blocks within the sparsity, mass and inertia included, and the couplings outside.
struct Matrix<'a> {
    pattern: &'a BlockPattern,
    blocks: Vec<Block>,
    outside: Vec<(u32, u32, Block)>,
}

impl Matrix<'_> {
    fn apply(&self, x: &[Vec3]) -> Vec<Vec3> {
        let mut y = vec![Vec3::zeros(); x.len()];
        self.pattern.add_product(&self.blocks, x, &mut y);
        for (row, column, block) in &self.outside {
            y[*row as usize] += product(block, &x[*column as usize]);
        }
        y
    }

    /// The factor, with as much additional inertia as it needs.
    fn factor(&self, inertia: &[f64]) -> Option<BlockFactor> {
        let mut blocks = self.blocks.clone();
        let mut factor = 1.0;
        for _ in 0..MOST_SHIFTS {
            if let Ok(done) = self.pattern.factor(&blocks) {
                return Some(done);
            }
            add_diagonal(self.pattern, &mut blocks, inertia, 9.0 * factor);
            factor *= 10.0;
        }
        None
    }
}

fn add_diagonal(pattern: &BlockPattern, blocks: &mut [Block], values: &[f64], factor: f64) {
    for (node, value) in values.iter().enumerate() {
        let at = pattern.slot(node as u32, node as u32).expect("cloth couples a node to itself");
        [0, 4, 8].iter().for_each(|&k| blocks[at][k] += factor * value);
    }
}

impl Factored {
    /// The direction `-H^-1 gradient` [m] for `inertia`, each node's mass over h^2 [N/m]; `second`
    /// are the stencils' second derivatives, as upper triangles `xx yy zz yz xz xy`. `None` where
    /// the matrix cannot be factored.
    ///
    /// # Errors
    /// A device's failure.
    pub fn direction(
        &self,
        device: &Device,
        elastic: &Bsr,
        (list, second): (&[Stencil], &[[f32; 6]]),
        inertia: &[f64],
        gradient: &[Vec3],
        params: &CgParams,
    ) -> Result<Option<(Vec<Vec3>, CgInfo)>, DeviceError> {
        if self.pattern.get().is_none() {
            let (starts, columns) = (device.read(&elastic.row_start)?, device.read(&elastic.columns)?);
            let _ = self.pattern.set(BlockPattern::new(&starts, &columns).ok());
        }
        let Some(Some(pattern)) = self.pattern.get() else { return Ok(None) };
        let blocks = device.read(&elastic.blocks)?.iter().map(|b| b.map(f64::from)).collect();
        let mut matrix = Matrix { pattern, blocks, outside: Vec::new() };
        add_diagonal(pattern, &mut matrix.blocks, inertia, 1.0);
        for (stencil, b) in list.iter().zip(second) {
            add_stencil(&mut matrix, stencil, &b.map(f64::from));
        }
        let Some(factor) = matrix.factor(inertia) else { return Ok(None) };
        Ok(Some(solve(&matrix, &factor, gradient, params)))
    }
}

fn add_stencil(matrix: &mut Matrix<'_>, stencil: &Stencil, b: &[f64; 6]) {
    if b.iter().all(|c| *c == 0.0) {
        return;
    }
    let full = [b[0], b[5], b[4], b[5], b[1], b[3], b[4], b[3], b[2]];
    let places = || (0..4).filter(|&k| stencil.weights[k] != 0.0);
    for i in places() {
        for j in places() {
            let part = full.map(|c| c * stencil.weights[i] * stencil.weights[j]);
            match matrix.pattern.slot(stencil.nodes[i], stencil.nodes[j]) {
                Some(at) => (0..9).for_each(|k| matrix.blocks[at][k] += part[k]),
                None => matrix.outside.push((stencil.nodes[i], stencil.nodes[j], part)),
            }
        }
    }
}

fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Preconditioned conjugate gradients for `-H x = gradient`, from zero.
fn solve(
    matrix: &Matrix<'_>,
    factor: &BlockFactor,
    gradient: &[Vec3],
    params: &CgParams,
) -> (Vec<Vec3>, CgInfo) {
    let mut x = vec![Vec3::zeros(); gradient.len()];
    let mut r: Vec<Vec3> = gradient.iter().map(|g| -g).collect();
    let mut z = factor.solve(&r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let scale = rz.max(0.0).sqrt();
    let mut info = CgInfo { iterations: 0, residual: 1.0, converged: scale == 0.0 };
    while !info.converged && info.iterations < params.max_iterations {
        let q = matrix.apply(&p);
        let curvature = dot(&p, &q);
        if curvature <= 0.0 || !curvature.is_finite() {
            break;
        }
        let alpha = rz / curvature;
        for i in 0..x.len() {
            x[i] += p[i] * alpha;
            r[i] -= q[i] * alpha;
        }
        z = factor.solve(&r);
        let next = dot(&r, &z);
        for i in 0..x.len() {
            p[i] = z[i] + p[i] * (next / rz);
        }
        rz = next;
        info.iterations += 1;
        info.residual = rz.max(0.0).sqrt() / scale;
        info.converged = info.residual <= params.tolerance;
    }
    (x, info)
}
