//! Equal lengths of sewn chains.
//!
//! What two sewn sides must share is their length; their shape is their own affair. The
//! paper buys equal lengths through the shared scale factors, so that lengths cost shape and
//! strain. Here the lengths are constraints of their own. With unit directions `d_e` of the
//! border edges at the current layout, a chain's length is linear in the positions,
//! `l(x) = sum_e d_e . (x_j - x_i)`, and exact at that layout. With `r` the relative
//! difference `2 (l_a - l_b) / (l_a + l_b)` of the original pattern (ease, gathers), the
//! constraint `(1 - r/2) l_a(x) = (1 + r/2) l_b(x)` keeps it. The energy's matrix `A` is
//! factored once; the constrained minimum follows from the multipliers of a small dense
//! system, `(C A^-1 C^T + compliance) mu = C u_0`, `u = u_0 - A^-1 C^T mu`. Directions are
//! updated and the step repeated until lengths agree.

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::energy::positions;
use crate::model::{Chain, Vec2, chain};
use crate::solve::cholesky::SparseCholesky;

/// Compliance of the constraints over the largest diagonal of their matrix: far below the
/// tolerance on lengths, far above rounding, so that chains that say the same twice are fine.
const COMPLIANCE: f64 = 1e-10;

/// What the iteration over directions did.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Solves with updated directions.
    pub iterations: usize,
    /// Largest change of relative difference in length over the chains.
    pub mismatch: f64,
}

/// The minimum of the energy with sewn chains of equal lengths.
pub struct Constrained<'a> {
    /// The energy's factored matrix.
    pub factor: &'a SparseCholesky,
    /// Unconstrained minimum.
    pub free: &'a [f64],
    /// Chains.
    pub chains: &'a [Chain],
    /// Original pattern.
    pub original: &'a [Vec2],
}

impl Constrained<'_> {
    /// Iterates until the mismatch is below `tolerance` or `iterations` are spent; returns
    /// the unknowns of the best layout met.
    ///
    /// # Errors
    /// [`Error::Constraint`] if the dense system cannot be solved.
    pub fn solve(&self, iterations: usize, tolerance: f64) -> Result<(Vec<f64>, Outcome), Error> {
        let n = self.original.len();
        let measure = |u: &[f64]| chain::chains_mismatch(self.chains, self.original, &positions(u, n));
        let mut best = self.free.to_vec();
        let mut outcome = Outcome { iterations: 0, mismatch: measure(&best) };
        let mut unknowns = best.clone();
        for k in 1..=iterations {
            if outcome.mismatch <= tolerance || self.chains.is_empty() {
                break;
            }
            unknowns = self.step(&positions(&unknowns, n))?;
            let mismatch = measure(&unknowns);
            outcome.iterations = k;
            if mismatch < outcome.mismatch {
                outcome.mismatch = mismatch;
                best.clone_from(&unknowns);
            }
        }
        Ok((best, outcome))
    }

    /// One solve with directions taken from `layout`.
    fn step(&self, layout: &[Vec2]) -> Result<Vec<f64>, Error> {
        let size = self.free.len();
        let rows: Vec<Vec<(usize, f64)>> = self.chains.iter().map(|c| self.row(c, layout)).collect();
        let mut responses = vec![0.0; size * rows.len()];
        for (row, column) in rows.iter().zip(responses.chunks_exact_mut(size)) {
            for &(i, value) in row {
                column[i] += value;
            }
        }
        self.factor.solve(&mut responses);
        let apply = |row: &[(usize, f64)], u: &[f64]| row.iter().map(|&(i, v)| v * u[i]).sum::<f64>();
        let mut small =
            DMatrix::from_fn(rows.len(), rows.len(), |i, j| apply(&rows[i], &responses[j * size..][..size]));
        let compliance = COMPLIANCE * small.diagonal().max();
        for i in 0..rows.len() {
            small[(i, i)] += compliance;
        }
        let gap = DVector::from_iterator(rows.len(), rows.iter().map(|row| apply(row, self.free)));
        let multipliers = small.cholesky().ok_or(Error::Constraint { chains: rows.len() })?.solve(&gap);
        let mut unknowns = self.free.to_vec();
        for (mu, response) in multipliers.iter().zip(responses.chunks_exact(size)) {
            for (u, r) in unknowns.iter_mut().zip(response) {
                *u -= mu * r;
            }
        }
        Ok(unknowns)
    }

    /// The constraint's coefficients, over the chain's rest length (dimensionless for
    /// positions in metres over metres); an index may occur more than once.
    fn row(&self, chain: &Chain, layout: &[Vec2]) -> Vec<(usize, f64)> {
        let n = self.original.len();
        let ease = 0.5 * chain.relative_difference(self.original);
        let [a, b] = chain.lengths(self.original);
        let mean = 0.5 * (a + b);
        let mut row = Vec::new();
        for (side, factor) in [(&chain.a, (1.0 - ease) / mean), (&chain.b, -(1.0 + ease) / mean)] {
            for edge in side.windows(2) {
                let (i, j) = (edge[0] as usize, edge[1] as usize);
                let direction = (layout[j] - layout[i])
                    .try_normalize(0.0)
                    .or_else(|| (self.original[j] - self.original[i]).try_normalize(0.0))
                    .unwrap_or_else(Vec2::zeros);
                for axis in 0..2 {
                    row.push((axis * n + j, factor * direction[axis]));
                    row.push((axis * n + i, -factor * direction[axis]));
                }
            }
        }
        row
    }
}
