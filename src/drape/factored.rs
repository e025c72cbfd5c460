//! Newton directions of long steps: conjugate gradients on the host with a Cholesky factor.
//!
//! In a long step hardly any inertia is left and block-Jacobi needs thousands of iterations. The
//! factor holds inertia, elasticity and all contact that couples nodes which elasticity couples
//! too: everything but pairs of the cloth with itself, of which it has the diagonal blocks. So
//! without self-contact one iteration is enough, and its sparsity is that of the cloth for good.
//!
//! The device's matrix leaves out what could make it indefinite; [`super::curvature`] puts back what does
//! not.
//!
//! A factor's cost grows with the power 1.5 of the nodes. Garments of many have two levels of the
//! device's matrix as preconditioner ([`TwoLevel`]), and the true matrix for what is solved: where
//! that is found indefinite the solve ends with what it has, which is a direction of descent
//! [Steihaug 1983].

use super::contact::stencil::Stencil;
use super::curvature::Curvature;
use super::elastic::Elastic;
use crate::device::{Device, DeviceError};
use crate::model::Vec3;
use crate::solve::block_cholesky::{Block, BlockFactor, BlockPattern, product};
use crate::solve::cg::{CgInfo, CgParams};
use crate::solve::host_cg::solve;
use crate::solve::two_level::TwoLevel;

/// Times that the preconditioner's inertia is raised tenfold where rounding of the `f32` matrix
/// left it indefinite.
const MOST_SHIFTS: usize = 8;
/// Nodes from which on two levels precondition.
const MANY: usize = 4000;

/// Solver of one garment's systems.
#[derive(Debug, Default)]
pub struct Factored {
    /// Looked for once; `None` inside where there is none.
    structure: Option<Option<Structure>>,
    factor: BlockFactor,
}

/// What depends on the cloth's connectivity alone.
#[derive(Debug)]
struct Structure {
    pattern: BlockPattern,
    curvature: Curvature,
    /// For garments of many nodes.
    levels: Option<TwoLevel>,
}

impl Structure {
    fn new(device: &Device, elastic: &Elastic) -> Result<Option<Structure>, DeviceError> {
        let hessian = elastic.hessian();
        let (starts, columns) = (device.read(&hessian.row_start)?, device.read(&hessian.columns)?);
        let Ok(pattern) = BlockPattern::new(&starts, &columns) else { return Ok(None) };
        let Some(curvature) = Curvature::new(&pattern, elastic) else { return Ok(None) };
        let rows = pattern.rows();
        let levels = (rows >= MANY).then(|| TwoLevel::new(&pattern, &vec![false; rows]));
        Ok(Some(Structure { pattern, curvature, levels }))
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
        matrix.pattern.add_to_diagonal(&mut blocks, inertia, more);
        more *= 10.0;
    }
    false
}

impl Factored {
    /// The direction `-H^-1 gradient` [m] where the nodes and vertices are and `elastic` is
    /// linearised; `inertia` is each node's mass over h^2 [N/m], `second` the stencils' second
    /// derivatives, as upper triangles `xx yy zz yz xz xy`. `None` where the matrix cannot be factored.
    ///
    /// # Errors
    /// A device's failure.
    pub fn direction(
        &mut self,
        device: &Device,
        (elastic, nodes, vertices): (&Elastic, &[Vec3], &[Vec3]),
        (list, second): (&[Stencil], &[[f32; 6]]),
        inertia: &[f64],
        gradient: &[Vec3],
        params: &CgParams,
    ) -> Result<Option<(Vec<Vec3>, CgInfo)>, DeviceError> {
        if self.structure.is_none() {
            self.structure = Some(Structure::new(device, elastic)?);
        }
        let Factored { structure: Some(Some(structure)), factor } = self else { return Ok(None) };
        let blocks = device.read(&elastic.hessian().blocks)?.iter().map(|b| b.map(f64::from)).collect();
        let Structure { pattern, curvature, levels } = structure;
        let mut matrix = Matrix { pattern, blocks, outside: Vec::new() };
        pattern.add_to_diagonal(&mut matrix.blocks, inertia, 1.0);
        for (stencil, b) in list.iter().zip(second) {
            add_stencil(&mut matrix, stencil, &b.map(f64::from));
        }
        let right: Vec<Vec3> = gradient.iter().map(|g| -g).collect();
        if let Some(levels) = levels
            && levels.set(pattern, &matrix.blocks, nodes).is_ok()
        {
            curvature.put_back_all(&mut matrix.blocks, elastic, vertices);
            return Ok(Some(solve(&|x| matrix.apply(x), &mut |r| levels.apply(r), &right, params)));
        }
        let whole = curvature.put_back(pattern, &mut matrix.blocks, elastic, vertices, factor);
        if !whole && !factor_shifted(&matrix, inertia, factor) {
            return Ok(None);
        }
        Ok(Some(solve(&|x| matrix.apply(x), &mut |r| pattern.solve(factor, r), &right, params)))
    }
}

