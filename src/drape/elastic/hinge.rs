//! The angle of a hinge and its gradient.
//!
//! A hinge has the edge `x0 x1` and the opposite points `x2` and `x3`. With the edge vectors
//! `e = x1 - x0`, `a = x2 - x0`, `b = x3 - x0` and the normals `n_a = e x a`, `n_b = b x e`,
//!
//! ```text
//! theta = atan2(|e| (n_a . b), n_a . n_b)
//! ```
//!
//! is 0 where the cloth is flat and positive where it bends towards `n_a`; it depends on the
//! four points alone, not on how their triangles are turned. Its gradient [Bridson 2003;
//! Tamstorf and Grinspun 2013] is
//!
//! ```text
//! d/dx2 = |e| n_a / |n_a|^2          d/dx3 = |e| n_b / |n_b|^2
//! d/dx1 = -(s_a d/dx2 + s_b d/dx3)   d/dx0 = -((1 - s_a) d/dx2 + (1 - s_b) d/dx3)
//! ```
//!
//! where `s_a = a . e / |e|^2` is where `x2` projects onto the edge. The gradient grows
//! without bound where a triangle collapses, so the squared norms are kept above a floor:
//! it is exact as long as no triangle has lost [`COLLAPSED`] of its rest size.

use nalgebra::{Matrix3, RealField, Vector3};

use crate::model::Vec3;

/// Part of its rest length or area below which an edge or a triangle counts as collapsed.
pub const COLLAPSED: f64 = 1e-3;

/// Constants of a hinge.
#[derive(Clone, Copy, Debug)]
pub struct HingeRest<T> {
    /// Angle at rest [rad].
    pub angle: T,
    /// Least squared edge length [m^2] in the gradient.
    pub floor_edge: T,
    /// Least squared length of the two normals [m^4] in the gradient.
    pub floor_normal: [T; 2],
}

/// The angle of a hinge with the edge vectors `e`, `a`, `b` [rad], in (-pi, pi].
pub fn angle<T: RealField + Copy>(e: &Vector3<T>, a: &Vector3<T>, b: &Vector3<T>) -> T {
    let (normal_a, normal_b) = (e.cross(a), b.cross(e));
    (e.norm() * normal_a.dot(b)).atan2(normal_a.dot(&normal_b))
}

/// `angle` minus the rest angle, the shorter way round, so that a seam folded at rest
/// (angle near pi) does not jump when it is folded a little further.
pub fn bend<T: RealField + Copy>(rest: T, angle: T) -> T {
    let difference = angle - rest;
    if difference > T::pi() {
        difference - T::two_pi()
    } else if difference < -T::pi() {
        difference + T::two_pi()
    } else {
        difference
    }
}

/// The gradient of [`angle`] with respect to the points `x0`..`x3` [rad/m].
pub fn gradient<T: RealField + Copy>(
    rest: &HingeRest<T>,
    e: &Vector3<T>,
    a: &Vector3<T>,
    b: &Vector3<T>,
) -> [Vector3<T>; 4] {
    let (normal_a, normal_b) = (e.cross(a), b.cross(e));
    let square = e.norm_squared().max(rest.floor_edge);
    let length = square.sqrt();
    let x2 = normal_a * (length / normal_a.norm_squared().max(rest.floor_normal[0]));
    let x3 = normal_b * (length / normal_b.norm_squared().max(rest.floor_normal[1]));
    let (along_a, along_b) = (a.dot(e) / square, b.dot(e) / square);
    let one = T::one();
    let x1 = -(x2 * along_a + x3 * along_b);
    let x0 = -(x2 * (one - along_a) + x3 * (one - along_b));
    [x0, x1, x2, x3]
}

/// The second derivatives of [`angle`] in the points `x0`..`x3` [rad/m^2], blocks of rows and
/// columns [Tamstorf and Grinspun 2013]; floors as in [`gradient`].
pub fn hessian(rest: &HingeRest<f64>, e: &Vec3, a: &Vec3, b: &Vec3) -> [[Matrix3<f64>; 4]; 4] {
    let square = e.norm_squared().max(rest.floor_edge);
    // Derivatives of the gradients in x2 and x3 and of where they project, by (e, a, b).
    let zero = Matrix3::zeros();
    let (g2, [by_e2, by_a]) = far_gradient(e, a, square, rest.floor_normal[0]);
    let (g3, [by_e3, by_b]) = far_gradient(e, b, square, rest.floor_normal[1]);
    let (x2, x3) = ([by_e2, by_a, zero], [-by_e3, zero, -by_b]);
    let g3 = -g3;
    let (along_a, along_b) = (a.dot(e) / square, b.dot(e) / square);
    let slide = |p: &Vec3, along: f64| (p - e * (2.0 * along)) / square;
    let onto = e / square;
    let x1 = [
        -(x2[0] * along_a + x3[0] * along_b)
            - g2 * slide(a, along_a).transpose()
            - g3 * slide(b, along_b).transpose(),
        -x2[1] * along_a - g2 * onto.transpose(),
        -x3[2] * along_b - g3 * onto.transpose(),
    ];
    let x0: [Matrix3<f64>; 3] = std::array::from_fn(|k| -(x1[k] + x2[k] + x3[k]));
    // e moves with x1, a with x2, b with x3, and all against x0.
    [x0, x1, x2, x3].map(|row| [-(row[0] + row[1] + row[2]), row[0], row[1], row[2]])
}

/// `|e| n / |n|^2` with `n = e x p`, and its derivatives in `e` and `p`.
fn far_gradient(e: &Vec3, p: &Vec3, square: f64, floor: f64) -> (Vec3, [Matrix3<f64>; 2]) {
    let (n, length) = (e.cross(p), square.sqrt());
    let q = n.norm_squared().max(floor);
    let mirrored = (Matrix3::identity() - n * n.transpose() * (2.0 / q)) * (length / q);
    let by_e = n * e.transpose() / (length * q) - mirrored * p.cross_matrix();
    (n * (length / q), [by_e, mirrored * e.cross_matrix()])
}
