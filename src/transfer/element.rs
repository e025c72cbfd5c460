//! The trilinear (Q1) element on a cube of side `h`, with one pressure (P0).
//!
//! Local node `a` of a cell sits at the corner `(a >> 2 & 1, a >> 1 & 1, a & 1)`.
//! All cells are alike, so their matrices are made once:
//!
//! ```text
//! viscous      V[a,i; b,j] = nu int D(phi_a e_i) : D(phi_b e_j)
//!                          = nu/2 int (delta_ij grad phi_a . grad phi_b + d_j phi_a d_i phi_b)
//! divergence   d[a,i]      = int d_i phi_a
//! Schur        P[a,i; b,j] = d[a,i] d[b,j] / (gamma h^3)
//! ```

use nalgebra::SMatrix;

/// Element matrix over (local node, component).
pub type ElementMatrix = SMatrix<f64, 24, 24>;

/// The corner of local node `a`.
pub const fn corner(a: usize) -> [usize; 3] {
    [a >> 2 & 1, a >> 1 & 1, a & 1]
}

/// Shape functions at `t` in the unit cube.
pub fn shape(t: [f64; 3]) -> [f64; 8] {
    std::array::from_fn(|a| (0..3).map(|d| factor(corner(a)[d], t[d])).product())
}

/// Gradients of the shape functions at `t` in the unit cube, with respect to `t`.
pub fn shape_gradient(t: [f64; 3]) -> [[f64; 3]; 8] {
    std::array::from_fn(|a| {
        let c = corner(a);
        std::array::from_fn(|k| {
            (0..3)
                .map(|d| match (d == k, c[d]) {
                    (false, side) => factor(side, t[d]),
                    (true, 0) => -1.0,
                    (true, _) => 1.0,
                })
                .product()
        })
    })
}

fn factor(side: usize, t: f64) -> f64 {
    if side == 0 { 1.0 - t } else { t }
}

/// The two Gauss points of the unit interval.
pub const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

/// `d[a,i]`: the integral of each shape function's gradient over a cell of side `h` [m^2].
pub fn divergence(h: f64) -> [f64; 24] {
    std::array::from_fn(|k| if corner(k / 3)[k % 3] == 0 { -0.25 * h * h } else { 0.25 * h * h })
}

/// The viscous matrix of a cell of side `h`, by the 2x2x2 Gauss rule (exact for Q1).
pub fn viscous(h: f64, nu: f64) -> ElementMatrix {
    let mut matrix = ElementMatrix::zeros();
    let weight = 0.125 * h; // h^3 / 8, with 1/h^2 from the two gradients
    for g in 0..8 {
        let grad = shape_gradient(corner(g).map(|side| GAUSS[side]));
        for a in 0..8 {
            for b in 0..8 {
                let dot: f64 = (0..3).map(|k| grad[a][k] * grad[b][k]).sum();
                for i in 0..3 {
                    for j in 0..3 {
                        let direct = if i == j { dot } else { 0.0 };
                        let value = 0.5 * nu * weight * (direct + grad[a][j] * grad[b][i]);
                        matrix[(3 * a + i, 3 * b + j)] += value;
                    }
                }
            }
        }
    }
    matrix
}

/// The eliminated pressure's matrix `B^T (gamma M_p)^-1 B` of a cell of side `h`.
pub fn schur(h: f64, gamma: f64) -> ElementMatrix {
    let d = SMatrix::<f64, 24, 1>::from(divergence(h));
    d * d.transpose() / (gamma * h.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodal values of `u(x) = M x + t` on a cell.
    fn affine(h: f64, m: [[f64; 3]; 3], t: [f64; 3]) -> SMatrix<f64, 24, 1> {
        SMatrix::from_fn(|k, _| {
            let c = corner(k / 3);
            t[k % 3] + (0..3).map(|j| m[k % 3][j] * h * c[j] as f64).sum::<f64>()
        })
    }

    #[test]
    fn rigid_motions_cost_nothing_and_strain_costs_its_energy() {
        let (h, nu) = (0.02, 100.0);
        let v = viscous(h, nu);
        assert!((v - v.transpose()).abs().max() < 1e-15);
        let spin = affine(h, [[0.0, -0.3, 0.7], [0.3, 0.0, -0.2], [-0.7, 0.2, 0.0]], [1.0, 2.0, 3.0]);
        assert!((v * spin).abs().max() < 1e-12);
        let strain = affine(h, [[0.1, 0.2, 0.0], [0.2, -0.3, 0.0], [0.0, 0.0, 0.4]], [0.0; 3]);
        let exact = nu * (0.01 + 0.09 + 0.16 + 2.0 * 0.04) * h.powi(3);
        let energy = (strain.transpose() * v * strain)[0];
        assert!((energy / exact - 1.0).abs() < 1e-12, "{energy} against {exact}");
    }

    #[test]
    fn the_viscous_null_space_is_the_six_rigid_motions() {
        let eigenvalues = viscous(1.0, 1.0).symmetric_eigenvalues();
        assert_eq!(eigenvalues.iter().filter(|e| e.abs() < 1e-12).count(), 6);
        assert!(eigenvalues.iter().all(|&e| e > -1e-12));
    }

    #[test]
    fn the_schur_term_sees_volume_change_alone() {
        let (h, gamma) = (0.02, 0.01);
        let p = schur(h, gamma);
        let shear = affine(h, [[0.0, 0.5, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.0]], [1.0, 0.0, 0.0]);
        assert!((p * shear).abs().max() < 1e-12);
        let growth = affine(h, [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], [0.0; 3]);
        let energy = (growth.transpose() * p * growth)[0];
        let exact = 0.09 * h.powi(3) / gamma;
        assert!((energy / exact - 1.0).abs() < 1e-12, "{energy} against {exact}");
    }

    #[test]
    fn shape_gradients_match_finite_differences() {
        let (t, e) = ([0.3, 0.6, 0.8], 1e-6);
        let gradient = shape_gradient(t);
        assert!((shape(t).iter().sum::<f64>() - 1.0).abs() < 1e-15);
        for k in 0..3 {
            let (mut up, mut down) = (t, t);
            up[k] += e;
            down[k] -= e;
            let (up, down) = (shape(up), shape(down));
            for a in 0..8 {
                assert!((gradient[a][k] - (up[a] - down[a]) / (2.0 * e)).abs() < 1e-9);
            }
        }
    }
}
