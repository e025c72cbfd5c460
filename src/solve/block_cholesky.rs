//! Cholesky factors of 3x3-block matrices that share one sparsity, on the host in `f64`.
//!
//! The fill-reducing order and the factor's sparsity are found once; every matrix with that
//! sparsity then costs a numeric factorisation (faer, supernodal). Conjugate gradients use a
//! factor as preconditioner where a few couplings of the matrix lie outside of the sparsity.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::cholesky::{
    LltRef, SymbolicCholesky, SymbolicCholeskyRaw, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};

use super::cholesky::CholeskyError;
use crate::model::Vec3;

/// A matrix that is not positive definite: elimination got as far as block row `row`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indefinite {
    /// The vectors along which it is not reach this row and rows eliminated before it.
    pub row: u32,
}

/// A garment's supernodes are small: threads that wait for each one's product cost more than they
/// bring (half as much CPU time again on 2 threads, no wall time less on 16).
const ONE: Par = Par::Seq;

/// A 3x3 block, row by row.
pub type Block = [f64; 9];

/// The sparsity of a symmetric block matrix, ordered and analysed.
pub struct BlockPattern {
    /// First block of each row, shape `[rows + 1]`.
    pub row_start: Vec<u32>,
    /// Block column of each block, ascending in a row.
    pub columns: Vec<u32>,
    /// The scalar lower triangle, and which number of which block each entry is.
    lower: SymbolicSparseColMat<usize>,
    source: Vec<(u32, u8)>,
    order: SymbolicCholesky<usize>,
}

/// `A = L L^T` of a matrix with some [`BlockPattern`], with memory that its next factor uses again:
/// at this size the system would map and clear it anew each time.
#[derive(Default)]
pub struct BlockFactor {
    values: Vec<f64>,
    factor: Vec<f64>,
    scratch: Option<MemBuffer>,
}

impl std::fmt::Debug for BlockFactor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BlockFactor({} numbers)", self.factor.len())
    }
}

impl std::fmt::Debug for BlockPattern {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BlockPattern({} rows, {} blocks)", self.rows(), self.columns.len())
    }
}

impl BlockPattern {
    /// Analyses the symmetric sparsity of a matrix that has its diagonal.
    ///
    /// # Errors
    /// [`CholeskyError::Structure`]: not enough memory.
    pub fn new(row_start: &[u32], columns: &[u32]) -> Result<BlockPattern, CholeskyError> {
        let rows = row_start.len() - 1;
        let (mut starts, mut indices, mut source) = (vec![0usize], Vec::new(), Vec::new());
        for row in 0..rows {
            // Column c of the lower triangle is row c of the upper one.
            for c in 0..3 {
                for k in row_start[row] as usize..row_start[row + 1] as usize {
                    let other = columns[k] as usize;
                    for r in 0..3 {
                        if (other, r) >= (row, c) {
                            indices.push(3 * other + r);
                            source.push((k as u32, (3 * c + r) as u8));
                        }
                    }
                }
                starts.push(indices.len());
            }
        }
        let size = 3 * rows;
        let structure = |reason: String| CholeskyError::Structure { size, reason };
        let lower = SymbolicSparseColMat::new_checked(size, size, starts, None, indices);
        let order =
            factorize_symbolic_cholesky(lower.as_ref(), Side::Lower, Default::default(), Default::default())
                .map_err(|e| structure(format!("{e:?}")))?;
        Ok(BlockPattern { row_start: row_start.to_vec(), columns: columns.to_vec(), lower, source, order })
    }

    /// Number of block rows.
    pub fn rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Place of block (`row`, `column`), if it is part of the sparsity.
    pub fn slot(&self, row: u32, column: u32) -> Option<usize> {
        let (first, last) =
            (self.row_start[row as usize] as usize, self.row_start[row as usize + 1] as usize);
        self.columns[first..last].binary_search(&column).ok().map(|k| first + k)
    }

    /// Adds `factor` times a value of each row to the diagonal of its diagonal block.
    ///
    /// # Panics
    /// If a row has no diagonal block.
    pub fn add_to_diagonal(&self, blocks: &mut [Block], values: &[f64], factor: f64) {
        for (row, value) in (0..).zip(values) {
            let at = self.slot(row, row).expect("a diagonal");
            [0, 4, 8].iter().for_each(|&k| blocks[at][k] += factor * value);
        }
    }

