//! Sparse Cholesky on the host, in `f64`: factor once, solve often.
//!
//! A thin skin over faer's supernodal factorisation (fill-reducing order, then numeric),
//! for the stages whose systems are small and solved exactly: pattern and rig.

use faer::linalg::solvers::SolveCore;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Side};
use thiserror::Error;

/// Why a matrix could not be factored.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "each message names its fields")]
pub enum CholeskyError {
    /// An index outside of the matrix, or no memory for it.
    #[error("the sparse matrix of size {size} could not be built: {reason}")]
    Structure { size: usize, reason: String },
    /// A pivot was not positive: the matrix is singular, indefinite or not finite.
    #[error("the sparse matrix of size {size} is not positive definite: {reason}")]
    NotPositive { size: usize, reason: String },
}

/// Collects the lower triangle of a symmetric matrix; entries at one place add up.
#[derive(Clone, Debug, Default)]
pub struct SymmetricTriplets {
    entries: Vec<Triplet<usize, usize, f64>>,
}

impl SymmetricTriplets {
    /// Adds `value` at (`row`, `column`), a place of the lower triangle or its mirror image.
    ///
    /// An off-diagonal pair is added once, with either order of its indices.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.entries.push(Triplet::new(row.max(column), row.min(column), value));
    }

    /// Adds `weight * c c^T` for the sparse vector `c` with distinct indices.
    pub fn add_outer(&mut self, weight: f64, c: &[(usize, f64)]) {
        for (k, &(i, ci)) in c.iter().enumerate() {
            for &(j, cj) in &c[..=k] {
                self.add(i, j, weight * ci * cj);
            }
        }
    }

    /// `A x` of the symmetric matrix that was collected.
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for e in &self.entries {
            y[e.row] += e.val * x[e.col];
            if e.row != e.col {
                y[e.col] += e.val * x[e.row];
            }
        }
        y
    }
}

/// `A = L L^T`, ready to solve.
#[derive(Clone, Debug)]
pub struct SparseCholesky {
    size: usize,
    factor: Llt<usize, f64>,
}

impl SparseCholesky {
    /// Factors the symmetric positive definite `size` x `size` matrix.
    ///
    /// # Errors
    /// [`CholeskyError`]: an index outside of the matrix, or a pivot that is not positive.
    pub fn new(size: usize, matrix: &SymmetricTriplets) -> Result<Self, CholeskyError> {
        let lower = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, &matrix.entries)
            .map_err(|e| CholeskyError::Structure { size, reason: e.to_string() })?;
        let factor = lower
            .sp_cholesky(Side::Lower)
            .map_err(|e| CholeskyError::NotPositive { size, reason: e.to_string() })?;
        Ok(SparseCholesky { size, factor })
    }

    /// Solves for every column of `columns` (one after the other, each `size` long) in place.
    ///
    /// # Panics
    /// If the length of `columns` is no multiple of the matrix' size.
    pub fn solve(&self, columns: &mut [f64]) {
        if self.size == 0 {
            return;
        }
        assert_eq!(columns.len() % self.size, 0, "columns of length {}", self.size);
        let count = columns.len() / self.size;
        let right = MatMut::from_column_major_slice_mut(columns, self.size, count);
        self.factor.solve_in_place_with_conj(Conj::No, right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_laplacian_and_refuses_an_indefinite_matrix() {
        let n = 50;
        let mut matrix = SymmetricTriplets::default();
        for i in 0..n {
            matrix.add(i, i, 1e-3);
            if i > 0 {
                matrix.add_outer(1.0, &[(i - 1, -1.0), (i, 1.0)]);
            }
        }
        let x: Vec<f64> = (0..2 * n).map(|i| (i as f64).sin()).collect();
        let mut right = matrix.multiply(&x[..n]);
        right.extend(matrix.multiply(&x[n..]));
        SparseCholesky::new(n, &matrix).unwrap().solve(&mut right);
        for (a, b) in right.iter().zip(&x) {
            assert!((a - b).abs() < 1e-10, "{a} {b}");
        }
        matrix.add(7, 7, -10.0);
        assert!(matches!(SparseCholesky::new(n, &matrix), Err(CholeskyError::NotPositive { .. })));
    }
}
