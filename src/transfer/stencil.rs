//! The system matrix `S = A + B^T (gamma M_p)^-1 B`, as a 27-point stencil of 3x3 blocks.
//!
//! A node's row depends on the element matrices of the eight cells around it and on the
//! boundary condition in them. Few combinations of matrices occur, so the rows of viscosity
//! and volume are shared *patterns*, made once; the boundary's part is a scalar mass (the
//! same for all three components) that only nodes of cut cells have. Against a block-sparse
//! matrix this moves a tenth of the memory and leaves nothing to assemble in regular cells.

use std::collections::HashMap;

use bytemuck::{Pod, Zeroable};
use nalgebra::Matrix3;
use rayon::prelude::*;

use super::domain::{Domain, NONE};
use super::element::corner;
use super::terms::Terms;
use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};
use crate::solve::cg::Operator;

/// Row products, for kernels that declare the matrix' buffers and `x`.
pub(super) const ROW_WGSL: &str = include_str!("row.wgsl");
/// Neighbours of a node, itself included; `SLOTS` in row.wgsl.
pub const SLOTS: usize = 27;
/// The slot of the node itself.
const CENTRE: usize = 13;
/// Nodes that a CPU task takes.
const GRAIN: usize = 512;

/// A pattern: 27 blocks, each as three columns padded to four.
pub type Pattern = [[[f32; 4]; 3]; SLOTS];

/// `struct Nodes` in stencil.wgsl and residual.wgsl, `struct Cells` in pressure.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Extent {
    /// Invocations.
    pub n: u32,
    /// A coefficient of the kernel.
    pub coefficient: f32,
    /// A second coefficient.
    pub second: f32,
    pub pad: u32,
}

pub(super) static STENCIL: Kernel = Kernel {
    name: "transfer_stencil",
    wgsl: &[INDEX_WGSL, include_str!("stencil.wgsl"), ROW_WGSL],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stencil_multiply,
};

fn stencil_multiply(args: &mut HostArgs<'_>) {
    let matrix = Rows::of(args);
    let x = args.read::<[f32; 3]>(4);
    let y = args.write::<[f32; 3]>(5);
    y.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, y)| {
        for (k, y) in y.iter_mut().enumerate() {
            *y = matrix.multiply(chunk * GRAIN + k, x);
        }
    });
}

/// The matrix' rows as a CPU twin sees them: the first four buffers of its kernel.
pub(super) struct Rows<'a> {
    neighbours: &'a [[u32; SLOTS]],
    rows: &'a [[u32; 2]],
    patterns: &'a [Pattern],
    mass: &'a [[f32; SLOTS]],
}

