//! Preconditioned conjugate gradients on the host, in `f64`, over vectors of three-vectors.

use super::cg::{CgInfo, CgParams};
use crate::model::Vec3;

/// The scalar product.
pub fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Solves `A x = right` from zero, `apply` being `A` and `precondition` the positive definite `M^-1`;
/// the tolerance is on `sqrt(r . M^-1 r)`, relative to the right-hand side's. Where `A` is found
/// indefinite the solve ends with what it has, so that `x` is a direction of descent [Steihaug 1983].
pub fn solve(
    apply: &dyn Fn(&[Vec3]) -> Vec<Vec3>,
    precondition: &mut dyn FnMut(&[Vec3]) -> Vec<Vec3>,
    right: &[Vec3],
    params: &CgParams,
) -> (Vec<Vec3>, CgInfo) {
    let mut x = vec![Vec3::zeros(); right.len()];
    let mut r = right.to_vec();
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let scale = rz.max(0.0).sqrt();
    let mut info = CgInfo { iterations: 0, residual: 1.0, converged: scale == 0.0 };
    while !info.converged && info.iterations < params.max_iterations {
        let q = apply(&p);
        let curvature = dot(&p, &q);
        if curvature <= 0.0 || !curvature.is_finite() {
            if info.iterations == 0 && curvature.is_finite() {
                x = p;
            }
            break;
        }
        let alpha = rz / curvature;
        for i in 0..x.len() {
            x[i] += p[i] * alpha;
            r[i] -= q[i] * alpha;
        }
        z = precondition(&r);
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
