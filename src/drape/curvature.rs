//! The cloth's negative curvature, put back into the matrix where that stays positive definite.
//!
//! The device's matrix leaves out what could make it indefinite. A factor tells whether it would
//! and about where, so the true second derivatives are taken everywhere but around such places
//! [cf. Longva et al. 2023, Pitfalls of Projection, which decides for the matrix as a whole]:
//! buckled cloth has directions in which the projected matrix is many times too stiff.

use super::elastic::Elastic;
use crate::model::Vec3;
use crate::solve::block_cholesky::{Block, BlockFactor, BlockPattern};

/// Times that a matrix is mended before it is projected everywhere.
const MOST_MENDINGS: usize = 6;
/// Fewest and most solves that a node's elements stay projected after they were found in the way.
const REST: [u16; 2] = [4, 64];

/// Which elements' true second derivatives are left out, and for how long.
#[derive(Debug)]
pub struct Curvature {
    /// First block of each element of [`Elastic::soften`], and the number of blocks.
    starts: Vec<u32>,
    /// Where each block is in the matrix.
    places: Vec<u32>,
    /// First of each node's elements in `elements`.
    node_starts: Vec<u32>,
    elements: Vec<u32>,
    rests: Vec<Rest>,
}

/// How long a node's elements stay projected.
#[derive(Clone, Copy, Debug, Default)]
struct Rest {
    /// Solves to go.
    left: u16,
    /// How many they were last time.
    last: u16,
}

/// What is put back, block by block, and of which elements.
struct Blocks {
    values: Vec<Block>,
    taken: Vec<bool>,
}

impl Curvature {
    /// For matrices of this sparsity; `None` if it has no room.
    pub fn new(pattern: &BlockPattern, elastic: &Elastic) -> Option<Curvature> {
        let place = |[row, column]: [u32; 2]| pattern.slot(row, column).map(|at| at as u32);
        let places = elastic.softened().map(place).collect::<Option<Vec<u32>>>()?;
        let (mut starts, mut by_node) = (vec![0], vec![Vec::new(); pattern.rows()]);
        for (e, nodes) in elastic.softened_elements().enumerate() {
            starts.push(starts[e] + (nodes.len() * nodes.len()) as u32);
            nodes.iter().for_each(|&n| by_node[n as usize].push(e as u32));
        }
        let mut node_starts = vec![0];
        node_starts.extend(by_node.iter().scan(0, |sum, list| {
            *sum += list.len() as u32;
            Some(*sum)
        }));
        let rests = vec![Rest::default(); pattern.rows()];
        Some(Curvature { starts, places, node_starts, elements: by_node.concat(), rests })
    }

    /// Puts what keeps `blocks` positive definite into them and factors them; whether that
    /// succeeded. If not, they are as they were.
    pub fn put_back(
        &mut self,
        pattern: &BlockPattern,
        blocks: &mut Vec<Block>,
        elastic: &Elastic,
        vertices: &[Vec3],
        factor: &mut BlockFactor,
    ) -> bool {
        let mut trial = blocks.clone();
        let mut left_out = self.left_out(elastic, vertices);
        (0..left_out.taken.len()).filter(|&e| left_out.taken[e]).for_each(|e| {
            self.add(&mut trial, &left_out.values, e, 1.0);
        });
        let mut mendings = 0;
        let done = loop {
            match pattern.factor(&trial, factor) {
                Ok(()) => break true,
                Err(_) if mendings == MOST_MENDINGS => break false,
                Err(at) => self.mend(pattern, &mut trial, &mut left_out, at.row, mendings),
            }
            mendings += 1;
        };
        if done {
            self.rests.iter_mut().filter(|r| r.left == 0).for_each(|r| r.last /= 2);
            *blocks = trial;
        }
        done
    }

    /// Puts all of it into `blocks`, which need not stay positive definite.
    pub fn put_back_all(&self, blocks: &mut [Block], elastic: &Elastic, vertices: &[Vec3]) {
        let mut places = self.places.iter();
        elastic.soften(vertices, &mut |b| {
            let Some(&at) = places.next() else { return };
            (0..9).for_each(|k| blocks[at as usize][k] += b[(k / 3, k % 3)]);
        });
    }

    /// All elements' blocks, and which of them no resting node has.
    fn left_out(&mut self, elastic: &Elastic, vertices: &[Vec3]) -> Blocks {
        let mut values = Vec::with_capacity(self.places.len());
        elastic.soften(vertices, &mut |b| {
            values.push([b.m11, b.m12, b.m13, b.m21, b.m22, b.m23, b.m31, b.m32, b.m33]);
        });
        let mut taken = vec![true; self.starts.len() - 1];
        for node in 0..self.rests.len() {
            if self.rests[node].left > 0 {
                self.rests[node].left -= 1;
                self.of(node).iter().for_each(|&e| taken[e as usize] = false);
            }
        }
        Blocks { values, taken }
    }

    /// Takes what is around `row` out again; each time wider.
    fn mend(
        &mut self,
        pattern: &BlockPattern,
        blocks: &mut [Block],
        left_out: &mut Blocks,
        row: u32,
        width: usize,
    ) {
        let mut around = vec![row];
        for _ in 0..1 + width / 2 {
            let wider = around.iter().flat_map(|&n| {
                let (first, last) = (pattern.row_start[n as usize], pattern.row_start[n as usize + 1]);
                &pattern.columns[first as usize..last as usize]
            });
            around = wider.copied().collect();
            around.sort_unstable();
            around.dedup();
        }
        for node in around {
            let rest = &mut self.rests[node as usize];
            rest.last = (2 * rest.last).clamp(REST[0], REST[1]);
            rest.left = rest.last;
            for &e in self.of(node as usize) {
                if std::mem::replace(&mut left_out.taken[e as usize], false) {
                    self.add(blocks, &left_out.values, e as usize, -1.0);
                }
            }
        }
    }

    fn of(&self, node: usize) -> &[u32] {
        &self.elements[self.node_starts[node] as usize..self.node_starts[node + 1] as usize]
    }

    fn add(&self, blocks: &mut [Block], values: &[Block], element: usize, sign: f64) {
        for at in self.starts[element] as usize..self.starts[element + 1] as usize {
            let block = &mut blocks[self.places[at] as usize];
            (0..9).for_each(|k| block[k] += sign * values[at][k]);
        }
    }
}
