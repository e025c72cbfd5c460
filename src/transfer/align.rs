//! The rigid motion that brings one body nearest to another.
//!
//! A motion of the whole body needs no flow around it. Taking it out first keeps what is
//! solved for small, and makes a moved or turned body carry its garment exactly: the strain
//! `D(u)` is linear and would take a finite turn for a deformation.

use nalgebra::Matrix3;

use crate::model::Vec3;

/// `x -> linear x + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// A rotation.
    pub linear: Matrix3<f64>,
    /// Translation [m].
    pub shift: Vec3,
}

impl Motion {
    /// The image of `p` [m].
    pub fn apply(&self, p: &Vec3) -> Vec3 {
        self.linear * p + self.shift
    }

    /// The rotation and translation with the least `sum w |R x + t - y|^2` [Kabsch 1976].
    pub fn best_rigid(from: &[Vec3], to: &[Vec3], weights: &[f64]) -> Motion {
        let total: f64 = weights.iter().sum();
        let mean = |points: &[Vec3]| -> Vec3 {
            points.iter().zip(weights).map(|(p, w)| p * *w).sum::<Vec3>() / total
        };
        let (a, b) = (mean(from), mean(to));
        let mut covariance = Matrix3::zeros();
        for ((x, y), w) in from.iter().zip(to).zip(weights) {
            covariance += (y - b) * (x - a).transpose() * *w;
        }
        let linear = nearest_rotation(&covariance);
        Motion { linear, shift: b - linear * a }
    }
}

/// The rotation nearest to `m`.
fn nearest_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = m.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Matrix3::identity();
    };
    let mut turn = Matrix3::identity();
    let smallest = svd.singular_values.imin();
    turn[(smallest, smallest)] = (u * v_t).determinant().signum();
    u * turn * v_t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rigid_motion_is_found() {
        let points: Vec<Vec3> = (0..20)
            .map(|i| {
                let t = f64::from(i);
                Vec3::new((1.3 * t).sin(), (0.7 * t).cos(), (2.1 * t).sin())
            })
            .collect();
        let turn = *nalgebra::Rotation3::from_euler_angles(0.4, -1.2, 2.5).matrix();
        let shift = Vec3::new(3.0, -1.0, 0.5);
        let moved: Vec<Vec3> = points.iter().map(|p| turn * p + shift).collect();
        let weights: Vec<f64> = (0..20).map(|i| 1.0 + f64::from(i % 3)).collect();
        let motion = Motion::best_rigid(&points, &moved, &weights);
        assert!((motion.linear - turn).norm() < 1e-12);
        assert!((motion.shift - shift).norm() < 1e-12);
    }
}
