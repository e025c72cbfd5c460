//! The unilateral volume term's bias, and the residual of the nonlinear problem.
//!
//! With the pressure eliminated, the fixed point asks for `S u = f + B^T q`, where in each
//! cell with a volume term
//!
//! ```text
//! q = (mean div u - mean min(0, det(I + grad u) - 1)) / gamma
//! ```
//!
//! times the cell's share is what the linear matrix `S` counts too much. The means are over the 2x2x2 Gauss points.

use rayon::prelude::*;

use super::domain::{NONE, WHOLE};
use super::element::{GAUSS, corner};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};

use super::stencil::Extent;

/// Cells or nodes that a CPU task takes.
const GRAIN: usize = 1024;

pub(super) static PRESSURE: Kernel = Kernel {
    name: "transfer_pressure",
    wgsl: &[INDEX_WGSL, include_str!("pressure.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: cell_pressure,
};

fn cell_pressure(args: &mut HostArgs<'_>) {
    let extent: Extent = args.params();
    let (cell_nodes, shares) = (args.read::<[u32; 8]>(0), args.read::<u32>(1));
    let u = args.read::<[f32; 3]>(2);
    let pressure = args.write::<f32>(3);
    let scale = 1.0 / extent.second;
    pressure.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(cell, q)| {
        *q = if shares[cell] == 0 {
            0.0
        } else {
            let v = cell_nodes[cell].map(|node| u[node as usize]);
            shares[cell] as f32 / f32::from(WHOLE) * 0.125 * excess(&v, scale) / extent.coefficient
        };
    });
}

/// The sum over Gauss points of `tr G - min(0, det(I + G) - 1)`, `G` the gradient of the
/// nodal values `v`, with `scale` one over the cell's side.
fn excess(v: &[[f32; 3]; 8], scale: f32) -> f32 {
    let difference =
        |a: usize, b: usize| -> [f32; 3] { std::array::from_fn(|k| scale * (v[b][k] - v[a][k])) };
    let dx = [difference(0, 4), difference(1, 5), difference(2, 6), difference(3, 7)];
    let dy = [difference(0, 2), difference(1, 3), difference(4, 6), difference(5, 7)];
    let dz = [difference(0, 1), difference(2, 3), difference(4, 5), difference(6, 7)];
    let across = |d: &[[f32; 3]; 4]| -> [[f32; 3]; 4] {
        let (near, far) = (GAUSS[1] as f32, GAUSS[0] as f32);
        let weights = |upper: bool| if upper { [far, near] } else { [near, far] };
        std::array::from_fn(|g| {
            let (s, t) = (weights(g & 2 != 0), weights(g & 1 != 0));
            std::array::from_fn(|k| {
                s[0] * (t[0] * d[0][k] + t[1] * d[1][k]) + s[1] * (t[0] * d[2][k] + t[1] * d[3][k])
            })
        })
    };
    let (gx, gy, gz) = (across(&dx), across(&dy), across(&dz));
    let mut sum = 0.0;
    for g in 0..8 {
        let [i, j, k] = corner(g);
        let (x, y, z) = (gx[2 * j + k], gy[2 * i + k], gz[2 * i + j]);
        let trace = x[0] + y[1] + z[2];
        sum += trace - (determinant(x, y, z) - 1.0).min(0.0);
    }
    sum
}

/// `det(I + G)` for the columns of `G`.
fn determinant(x: [f32; 3], y: [f32; 3], z: [f32; 3]) -> f32 {
    let (a, e, i) = (x[0] + 1.0, y[1] + 1.0, z[2] + 1.0);
    a * (e * i - y[2] * z[1]) - y[0] * (x[1] * i - x[2] * z[1]) + z[0] * (x[1] * y[2] - x[2] * e)
}

pub(super) static RESIDUAL: Kernel = Kernel {
    name: "transfer_residual",
    wgsl: &[INDEX_WGSL, include_str!("residual.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: residual,
};

fn residual(args: &mut HostArgs<'_>) {
    let extent: Extent = args.params();
    let node_cells = args.read::<[u32; 8]>(0);
    let (load, image) = (args.read::<[f32; 3]>(1), args.read::<[f32; 3]>(2));
    let pressure = args.read::<f32>(3);
    let r = args.write::<[f32; 3]>(4);
    r.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(i, r)| {
        let mut sum = [0.0f32; 3];
        for (o, &cell) in node_cells[i].iter().enumerate() {
            if cell != NONE {
                let q = pressure[cell as usize];
                for (sum, side) in sum.iter_mut().zip(corner(o)) {
                    *sum += if side == 0 { q } else { -q };
                }
            }
        }
        for k in 0..3 {
            r[k] = (load[i][k] - image[i][k]) + extent.coefficient * sum[k];
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn affine(m: [[f32; 3]; 3]) -> [[f32; 3]; 8] {
        std::array::from_fn(|a| {
            let c = corner(a);
            std::array::from_fn(|i| (0..3).map(|j| m[i][j] * 0.02 * c[j] as f32).sum())
        })
    }

    #[test]
    fn an_affine_map_has_its_determinant() {
        let m = [[-0.2, 0.3, 0.1], [0.05, -0.1, 0.2], [-0.3, 0.2, -0.4]];
        let f = nalgebra::Matrix3::from_fn(|i, j| m[i][j] + if i == j { 1.0 } else { 0.0 });
        assert!(f.determinant() < 1.0);
        let exact = 8.0 * (-0.7 - (f.determinant() - 1.0));
        assert!((excess(&affine(m), 50.0) - exact).abs() < 1e-5);
    }

    #[test]
    fn expansion_is_free() {
        let m = [[0.2, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.3]];
        assert!((excess(&affine(m), 50.0) - 8.0 * 0.6).abs() < 1e-5);
    }
}
