//! The pattern's energy as one quadratic form in positions and scale factors.
//!
//! `E(x) = 1/2 sum_t A_t |F_t - I|^2 + 1/2 eps sum_v A_v |x_v - x_0v|^2 / l^2` (paper, base
//! energy; `eps` made dimensionless by the vertex area `A_v` and the reference length `l`)
//! plus the outline energy of [`super::outline`]. The paper takes the latter for non-quadratic
//! and calls for ADMM; but its scale factor is linear in the border's vectors, so with the
//! factors as unknowns the sum is a sparse, positive definite least-squares problem.
//!
//! Unknowns: `[x of all vertices, y of all vertices, scale factors, turns of straight runs]`.

use super::frame::Binding;
use super::outline::Outline;
use crate::model::{Garment, Vec2};
use crate::solve::cholesky::SymmetricTriplets;

/// `1/2 u^T A u - b^T u + constant`.
#[derive(Clone, Debug, Default)]
pub struct Quadratic {
    /// `A`.
    pub matrix: SymmetricTriplets,
    /// `b`.
    pub right: Vec<f64>,
    /// The constant.
    pub constant: f64,
}

impl Quadratic {
    /// The form's value.
    pub fn value(&self, u: &[f64]) -> f64 {
        let au = self.matrix.multiply(u);
        u.iter().zip(&au).zip(&self.right).map(|((u, au), b)| u * (0.5 * au - b)).sum::<f64>() + self.constant
    }

    /// The form's gradient.
    pub fn gradient(&self, u: &[f64]) -> Vec<f64> {
        self.matrix.multiply(u).iter().zip(&self.right).map(|(au, b)| au - b).collect()
    }

    /// Adds `weight / 2 * (c . u - d)^2`.
    fn add_square(&mut self, weight: f64, c: &[(usize, f64)], d: f64) {
        self.matrix.add_outer(weight, c);
        for &(i, ci) in c {
            self.right[i] += weight * d * ci;
        }
        self.constant += 0.5 * weight * d * d;
    }
}

/// Weights of the terms, dimensionless.
#[derive(Clone, Copy, Debug)]
pub struct Weights {
    /// Outline against strain.
    pub outline: f64,
    /// Straight runs against strain.
    pub straight: f64,
    /// Pull towards the original place.
    pub anchor: f64,
}

/// Number of unknowns.
pub fn size(garment: &Garment, outline: &Outline) -> usize {
    2 * garment.points.len() + outline.scales + outline.straight.len()
}

/// The whole energy.
pub fn assemble(garment: &Garment, bindings: &[Binding], outline: &Outline, weights: Weights) -> Quadratic {
    let n = garment.points.len();
    let mut form = Quadratic { right: vec![0.0; size(garment, outline)], ..Quadratic::default() };
    for (tri, binding) in garment.triangles.iter().zip(bindings) {
        add_strain(&mut form, n, tri, binding);
    }
    add_anchor(&mut form, garment, outline, weights.anchor);
    // What no term speaks about is zero, and the matrix stays definite.
    let first = 2 * n + outline.scales;
    let mut unused = Vec::new();
    if weights.outline > 0.0 {
        add_outline(&mut form, n, outline, weights.outline);
    } else {
        unused.extend(2 * n..first);
    }
    if weights.straight > 0.0 {
        add_straight(&mut form, n, first, outline, weights.straight);
    } else {
        unused.extend(first..form.right.len());
    }
    unused.into_iter().for_each(|i| form.matrix.add(i, i, 1.0));
    form
}

/// `A/2 |sum_v x_v g_v^T - I|^2` of one triangle; the two coordinates do not mix.
fn add_strain(form: &mut Quadratic, n: usize, tri: &[u32; 3], binding: &Binding) {
    let g = &binding.gradients;
    for axis in 0..2 {
        let at = |k: usize| axis * n + tri[k] as usize;
        for k in 0..3 {
            form.right[at(k)] += binding.area * g[k][axis];
            for l in 0..=k {
                form.matrix.add(at(k), at(l), binding.area * g[k].dot(&g[l]));
            }
        }
    }
    form.constant += binding.area; // |I|^2 / 2 = 1
}

fn add_anchor(form: &mut Quadratic, garment: &Garment, outline: &Outline, anchor: f64) {
    let n = garment.points.len();
    for (v, area) in vertex_areas(garment).into_iter().enumerate() {
        let weight = anchor * area / outline.reference_length.powi(2);
        for axis in 0..2 {
            form.add_square(weight, &[(axis * n + v, 1.0)], garment.pattern[v][axis]);
        }
    }
}

fn add_outline(form: &mut Quadratic, n: usize, outline: &Outline, weight: f64) {
    for hood in &outline.neighbourhoods {
        let i = hood.vertex as usize;
        for (j, rest) in &hood.arms {
            let w = outline.arm_weight(weight, hood, rest);
            for axis in 0..2 {
                let c =
                    [(axis * n + *j as usize, 1.0), (axis * n + i, -1.0), (2 * n + hood.scale, -rest[axis])];
                form.add_square(w, &c, 0.0);
            }
        }
    }
}

/// Straight runs that may turn; their turns stand from `first` on among the unknowns.
fn add_straight(form: &mut Quadratic, n: usize, first: usize, outline: &Outline, weight: f64) {
    for (r, run) in outline.straight.iter().enumerate() {
        for ([u, v], rest) in &run.edges {
            let length = rest.norm();
            let normal = Vec2::new(-rest.y, rest.x) / (length * length);
            let at = |axis: usize, vertex: u32| axis * n + vertex as usize;
            let c = [
                (at(0, *v), normal.x),
                (at(0, *u), -normal.x),
                (at(1, *v), normal.y),
                (at(1, *u), -normal.y),
                (first + r, -1.0),
            ];
            form.add_square(weight * run.reference_length * length, &c, 0.0);
        }
    }
}

/// A third of the pattern area around each vertex [m^2].
fn vertex_areas(garment: &Garment) -> Vec<f64> {
    let mut areas = vec![0.0; garment.points.len()];
    for t in 0..garment.triangles.len() {
        let [a, b, c] = garment.pattern_corners(&garment.pattern, t);
        for &v in &garment.triangles[t] {
            areas[v as usize] += (b - a).perp(&(c - a)).abs() / 6.0;
        }
    }
    areas
}

/// Positions out of the unknowns.
pub fn positions(unknowns: &[f64], n: usize) -> Vec<Vec2> {
    (0..n).map(|v| Vec2::new(unknowns[v], unknowns[n + v])).collect()
}