    /// Factors the matrix with these blocks, shape `[blocks]`, into `factor`.
    ///
    /// # Errors
    /// [`Indefinite`]: it is not positive definite, or not finite; `factor` is undefined then.
    pub fn factor(&self, blocks: &[Block], factor: &mut BlockFactor) -> Result<(), Indefinite> {
        factor.values.clear();
        factor.values.extend(self.source.iter().map(|&(k, at)| blocks[k as usize][at as usize]));
        factor.factor.resize(self.order.len_val(), 0.0);
        let parallel = ONE;
        let needed = self.order.factorize_numeric_llt_scratch::<f64>(parallel, Default::default());
        let done = self.order.factorize_numeric_llt(
            &mut factor.factor,
            SparseColMatRef::new(self.lower.as_ref(), &factor.values),
            Side::Lower,
            Default::default(),
            parallel,
            MemStack::new(factor.scratch.get_or_insert_with(|| MemBuffer::new(needed))),
            Default::default(),
        );
        done.map(|_| ()).map_err(|LltError::NonPositivePivot { index }| {
            // Simplicial factors count from one.
            let one = usize::from(matches!(self.order.raw(), SymbolicCholeskyRaw::Simplicial(_)));
            let place = index.saturating_sub(one).min(3 * self.rows() - 1);
            let column = self.order.perm().map_or(place, |order| order.arrays().0[place]);
            Indefinite { row: (column / 3) as u32 }
        })
    }

    /// The solution of `A x = b` with the matrix that was factored last into `factor`.
    pub fn solve(&self, factor: &mut BlockFactor, b: &[Vec3]) -> Vec<Vec3> {
        let mut x: Vec<f64> = b.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        let (count, parallel) = (x.len(), ONE);
        let needed = self.order.solve_in_place_scratch::<f64>(1, parallel);
        LltRef::new(&self.order, &factor.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut x, count, 1),
            parallel,
            MemStack::new(&mut MemBuffer::new(needed)),
        );
        x.chunks(3).map(|c| Vec3::new(c[0], c[1], c[2])).collect()
    }

    /// Adds the matrix with these blocks, times `x`, to `y`.
    pub fn add_product(&self, blocks: &[Block], x: &[Vec3], y: &mut [Vec3]) {
        for row in 0..self.rows() {
            for k in self.row_start[row] as usize..self.row_start[row + 1] as usize {
                y[row] += product(&blocks[k], &x[self.columns[k] as usize]);
            }
        }
    }
}

/// A block times a vector.
pub fn product(b: &Block, v: &Vec3) -> Vec3 {
    Vec3::new(
        b[0] * v.x + b[1] * v.y + b[2] * v.z,
        b[3] * v.x + b[4] * v.y + b[5] * v.z,
        b[6] * v.x + b[7] * v.y + b[8] * v.z,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_what_it_multiplies() {
        // A chain of nodes with springs along random directions, and a little mass.
        let n = 40u32;
        let (mut starts, mut columns) = (vec![0u32], Vec::new());
        for i in 0..n {
            columns.extend(i.saturating_sub(2)..(i + 3).min(n));
            starts.push(columns.len() as u32);
        }
        let pattern = BlockPattern::new(&starts, &columns).unwrap();
        let mut blocks = vec![[0.0; 9]; columns.len()];
        let mut add = |i: u32, j: u32, b: &nalgebra::Matrix3<f64>| {
            let at = pattern.slot(i, j).unwrap();
            (0..9).for_each(|k| blocks[at][k] += b[(k / 3, k % 3)]);
        };
        for i in 0..n {
            add(i, i, &(nalgebra::Matrix3::identity() * 1e-3));
            for j in i + 1..(i + 3).min(n) {
                let d = Vec3::new(f64::from(i).sin(), f64::from(j).cos(), 0.3);
                let b = d * d.transpose();
                for (r, c, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
                    add(r, c, &(b * sign));
                }
            }
        }
        let x: Vec<Vec3> =
            (0..n).map(|i| Vec3::new(f64::from(i).sin(), 1.0, f64::from(i * i).cos())).collect();
        let mut right = vec![Vec3::zeros(); n as usize];
        pattern.add_product(&blocks, &x, &mut right);
        let mut factor = BlockFactor::default();
        pattern.factor(&blocks, &mut factor).unwrap();
        let solved = pattern.solve(&mut factor, &right);
        for (a, b) in solved.iter().zip(&x) {
            assert!((a - b).norm() < 1e-9, "{a} {b}");
        }
        assert!(pattern.slot(0, 9).is_none());
        blocks[0] = [-1.0; 9];
        assert_eq!(pattern.factor(&blocks, &mut factor), Err(Indefinite { row: 0 }));
    }
}