impl<'a> Rows<'a> {
    pub fn of(args: &HostArgs<'a>) -> Rows<'a> {
        Rows { neighbours: args.read(0), rows: args.read(1), patterns: args.read(2), mass: args.read(3) }
    }

    /// Row `i` times `x`.
    #[inline(always)]
    pub fn multiply(&self, i: usize, x: &[[f32; 3]]) -> [f32; 3] {
        let (around, [pattern, row]) = (&self.neighbours[i], self.rows[i]);
        let mut sum = multiply_blocks(&self.patterns[pattern as usize], around, x);
        if row != NONE {
            add_mass(&mut sum, &self.mass[row as usize], around, x);
        }
        [sum[0], sum[1], sum[2]]
    }
}

/// The sum of a pattern's blocks times the neighbours' vectors; columns are padded to four
/// so that one vector instruction takes a column. Not inlined: a caller that drops the
/// padding would let the compiler split the columns up again (measured twice as slow).
#[inline(never)]
fn multiply_blocks(blocks: &Pattern, around: &[u32; SLOTS], x: &[[f32; 3]]) -> [f32; 4] {
    let mut sums = [[0.0f32; 4]; 3];
    for (block, &j) in blocks.iter().zip(around) {
        let v = x[j as usize];
        for c in 0..3 {
            let scaled: [f32; 4] = std::array::from_fn(|l| block[c][l] * v[c]);
            sums[c] = std::array::from_fn(|l| sums[c][l] + scaled[l]);
        }
    }
    std::array::from_fn(|l| sums[0][l] + sums[1][l] + sums[2][l])
}

#[inline(always)]
fn add_mass(sum: &mut [f32; 4], mass: &[f32; SLOTS], around: &[u32; SLOTS], x: &[[f32; 3]]) {
    for (&m, &j) in mass.iter().zip(around) {
        let v = x[j as usize];
        for l in 0..3 {
            sum[l] += m * v[l];
        }
    }
}

/// The matrix on a device.
#[derive(Debug)]
pub struct Stencil {
    pub(super) nodes: usize,
    pub(super) neighbours: Buffer<[u32; SLOTS]>,
    pub(super) rows: Buffer<[u32; 2]>,
    pub(super) patterns: Buffer<Pattern>,
    pub(super) mass: Buffer<[f32; SLOTS]>,
    /// The inverse of each node's own block, by rows.
    pub(super) diagonal_inverse: Buffer<[f32; 9]>,
}

/// The slot of local node `b` among the neighbours of local node `a`.
pub fn slot(a: usize, b: usize) -> usize {
    let (ca, cb) = (corner(a), corner(b));
    (0..3).fold(0, |s, d| 3 * s + (cb[d] + 1 - ca[d]))
}

/// A node's 27 blocks from the elements of the cells around it.
fn blocks_of(terms: &Terms, elements: [u32; 8]) -> [Matrix3<f64>; SLOTS] {
    let mut blocks = [Matrix3::zeros(); SLOTS];
    for (o, &element) in elements.iter().enumerate() {
        if element != NONE {
            let a = 7 - o;
            for b in 0..8 {
                blocks[slot(a, b)] += terms.elements[element as usize].fixed_view::<3, 3>(3 * a, 3 * b);
            }
        }
    }
    blocks
}

/// The boundary's mass by rows: the row of each node, [`NONE`] where it has none, and the
/// couplings to its 27 neighbours.
fn mass_rows(domain: &Domain, terms: &Terms) -> (Vec<u32>, Vec<[f64; SLOTS]>) {
    let (mut row_of_node, mut rows) = (vec![NONE; domain.nodes.len()], Vec::new());
    for (cell, mass) in &terms.masses {
        for (a, &node) in domain.cell_nodes[*cell as usize].iter().enumerate() {
            let row = &mut row_of_node[node as usize];
            if *row == NONE {
                *row = rows.len() as u32;
                rows.push([0.0; SLOTS]);
            }
            for b in 0..8 {
                rows[*row as usize][slot(a, b)] += mass[a][b];
            }
        }
    }
    (row_of_node, rows)
}

fn pack(blocks: &[Matrix3<f64>; SLOTS]) -> Pattern {
    let entry = |k: usize, c: usize, r: usize| if r < 3 { blocks[k][(r, c)] as f32 } else { 0.0 };
    std::array::from_fn(|k| std::array::from_fn(|c| std::array::from_fn(|r| entry(k, c, r))))
}

impl Stencil {
    /// Builds the matrix; rows of `fixed` nodes (if any) are the identity's.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(
        device: &Device,
        domain: &Domain,
        terms: &Terms,
        fixed: &[bool],
    ) -> Result<Stencil, DeviceError> {
        let nodes = domain.nodes.len();
        let mut identity = [Matrix3::zeros(); SLOTS];
        identity[CENTRE] = Matrix3::identity();
        let mut patterns = vec![pack(&identity)];
        let mut centres = vec![Matrix3::identity()];
        let mut pattern_of_elements = HashMap::new();
        let (row_of_node, mass) = mass_rows(domain, terms);
        let mut rows = Vec::with_capacity(nodes);
        let mut inverse = Vec::with_capacity(nodes);
        for i in 0..nodes {
            if fixed.get(i) == Some(&true) {
                rows.push([0, NONE]);
                inverse.push(flat(&Matrix3::identity()));
                continue;
            }
            let elements = domain.node_cells[i]
                .map(|c| if c == NONE { NONE } else { terms.element_of_cell[c as usize] });
            let pattern = *pattern_of_elements.entry(elements).or_insert_with(|| {
                let blocks = blocks_of(terms, elements);
                patterns.push(pack(&blocks));
                centres.push(blocks[CENTRE]);
                patterns.len() - 1
            });
            let row = row_of_node[i];
            rows.push([pattern as u32, row]);
            let mut block = centres[pattern];
            if row != NONE {
                block += Matrix3::identity() * mass[row as usize][CENTRE];
            }
            // A block is positive definite (a cell's viscosity leaves only rigid motions
            // free), but for a coarse node between fixed ones, which nothing moves.
            inverse.push(flat(&block.try_inverse().unwrap_or_else(Matrix3::identity)));
        }
        let mut mass: Vec<[f32; SLOTS]> = mass.iter().map(|row| row.map(|m| m as f32)).collect();
        if mass.is_empty() {
            mass.push([0.0; SLOTS]); // a buffer holds something
        }
        Ok(Stencil {
            nodes,
            neighbours: device.upload("transfer neighbours", &domain.neighbours())?,
            rows: device.upload("transfer rows", &rows)?,
            patterns: device.upload("transfer patterns", &patterns)?,
            mass: device.upload("transfer boundary mass", &mass)?,
            diagonal_inverse: device.upload("transfer diagonal", &inverse)?,
        })
    }
}

impl Stencil {
    /// Memory on the device [bytes].
    pub fn bytes(&self) -> usize {
        let per_node = size_of::<[u32; SLOTS]>() + size_of::<[u32; 2]>() + size_of::<[f32; 9]>();
        let patterns = self.patterns.len() * size_of::<Pattern>();
        self.nodes * per_node + patterns + self.mass.len() * size_of::<[f32; SLOTS]>()
    }
}

fn flat(m: &Matrix3<f64>) -> [f32; 9] {
    std::array::from_fn(|k| m[(k / 3, k % 3)] as f32)
}

impl Operator for Stencil {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        let extent = Extent { n: self.nodes as u32, coefficient: 0.0, second: 0.0, pad: 0 };
        let buffers: [&dyn crate::device::AnyBuffer; 6] =
            [&self.neighbours, &self.rows, &self.patterns, &self.mass, x, y];
        device.run(&STENCIL, self.nodes, &extent, &buffers)
    }
}