/// Adds a stencil. One whose nodes are not all coupled by the cloth has its two sides in the
/// sparsity and the couplings between them outside: with a part of those in it, what is factored
/// would be indefinite.
fn add_stencil(matrix: &mut Matrix<'_>, stencil: &Stencil, b: &[f64; 6]) {
    if b.iter().all(|c| *c == 0.0) {
        return;
    }
    let full = [b[0], b[5], b[4], b[5], b[1], b[3], b[4], b[3], b[2]];
    let places = || (0..4).filter(|&k| stencil.weights[k] != 0.0);
    let pairs = || places().flat_map(|i| places().map(move |j| (i, j)));
    let pattern = matrix.pattern;
    let slot = |(i, j): (usize, usize)| pattern.slot(stencil.nodes[i], stencil.nodes[j]);
    let one_sided = |(i, j): (usize, usize)| stencil.weights[i] * stencil.weights[j] > 0.0;
    let whole = pairs().all(|p| slot(p).is_some());
    let halves = pairs().filter(|p| one_sided(*p)).all(|p| slot(p).is_some());
    for (i, j) in pairs() {
        let part = full.map(|c| c * stencil.weights[i] * stencil.weights[j]);
        match slot((i, j)) {
            Some(at) if whole || i == j || (halves && one_sided((i, j))) => {
                (0..9).for_each(|k| matrix.blocks[at][k] += part[k]);
            }
            _ => matrix.outside.push((stencil.nodes[i], stencil.nodes[j], part)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::contact::stencil::Kind;

    #[test]
    fn a_stencil_that_the_cloth_couples_in_part_leaves_its_sides_to_the_factor() {
        // Nodes 0 1 2 3 in a row that the cloth couples to their neighbours; node 0 touches the
        // triangle 1 2 3, and one of its three couplings is in the sparsity.
        let columns: [&[u32]; 4] = [&[0, 1], &[0, 1, 2, 3], &[1, 2, 3], &[1, 2, 3]];
        let mut starts = vec![0];
        starts.extend(columns.iter().scan(0, |sum, c| {
            *sum += c.len() as u32;
            Some(*sum)
        }));
        let pattern = BlockPattern::new(&starts, &columns.concat()).unwrap();
        let blocks = vec![[0.0; 9]; columns.concat().len()];
        let mut matrix = Matrix { pattern: &pattern, blocks, outside: Vec::new() };
        pattern.add_to_diagonal(&mut matrix.blocks, &[1e-3; 4], 1.0);
        let weights = [1.0, -0.2, -0.5, -0.3];
        let stencil = Stencil {
            kind: Kind::Barrier,
            nodes: [0, 1, 2, 3],
            weights,
            normal: Vec3::x(),
            gap: 1e-3,
            radius: 2e-3,
            stiffness: 1.0,
        };
        add_stencil(&mut matrix, &stencil, &[100.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(pattern.factor(&matrix.blocks, &mut BlockFactor::default()).is_ok());
        // The product has all of it.
        let x: Vec<Vec3> = (0..4).map(|i| Vec3::new(f64::from(i * i) + 0.3, 1.0, 0.0)).collect();
        let gap: f64 = weights.iter().zip(&x).map(|(w, x)| w * x.x).sum();
        for (i, y) in matrix.apply(&x).iter().enumerate() {
            let expected = Vec3::new(100.0 * weights[i] * gap, 0.0, 0.0) + x[i] * 1e-3;
            assert!((y - expected).norm() < 1e-9, "{y} {expected}");
        }
    }
}
