//! Two-level preconditioner by smoothed aggregation [Vanek, Mandel and Brezina 1996].
//!
//! Nodes are gathered in patches of a matrix row's neighbours. A coarse unknown moves its patch as a
//! rigid body, as it lies now: translation `t` and turn `w`, so that node i has the tentative row
//! `P0_i = [I, -[r_i]x]` with `r_i` its arm from the patch's centre. Rigid motion of the whole cloth,
//! which costs no elastic energy, is among them. One damped block-Jacobi step on its columns makes
//! them smooth, `P = (I - w D^-1 A) P0`. A cycle is a forward sweep of block Gauss-Seidel, the
//! coarse matrix `P^T A P` solved by its Cholesky factor, and a backward sweep.

use nalgebra::{Matrix3, Matrix6, SMatrix};

use super::block_cholesky::{Block, BlockFactor, BlockPattern, Indefinite};
use crate::model::Vec3;

/// A node's rows of the prolongation for one patch.
type Arm = SMatrix<f64, 3, 6>;

/// Stands for "no patch".
const NONE: u32 = u32::MAX;
/// Times that the spectral radius of `D^-1 A` is bettered at each matrix, from where it was.
const POWER_ITERATIONS: usize = 3;
/// Share of the mean of a coarse matrix' turning stiffness that is added to it: a patch whose nodes
/// lie in line has a turn that moves none of them.
const TURN: f64 = 1e-8;

/// Rows of blocks.
#[derive(Clone, Debug, Default)]
struct Rows<T> {
    start: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T> Rows<T> {
    fn row(&self, i: usize) -> impl Iterator<Item = (usize, &T)> {
        let range = self.start[i]..self.start[i + 1];
        self.columns[range.clone()].iter().map(|&c| c as usize).zip(&self.values[range])
    }
}

/// The inverse of a matrix' diagonal blocks.
#[derive(Debug)]
pub struct BlockJacobi(Vec<Matrix3<f64>>);

impl BlockJacobi {
    /// Of the matrix with these blocks.
    ///
    /// # Errors
    /// [`Indefinite`]: a diagonal block is singular.
    pub fn new(pattern: &BlockPattern, blocks: &[Block]) -> Result<BlockJacobi, Indefinite> {
        let inverse = |row: u32| {
            let at = pattern.slot(row, row).ok_or(Indefinite { row })?;
            Matrix3::from_row_slice(&blocks[at]).try_inverse().ok_or(Indefinite { row })
        };
        Ok(BlockJacobi((0..pattern.rows() as u32).map(inverse).collect::<Result<_, _>>()?))
    }

    /// These inverses times `r`.
    pub fn apply(&self, r: &[Vec3]) -> Vec<Vec3> {
        self.0.iter().zip(r).map(|(block, r)| block * r).collect()
    }
}

/// The two levels of a matrix.
#[derive(Debug)]
pub struct TwoLevel {
    patch: Vec<u32>,
    patches: usize,
    matrix: Rows<Matrix3<f64>>,
    inverse: BlockJacobi,
    /// The vector that the spectral radius was found with.
    largest: Vec<Vec3>,
    prolongation: Rows<Arm>,
    coarse: Option<BlockPattern>,
    factor: BlockFactor,
}

/// Patches over the nodes that are not held: rows whose neighbours are all free for the taking, with
/// them, then what is left over to a patch beside it.
fn patches(pattern: &BlockPattern, held: &[bool]) -> (Vec<u32>, usize) {
    let mut patch = vec![NONE; held.len()];
    let mut count = 0;
    let neighbours = |i: usize| {
        let range = pattern.row_start[i] as usize..pattern.row_start[i + 1] as usize;
        pattern.columns[range].iter().map(|&j| j as usize).filter(|&j| !held[j])
    };
    for i in (0..held.len()).filter(|&i| !held[i]) {
        if neighbours(i).all(|j| patch[j] == NONE) {
            neighbours(i).for_each(|j| patch[j] = count);
            count += 1;
        }
    }
    let first = patch.clone();
    for i in (0..held.len()).filter(|&i| !held[i] && first[i] == NONE) {
        // It has one, or it had made its own.
        patch[i] = neighbours(i).map(|j| first[j]).find(|&p| p != NONE).unwrap_or(NONE);
    }
    (patch, count as usize)
}

impl TwoLevel {
    /// For matrices of this sparsity, of nodes some of which are held.
    pub fn new(pattern: &BlockPattern, held: &[bool]) -> TwoLevel {
        let (patch, patches) = patches(pattern, held);
        let start = pattern.row_start.iter().map(|&s| s as usize).collect();
        let matrix = Rows { start, columns: pattern.columns.clone(), values: Vec::new() };
        let uneven = |i: usize| Vec3::new(i as f64, 2.0 * i as f64 + 1.0, 3.0 * i as f64 + 2.0).map(f64::sin);
        TwoLevel {
            largest: (0..held.len()).map(uneven).collect(),
            patch,
            patches,
            matrix,
            inverse: BlockJacobi(Vec::new()),
            prolongation: Rows::default(),
            coarse: None,
            factor: BlockFactor::default(),
        }
    }

