//! Newton directions of long steps: conjugate gradients on the host with a Cholesky factor.
//!
//! In a long step hardly any inertia is left and block-Jacobi needs thousands of iterations. The
//! factor holds inertia, elasticity and all contact that couples nodes which elasticity couples
//! too: everything but pairs of the cloth with itself, of which it has the diagonal blocks. So
//! without self-contact one iteration is enough, and its sparsity is that of the cloth for good.
//!
//! The device's matrix leaves out what could make it indefinite. A factor tells whether it does, so
//! here the true second derivatives of the cloth are tried first and taken where they are positive
//! definite [Longva et al. 2023, Pitfalls of Projection]: buckled cloth has directions in which the
//! projected matrix is many times too stiff.

use super::contact::stencil::Stencil;
use super::elastic::Elastic;
use crate::device::{Device, DeviceError};
use crate::model::Vec3;
use crate::solve::block_cholesky::{Block, BlockFactor, BlockPattern, product};
use crate::solve::cg::{CgInfo, CgParams};

/// Times that the preconditioner's inertia is raised tenfold where rounding of the `f32` matrix
/// left it indefinite.
const MOST_SHIFTS: usize = 8;

/// Most solves in a row that do without the true second derivatives after they were indefinite.
const MOST_REST: u32 = 8;

/// Solver of one garment's systems.
#[derive(Debug, Default)]
pub struct Factored {
    /// Looked for once; `None` inside where there is none.
    structure: Option<Option<Structure>>,
    factor: BlockFactor,
    rest: Rest,
}

/// When the true second derivatives are tried again.
#[derive(Debug, Default)]
struct Rest {
    /// Solves to go.
    left: u32,
    /// How many they were last time.
    last: u32,
}

impl Rest {
    /// Whether they are to be tried now; counts a solve without them if not.
    fn is_due(&mut self) -> bool {
        let due = self.left == 0;
        self.left = self.left.saturating_sub(1);
        due
    }

    /// Says whether they were positive definite.
    fn count(&mut self, positive: bool) {
        self.last = if positive { 0 } else { (2 * self.last).clamp(1, MOST_REST) };
        self.left = self.last;
    }
}

/// What depends on the cloth's connectivity alone.
#[derive(Debug)]
struct Structure {
    pattern: BlockPattern,
    /// Place of each block of [`Elastic::soften`].
    softened: Vec<u32>,
}

impl Structure {
    fn new(device: &Device, elastic: &Elastic) -> Result<Option<Structure>, DeviceError> {
        let hessian = elastic.hessian();
        let (starts, columns) = (device.read(&hessian.row_start)?, device.read(&hessian.columns)?);
        let Ok(pattern) = BlockPattern::new(&starts, &columns) else { return Ok(None) };
        let place = |[row, column]: [u32; 2]| pattern.slot(row, column).map(|at| at as u32);
        let Some(softened) = elastic.softened().map(place).collect() else { return Ok(None) };
        Ok(Some(Structure { pattern, softened }))
    }
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
}

/// Factors the matrix, with as much additional inertia as it needs; whether that succeeded.
fn factor_shifted(matrix: &Matrix<'_>, inertia: &[f64], factor: &mut BlockFactor) -> bool {
    let mut blocks = matrix.blocks.clone();
    let mut more = 9.0;
    for _ in 0..MOST_SHIFTS {
        if matrix.pattern.factor(&blocks, factor).is_ok() {
            return true;
        }
        add_diagonal(matrix.pattern, &mut blocks, inertia, more);
        more *= 10.0;
    }
    false
}

fn add_diagonal(pattern: &BlockPattern, blocks: &mut [Block], values: &[f64], factor: f64) {
    for (node, value) in values.iter().enumerate() {
        let at = pattern.slot(node as u32, node as u32).expect("cloth couples a node to itself");
        [0, 4, 8].iter().for_each(|&k| blocks[at][k] += factor * value);
    }
}

impl Factored {
    /// The direction `-H^-1 gradient` [m] where the vertices are and `elastic` is linearised;
    /// `inertia` is each node's mass over h^2 [N/m], `second` the stencils' second derivatives, as
    /// upper triangles `xx yy zz yz xz xy`. `None` where the matrix cannot be factored.
    ///
    /// # Errors
    /// A device's failure.
    pub fn direction(
        &mut self,
        device: &Device,
        (elastic, vertices): (&Elastic, &[Vec3]),
        (list, second): (&[Stencil], &[[f32; 6]]),
        inertia: &[f64],
        gradient: &[Vec3],
        params: &CgParams,
    ) -> Result<Option<(Vec<Vec3>, CgInfo)>, DeviceError> {
        if self.structure.is_none() {
            self.structure = Some(Structure::new(device, elastic)?);
        }
        let Factored { structure: Some(Some(structure)), factor, rest } = self else { return Ok(None) };
        let blocks = device.read(&elastic.hessian().blocks)?.iter().map(|b| b.map(f64::from)).collect();
        let mut matrix = Matrix { pattern: &structure.pattern, blocks, outside: Vec::new() };
        add_diagonal(matrix.pattern, &mut matrix.blocks, inertia, 1.0);
        for (stencil, b) in list.iter().zip(second) {
            add_stencil(&mut matrix, stencil, &b.map(f64::from));
        }
        let softened = rest.is_due() && {
            let positive = soften(structure, &mut matrix, elastic, vertices, factor);
            rest.count(positive);
            positive
        };
        if !softened && !factor_shifted(&matrix, inertia, factor) {
            return Ok(None);
        }
        Ok(Some(solve(&matrix, factor, gradient, params)))
    }
}

/// Makes the cloth's part of the matrix the true second derivatives and factors it, if that is
/// positive definite; whether it is.
fn soften(
    structure: &Structure,
    matrix: &mut Matrix<'_>,
    elastic: &Elastic,
    vertices: &[Vec3],
    factor: &mut BlockFactor,
) -> bool {
    let mut blocks = matrix.blocks.clone();
    let mut places = structure.softened.iter();
    elastic.soften(vertices, &mut |block| {
        let at = *places.next().expect("a place for each block") as usize;
        (0..9).for_each(|k| blocks[at][k] += block[(k / 3, k % 3)]);
    });
    let positive = structure.pattern.factor(&blocks, factor).is_ok();
    if positive {
        matrix.blocks = blocks;
    }
    positive
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
    factor: &mut BlockFactor,
    gradient: &[Vec3],
    params: &CgParams,
) -> (Vec<Vec3>, CgInfo) {
    let mut x = vec![Vec3::zeros(); gradient.len()];
    let mut r: Vec<Vec3> = gradient.iter().map(|g| -g).collect();
    let mut z = matrix.pattern.solve(factor, &r);
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
        z = matrix.pattern.solve(factor, &r);
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
