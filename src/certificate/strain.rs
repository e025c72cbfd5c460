//! Strain of a draped triangle against its panel.
//!
//! The deformation gradient F = [F_warp F_weft] (3x2) maps panel to space: F D_m = D_s with the
//! edges of the triangle in the panel (D_m, 2x2) and in space (D_s, 3x2). Its columns are the
//! images of the unit warp and weft. Of its polar decomposition F = R S the stretch
//! S = sqrt(F^T F) is symmetric and free of rotation, so that a garment on two bodies can be
//! compared triangle by triangle.

use nalgebra::{Matrix2, Matrix3x2};

use crate::model::{Vec2, Vec3};

/// A deformation gradient, panel to space.
pub type Gradient = Matrix3x2<f64>;
/// A stretch in warp and weft axes.
pub type Stretch = Matrix2<f64>;

/// Signed area of a panel triangle [m^2]; negative where it is flipped.
pub fn signed_area(pattern: &[Vec2; 3]) -> f64 {
    (pattern[1] - pattern[0]).perp(&(pattern[2] - pattern[0])) / 2.0
}

/// F of a triangle with corners `pattern` in its panel [m] and `points` in space [m]; `None` if
/// the panel triangle has no area.
pub fn deformation_gradient(pattern: &[Vec2; 3], points: &[Vec3; 3]) -> Option<Gradient> {
    let panel = Matrix2::from_columns(&[pattern[1] - pattern[0], pattern[2] - pattern[0]]);
    let space = Matrix3x2::from_columns(&[points[1] - points[0], points[2] - points[0]]);
    panel.try_inverse().map(|inverse| space * inverse)
}

/// S of F = R S: the root of C = F^T F, in closed form
/// S = (C + sqrt(det C) I) / sqrt(tr C + 2 sqrt(det C)).
pub fn stretch(gradient: &Gradient) -> Stretch {
    let c = gradient.tr_mul(gradient);
    let root = c.determinant().max(0.0).sqrt();
    let scale = (c.trace() + 2.0 * root).sqrt();
    if scale == 0.0 {
        return Stretch::zeros(); // a triangle collapsed to a point
    }
    (c + Stretch::identity() * root) / scale
}

/// The nearest isometry R of F = R S (3x2, orthonormal columns); `None` if the triangle has
/// collapsed to a line or a point.
pub fn rotation(gradient: &Gradient) -> Option<Gradient> {
    stretch(gradient).try_inverse().map(|inverse| gradient * inverse)
}

/// What a tailor asks of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strain {
    /// |F_warp| - 1.
    pub warp: f64,
    /// |F_weft| - 1.
    pub weft: f64,
    /// Cosine of the angle between F_warp and F_weft; 0 without shear.
    pub shear: f64,
}

impl Strain {
    /// From a deformation gradient; the shear of a collapsed column counts as 0.
    pub fn new(gradient: &Gradient) -> Strain {
        let (warp, weft) = (gradient.column(0), gradient.column(1));
        let lengths = warp.norm() * weft.norm();
        let shear = if lengths == 0.0 { 0.0 } else { warp.dot(&weft) / lengths };
        Strain { warp: warp.norm() - 1.0, weft: weft.norm() - 1.0, shear }
    }
}

/// Weighted percentiles of (value, weight): for each fraction the smallest value that at least
/// that fraction of the weight does not exceed. Reorders `values`; 0 without weight.
pub fn percentiles<const N: usize>(values: &mut [(f64, f64)], fractions: [f64; N]) -> [f64; N] {
    let total: f64 = values.iter().map(|v| v.1).sum();
    fractions.map(|fraction| percentile(values, fraction * total))
}

/// The smallest value that `weight` of the whole weight does not exceed, by halves [Hoare 1961].
fn percentile(mut values: &mut [(f64, f64)], mut weight: f64) -> f64 {
    let mut last = 0.0;
    while !values.is_empty() {
        let half = values.len() / 2;
        let (low, middle, high) = values.select_nth_unstable_by(half, |a, b| a.0.total_cmp(&b.0));
        let below: f64 = low.iter().map(|v| v.1).sum();
        if below >= weight && !low.is_empty() {
            values = low;
            continue;
        }
        last = middle.0;
        weight -= below + middle.1;
        if weight <= 0.0 {
            break;
        }
        values = high;
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    const PANEL: [Vec2; 3] = [Vec2::new(0.1, 0.2), Vec2::new(0.5, 0.3), Vec2::new(0.2, 0.7)];

    /// Any isometry of the panel into space.
    fn turned(v: Vec3) -> Vec3 {
        nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.3) * v + Vec3::new(3.0, -2.0, 1.0)
    }

    #[test]
    fn a_stretch_comes_back_whatever_the_rotation() {
        let s = Stretch::new(1.2, 0.07, 0.07, 0.9);
        let points = PANEL.map(|p| turned((s * p).push(0.0)));
        let f = deformation_gradient(&PANEL, &points).expect("has area");
        assert!((stretch(&f) - s).amax() < 1e-14);
        let r = rotation(&f).expect("has area");
        assert!((r.tr_mul(&r) - Stretch::identity()).amax() < 1e-13);
        assert!((r * s - f).amax() < 1e-13);
    }

    #[test]
    fn warp_weft_and_shear_have_their_closed_forms() {
        let f = Matrix2::new(1.3, 0.4, 0.0, 0.8);
        let points = PANEL.map(|p| turned((f * p).push(0.0)));
        let strain = Strain::new(&deformation_gradient(&PANEL, &points).expect("has area"));
        let weft = 0.4f64.hypot(0.8);
        assert!((strain.warp - 0.3).abs() < 1e-14);
        assert!((strain.weft - (weft - 1.0)).abs() < 1e-14);
        assert!((strain.shear - 0.4 / weft).abs() < 1e-14);
    }

    #[test]
    fn collapsed_triangles_have_finite_strain_or_none() {
        let line = PANEL.map(|p| turned(Vec3::new(p.x, 0.0, 0.0)));
        let f = deformation_gradient(&PANEL, &line).expect("the panel has area");
        assert!(rotation(&f).is_none() || rotation(&f).is_some_and(|r| r.amax() > 0.0));
        assert!((stretch(&f) - Stretch::new(1.0, 0.0, 0.0, 0.0)).amax() < 1e-7);
        let point = [Vec3::x(); 3];
        let f = deformation_gradient(&PANEL, &point).expect("the panel has area");
        assert_eq!(stretch(&f), Stretch::zeros());
        assert_eq!(Strain::new(&f), Strain { warp: -1.0, weft: -1.0, shear: 0.0 });
        assert!(deformation_gradient(&[Vec2::x(); 3], &point).is_none());
    }

    #[test]
    fn percentiles_go_by_weight() {
        let mut values = [(3.0, 1.0), (1.0, 98.0), (2.0, 1.0)];
        assert_eq!(percentiles(&mut values, [0.01, 0.5, 0.98, 0.99, 1.0]), [1.0, 1.0, 1.0, 2.0, 3.0]);
        assert_eq!(percentiles(&mut [], [0.5]), [0.0]);
    }
}