    /// Takes a matrix, its nodes at `x` [m].
    ///
    /// # Errors
    /// [`Indefinite`]: it is not positive definite; what was set is undefined then.
    pub fn set(&mut self, pattern: &BlockPattern, blocks: &[Block], x: &[Vec3]) -> Result<(), Indefinite> {
        self.matrix.values = blocks.iter().map(|b| Matrix3::from_row_slice(b)).collect();
        self.inverse = BlockJacobi::new(pattern, blocks)?;
        let damping = 4.0 / (3.0 * self.spectral_radius());
        self.prolongation = self.smoothed(&self.tentative(x), damping);
        self.factor_coarse()
    }

    /// Of `D^-1 A`, by power iteration.
    fn spectral_radius(&mut self) -> f64 {
        let mut radius = 1.0;
        for _ in 0..POWER_ITERATIONS {
            let next = self.inverse.apply(&self.product(&self.largest));
            radius = (norm(&next) / norm(&self.largest)).max(f64::MIN_POSITIVE);
            self.largest = next.iter().map(|v| v / radius).collect();
        }
        radius
    }

    fn product(&self, x: &[Vec3]) -> Vec<Vec3> {
        (0..x.len()).map(|i| self.matrix.row(i).map(|(j, a)| a * x[j]).sum()).collect()
    }

    /// `P0_i` for each node; 0 where it is in no patch.
    fn tentative(&self, x: &[Vec3]) -> Vec<Arm> {
        let mut centres = vec![(Vec3::zeros(), 0.0); self.patches];
        let patched = || self.patch.iter().zip(x).filter(|(p, _)| **p != NONE);
        for (&patch, x) in patched() {
            let (sum, count) = &mut centres[patch as usize];
            *sum += x;
            *count += 1.0;
        }
        let mut arms = vec![Arm::zeros(); x.len()];
        for (i, &patch) in self.patch.iter().enumerate().filter(|(_, p)| **p != NONE) {
            let (sum, count) = centres[patch as usize];
            arms[i].fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            arms[i].fixed_view_mut::<3, 3>(0, 3).copy_from(&-(x[i] - sum / count).cross_matrix());
        }
        arms
    }

    /// `(I - damping D^-1 A) P0`.
    fn smoothed(&self, tentative: &[Arm], damping: f64) -> Rows<Arm> {
        let mut row = Row::new(self.patches);
        let mut rows = Rows { start: vec![0], ..Rows::default() };
        for i in 0..tentative.len() {
            for (j, a) in self.matrix.row(i).filter(|(j, _)| self.patch[*j] != NONE) {
                let moved = self.inverse.0[i] * (a * tentative[j]) * -damping;
                *row.at(self.patch[j]) += if i == j { moved + tentative[j] } else { moved };
            }
            row.move_to(&mut rows);
        }
        rows
    }

    /// Factors `P^T A P`.
    fn factor_coarse(&mut self) -> Result<(), Indefinite> {
        let coarse = self.galerkin();
        let (starts, columns, blocks) = halves(&coarse);
        if self.coarse.is_none() {
            self.coarse = BlockPattern::new(&starts, &columns).ok();
        }
        let pattern = self.coarse.as_ref().ok_or(Indefinite { row: 0 })?;
        pattern.factor(&blocks, &mut self.factor)
    }

