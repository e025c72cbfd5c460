//! Conjugate gradients on the host, in `f64`.

use dressform::model::Vec3;
use dressform::solve::block_cholesky::{Block, BlockPattern};

/// Residual in the preconditioner's norm at which a solve ends, over that at its start; the drape's.
const TOLERANCE: f64 = 0.1;
/// Most iterations of a solve.
const MOST: usize = 2000;

pub fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Solves `A x = right` from zero; also the iterations. Where `A` is found indefinite the solve ends
/// with what it has, so that `x` is a direction of descent [Steihaug 1983].
pub fn conjugate_gradients(
    pattern: &BlockPattern,
    blocks: &[Block],
    precondition: &mut dyn FnMut(&[Vec3]) -> Vec<Vec3>,
    right: &[Vec3],
) -> (Vec<Vec3>, usize) {
    let mut x = vec![Vec3::zeros(); right.len()];
    let mut r = right.to_vec();
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let enough = TOLERANCE * TOLERANCE * rz;
    for iteration in 0..MOST {
        let mut q = vec![Vec3::zeros(); x.len()];
        pattern.add_product(blocks, &p, &mut q);
        let curvature = dot(&p, &q);
        if curvature <= 0.0 {
            return (if iteration == 0 { p } else { x }, iteration + 1);
        }
        let alpha = rz / curvature;
        for i in 0..x.len() {
            x[i] += p[i] * alpha;
            r[i] -= q[i] * alpha;
        }
        z = precondition(&r);
        let next = dot(&r, &z);
        if next <= enough {
            return (x, iteration + 1);
        }
        for i in 0..x.len() {
            p[i] = z[i] + p[i] * (next / rz);
        }
        rz = next;
    }
    (x, MOST)
}
