//! The nonlinear residual in `f64` on the host, cell by cell: the judge of a tight solve.
//!
//! Written from the element matrices and the Gauss points, it shares nothing with the
//! device's kernels but the grid. With it, the fixed point becomes iterative refinement
//! [Wilkinson 1963]: corrections in `f32`, their sum and what is left in `f64`.

use nalgebra::{Matrix3, SVector};
use rayon::prelude::*;

use super::Params;
use super::boundary::Boundary;
use super::domain::{Domain, WHOLE};
use super::element::{self, ElementMatrix, GAUSS, corner};
use super::terms::Shares;
use crate::model::Vec3;

/// Residual, relative to that of no displacement, that a tight solve reaches.
pub const TOLERANCE: f64 = 1e-8;

/// A domain's problem with its coefficients.
#[derive(Debug)]
pub struct Exact<'a> {
    domain: &'a Domain,
    shares: Shares,
    fixed: &'a [bool],
    viscous: ElementMatrix,
    divergence: [f64; 24],
    gamma: f64,
    gradients: [[[f64; 3]; 8]; 8],
}

impl<'a> Exact<'a> {
    /// As [`super::field::Problem::new`].
    pub fn new(params: &Params, domain: &'a Domain, boundary: &Boundary, fixed: &'a [bool]) -> Exact<'a> {
        let h = domain.lattice.cell;
        let gradient = |g: usize| element::shape_gradient(corner(g).map(|side| GAUSS[side]));
        Exact {
            domain,
            shares: Shares::new(domain, boundary),
            fixed,
            viscous: element::viscous(h, params.nu),
            divergence: element::divergence(h),
            gamma: params.gamma,
            gradients: std::array::from_fn(|g| gradient(g).map(|row| row.map(|d| d / h))),
        }
    }

    /// `f - A u - B^T p` with `p = -mean min(0, det(I + grad u) - 1) / gamma`, per node; zero
    /// on fixed nodes. `boundary` may have been augmented since [`Exact::new`].
    pub fn residual(&self, boundary: &Boundary, u: &[Vec3]) -> Vec<Vec3> {
        let mut residual = match boundary.load.is_empty() {
            true => vec![Vec3::zeros(); u.len()],
            false => boundary.load.clone(),
        };
        let forces: Vec<SVector<f64, 24>> =
            (0..self.domain.cells.len()).into_par_iter().map(|cell| self.cell_force(cell, u)).collect();
        for (nodes, force) in self.domain.cell_nodes.iter().zip(&forces) {
            for (a, &node) in nodes.iter().enumerate() {
                residual[node as usize] -= force.fixed_rows::<3>(3 * a);
            }
        }
        for (cell, mass) in &boundary.masses {
            let nodes = self.domain.cell_nodes[*cell as usize];
            for (row, &node) in mass.iter().zip(&nodes) {
                for (m, &other) in row.iter().zip(&nodes) {
                    residual[node as usize] -= u[other as usize] * *m;
                }
            }
        }
        for (r, _) in residual.iter_mut().zip(self.fixed).filter(|(_, fixed)| **fixed) {
            *r = Vec3::zeros();
        }
        residual
    }

    fn cell_force(&self, cell: usize, u: &[Vec3]) -> SVector<f64, 24> {
        let nodes = self.domain.cell_nodes[cell];
        let v = SVector::<f64, 24>::from_fn(|k, _| u[nodes[k / 3] as usize][k % 3]);
        let mut force = self.viscous * v * self.shares.viscosity(cell);
        let share = f64::from(self.shares.volume[cell]) / f64::from(WHOLE);
        if share > 0.0 {
            let mut change = 0.0;
            for gradient in &self.gradients {
                let mut f = Matrix3::identity();
                for (a, d) in gradient.iter().enumerate() {
                    f += u[nodes[a] as usize] * Vec3::from(*d).transpose();
                }
                change += 0.125 * (f.determinant() - 1.0).min(0.0);
            }
            force += SVector::from(self.divergence) * (share * change / self.gamma);
        }
        force
    }
}