    fn galerkin(&self) -> Rows<Matrix6<f64>> {
        let nodes = self.patch.len();
        let mut row = Row::new(self.patches);
        let mut image = Rows { start: vec![0], ..Rows::default() }; // A P
        for i in 0..nodes {
            for (j, a) in self.matrix.row(i) {
                self.prolongation.row(j).for_each(|(patch, p)| *row.at(patch as u32) += a * p);
            }
            row.move_to(&mut image);
        }
        let mut nodes_of_patch = vec![Vec::new(); self.patches];
        for i in 0..nodes {
            self.prolongation.row(i).for_each(|(patch, p)| nodes_of_patch[patch].push((i, p)));
        }
        let mut row = Row::new(self.patches);
        let mut coarse = Rows { start: vec![0], ..Rows::default() };
        for nodes in &nodes_of_patch {
            for (i, p) in nodes {
                image.row(*i).for_each(|(patch, ap)| *row.at(patch as u32) += p.transpose() * ap);
            }
            row.move_to(&mut coarse);
        }
        coarse
    }

    /// A cycle from zero.
    pub fn apply(&mut self, r: &[Vec3]) -> Vec<Vec3> {
        let mut x = vec![Vec3::zeros(); r.len()];
        for i in 0..r.len() {
            let before: Vec3 = self.matrix.row(i).take_while(|(j, _)| *j < i).map(|(j, a)| a * x[j]).sum();
            x[i] = self.inverse.0[i] * (r[i] - before);
        }
        self.correct(r, &mut x);
        for i in (0..r.len()).rev() {
            let image: Vec3 = self.matrix.row(i).map(|(j, a)| a * x[j]).sum();
            x[i] += self.inverse.0[i] * (r[i] - image);
        }
        x
    }

    /// The coarse level's correction.
    fn correct(&mut self, r: &[Vec3], x: &mut [Vec3]) {
        let left: Vec<Vec3> = r.iter().zip(self.product(x)).map(|(r, q)| r - q).collect();
        let mut coarse = vec![Vec3::zeros(); 2 * self.patches];
        for (i, left) in left.iter().enumerate() {
            for (patch, p) in self.prolongation.row(i) {
                let forces = p.transpose() * left;
                coarse[2 * patch] += forces.fixed_rows::<3>(0);
                coarse[2 * patch + 1] += forces.fixed_rows::<3>(3);
            }
        }
        let Some(pattern) = &self.coarse else { return };
        let moves = pattern.solve(&mut self.factor, &coarse);
        for (i, x) in x.iter_mut().enumerate() {
            for (patch, p) in self.prolongation.row(i) {
                *x += p.fixed_columns::<3>(0) * moves[2 * patch]
                    + p.fixed_columns::<3>(3) * moves[2 * patch + 1];
            }
        }
    }
}

/// The coarse matrix by 3x3 blocks: a patch's translation and its turn are two block rows.
fn halves(coarse: &Rows<Matrix6<f64>>) -> (Vec<u32>, Vec<u32>, Vec<Block>) {
    let patches = coarse.start.len() - 1;
    let turning = |i: usize| {
        coarse.row(i).find(|(j, _)| *j == i).map_or(0.0, |(_, a)| a.fixed_view::<3, 3>(3, 3).trace())
    };
    let least = TURN * (0..patches).map(turning).sum::<f64>() / patches as f64;
    let (mut starts, mut columns, mut blocks) = (vec![0], Vec::new(), Vec::new());
    for i in 0..patches {
        for half in 0..2 {
            for (j, a) in coarse.row(i) {
                for other in 0..2 {
                    let mut part: Matrix3<f64> = a.fixed_view::<3, 3>(3 * half, 3 * other).into();
                    if i == j && half + other == 2 {
                        part += Matrix3::identity() * least;
                    }
                    columns.push((2 * j + other) as u32);
                    blocks.push(std::array::from_fn(|k| part[(k / 3, k % 3)]));
                }
            }
            starts.push(columns.len() as u32);
        }
    }
    (starts, columns, blocks)
}

fn norm(x: &[Vec3]) -> f64 {
    x.iter().map(Vec3::norm_squared).sum::<f64>().sqrt()
}

/// A sparse row that is being summed [Gustavson 1978].
struct Row<T> {
    place: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<const N: usize> Row<SMatrix<f64, N, 6>> {
    fn new(columns: usize) -> Self {
        Row { place: vec![NONE; columns], columns: Vec::new(), values: Vec::new() }
    }

    /// The entry of a column.
    fn at(&mut self, column: u32) -> &mut SMatrix<f64, N, 6> {
        let place = &mut self.place[column as usize];
        if *place == NONE {
            *place = self.columns.len() as u32;
            self.columns.push(column);
            self.values.push(SMatrix::zeros());
        }
        &mut self.values[*place as usize]
    }

    /// Becomes the next of `rows`, its columns in order, and is empty again.
    fn move_to(&mut self, rows: &mut Rows<SMatrix<f64, N, 6>>) {
        self.columns.sort_unstable();
        for &column in &self.columns {
            let place = std::mem::replace(&mut self.place[column as usize], NONE);
            rows.columns.push(column);
            rows.values.push(self.values[place as usize]);
        }
        rows.start.push(rows.columns.len());
        self.columns.clear();
        self.values.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `side` nodes to an edge, stiff in its plane and limp out of it, with a little mass.
    fn sheet(side: u32) -> (BlockPattern, Vec<Block>, Vec<Vec3>) {
        let at = |i: u32, j: u32| i * side + j;
        let near = |i: u32, j: u32| {
            let range = |k: u32| k.saturating_sub(1)..(k + 2).min(side);
            range(i).flat_map(move |a| range(j).map(move |b| (a, b)))
        };
        let (mut starts, mut columns) = (vec![0u32], Vec::new());
        for i in 0..side {
            for j in 0..side {
                columns.extend(near(i, j).map(|(a, b)| at(a, b)));
                starts.push(columns.len() as u32);
            }
        }
        let pattern = BlockPattern::new(&starts, &columns).unwrap();
        let mut blocks = vec![[0.0; 9]; columns.len()];
        let mut add = |a: u32, b: u32, m: &Matrix3<f64>| {
            let block = &mut blocks[pattern.slot(a, b).unwrap()];
            (0..9).for_each(|k| block[k] += m[(k / 3, k % 3)]);
        };
        for i in 0..side {
            for j in 0..side {
                let a = at(i, j);
                add(a, a, &(Matrix3::identity() * 1e-3));
                for (k, l) in near(i, j).filter(|&(k, l)| at(k, l) > a) {
                    let along =
                        Vec3::new(f64::from(k) - f64::from(i), f64::from(l) - f64::from(j), 0.0).normalize();
                    let spring = along * along.transpose() + Matrix3::from_diagonal(&Vec3::z()) * 0.01;
                    let b = at(k, l);
                    for (r, c, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                        add(r, c, &(spring * sign));
                    }
                }
            }
        }
        let places = (0..side * side).map(|n| Vec3::new(f64::from(n / side), f64::from(n % side), 0.0));
        let places = places.collect();
        (pattern, blocks, places)
    }

    /// Iterations of conjugate gradients to a millionth of the residual.
    fn iterations(side: u32) -> usize {
        let (pattern, blocks, places) = sheet(side);
        let mut levels = TwoLevel::new(&pattern, &vec![false; places.len()]);
        levels.set(&pattern, &blocks, &places).unwrap();
        let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let uneven =
            |i: usize| Vec3::new((7 * i) as f64, (5 * i + 1) as f64, (3 * i + 2) as f64).map(f64::sin);
        let mut r: Vec<Vec3> = (0..places.len()).map(uneven).collect();
        let other: Vec<Vec3> = (0..places.len()).map(|i| uneven(i * i + 11)).collect();
        let (one, two) = (dot(&other, &levels.apply(&r)), dot(&r, &levels.apply(&other)));
        assert!((one - two).abs() < 1e-9 * one.abs().max(1.0), "not symmetric: {one} {two}");
        let first = norm(&r);
        let mut z = levels.apply(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        for turn in 1..200 {
            let mut q = vec![Vec3::zeros(); r.len()];
            pattern.add_product(&blocks, &p, &mut q);
            let alpha = rz / dot(&p, &q);
            assert!(alpha > 0.0, "{alpha}");
            r.iter_mut().zip(&q).for_each(|(r, q)| *r -= q * alpha);
            if norm(&r) < 1e-6 * first {
                return turn;
            }
            z = levels.apply(&r);
            let next = dot(&r, &z);
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + *p * (next / rz));
            rz = next;
        }
        panic!("not solved")
    }

    #[test]
    fn iterations_hardly_grow_with_the_nodes() {
        let (few, many) = (iterations(16), iterations(48));
        assert!(few < 40 && many as f64 <= 1.5 * few as f64, "{few} {many}");
    }

    #[test]
    fn an_indefinite_matrix_is_told() {
        let (pattern, mut blocks, places) = sheet(8);
        let at = pattern.slot(20, 20).unwrap();
        blocks[at] = [-50.0, 0.0, 0.0, 0.0, -50.0, 0.0, 0.0, 0.0, -50.0];
        let mut levels = TwoLevel::new(&pattern, &vec![false; places.len()]);
        assert!(levels.set(&pattern, &blocks, &places).is_err());
    }
}
