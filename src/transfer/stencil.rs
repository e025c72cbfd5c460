//! The system matrix `S = A + B^T (gamma M_p)^-1 B`, as a 27-point stencil of 3x3 blocks.
//!
//! A node's row depends on the kinds of the eight cells around it and on the boundary
//! condition in them. Few combinations of kinds occur, so the rows of viscosity and volume
//! are shared *patterns*, made once; the boundary's part is a scalar mass (the same for all
//! three components) that only nodes of cut cells have. Against a block-sparse matrix this
//! moves a tenth of the memory and leaves nothing to assemble in regular cells.

use std::collections::HashMap;

use bytemuck::{Pod, Zeroable};
use nalgebra::Matrix3;
use rayon::prelude::*;

use super::boundary::Boundary;
use super::domain::{Domain, Kind, NONE};
use super::element::{self, ElementMatrix, corner};
use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};
use crate::solve::bsr::BlockDiagonal;
use crate::solve::cg::Operator;

/// Neighbours of a node, itself included; `SLOTS` in stencil.wgsl.
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
    wgsl: &[INDEX_WGSL, include_str!("stencil.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stencil_multiply,
};

fn stencil_multiply(args: &mut HostArgs<'_>) {
    let (neighbours, rows) = (args.read::<[u32; SLOTS]>(0), args.read::<[u32; 2]>(1));
    let (patterns, mass) = (args.read::<Pattern>(2), args.read::<[f32; SLOTS]>(3));
    let x = args.read::<[f32; 3]>(4);
    let y = args.write::<[f32; 3]>(5);
    y.par_chunks_mut(GRAIN).zip(neighbours.par_chunks(GRAIN).zip(rows.par_chunks(GRAIN))).for_each(
        |(y, (neighbours, rows))| {
            for (y, (around, &[pattern, row])) in y.iter_mut().zip(neighbours.iter().zip(rows)) {
                let mut sum = multiply_blocks(&patterns[pattern as usize], around, x);
                if row != NONE {
                    add_mass(&mut sum, &mass[row as usize], around, x);
                }
                *y = [sum[0], sum[1], sum[2]];
            }
        },
    );
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
    nodes: usize,
    neighbours: Buffer<[u32; SLOTS]>,
    rows: Buffer<[u32; 2]>,
    patterns: Buffer<Pattern>,
    mass: Buffer<[f32; SLOTS]>,
    /// The inverse of the diagonal blocks.
    pub diagonal_inverse: BlockDiagonal,
}

/// Element matrices of the kinds of cells.
#[derive(Clone, Debug)]
pub struct Elements {
    deep: ElementMatrix,
    open: ElementMatrix,
}

impl Elements {
    /// For cells of side `h` [m], viscosity `nu` and compliance `gamma`.
    pub fn new(h: f64, nu: f64, gamma: f64) -> Elements {
        let deep = element::viscous(h, nu);
        Elements { deep, open: deep + element::schur(h, gamma) }
    }

    fn of(&self, kind: Kind) -> &ElementMatrix {
        match kind {
            Kind::Deep => &self.deep,
            Kind::Open => &self.open,
        }
    }
}

/// The slot of local node `b` among the neighbours of local node `a`.
pub fn slot(a: usize, b: usize) -> usize {
    let (ca, cb) = (corner(a), corner(b));
    (0..3).fold(0, |s, d| 3 * s + (cb[d] + 1 - ca[d]))
}

/// A node's 27 blocks from the kinds of the cells around it.
fn blocks_of(elements: &Elements, kinds: [Option<Kind>; 8]) -> [Matrix3<f64>; SLOTS] {
    let mut blocks = [Matrix3::zeros(); SLOTS];
    for (o, kind) in kinds.iter().enumerate() {
        let Some(kind) = kind else { continue };
        let a = 7 - o;
        for b in 0..8 {
            let entry = elements.of(*kind).fixed_view::<3, 3>(3 * a, 3 * b);
            blocks[slot(a, b)] += entry;
        }
    }
    blocks
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
        elements: &Elements,
        boundary: &Boundary,
        fixed: &[bool],
    ) -> Result<Stencil, DeviceError> {
        let nodes = domain.nodes.len();
        let mut identity = [Matrix3::zeros(); SLOTS];
        identity[CENTRE] = Matrix3::identity();
        let mut patterns = vec![pack(&identity)];
        let mut centres = vec![Matrix3::identity()];
        let mut pattern_of_kinds = HashMap::new();
        let mut rows = Vec::with_capacity(nodes);
        let mut diagonal_inverse = Vec::with_capacity(nodes);
        for i in 0..nodes {
            let pattern = if fixed.get(i) == Some(&true) {
                0
            } else {
                let kinds = domain.node_cells[i].map(|c| (c != NONE).then(|| domain.kinds[c as usize]));
                *pattern_of_kinds.entry(kinds.map(|k| k.map(|k| k as u8))).or_insert_with(|| {
                    let blocks = blocks_of(elements, kinds);
                    patterns.push(pack(&blocks));
                    centres.push(blocks[CENTRE]);
                    patterns.len() - 1
                })
            };
            let row = boundary.row_of_node.get(i).copied().unwrap_or(NONE);
            rows.push([pattern as u32, row]);
            let mut block = centres[pattern];
            if row != NONE {
                block += Matrix3::identity() * boundary.mass[row as usize][CENTRE];
            }
            // A block is positive definite: a cell's viscosity leaves only rigid motions free.
            let inverse = block.try_inverse().unwrap_or_else(Matrix3::identity);
            diagonal_inverse.push(std::array::from_fn(|k| inverse[(k / 3, k % 3)] as f32));
        }
        let mass: Vec<[f32; SLOTS]> = boundary.mass.iter().map(|row| row.map(|m| m as f32)).collect();
        let mass = if mass.is_empty() { vec![[0.0; SLOTS]] } else { mass };
        Ok(Stencil {
            nodes,
            neighbours: device.upload("transfer neighbours", &domain.neighbours())?,
            rows: device.upload("transfer rows", &rows)?,
            patterns: device.upload("transfer patterns", &patterns)?,
            mass: device.upload("transfer boundary mass", &mass)?,
            diagonal_inverse: BlockDiagonal {
                blocks: device.upload("transfer diagonal", &diagonal_inverse)?,
            },
        })
    }
}

impl Operator for Stencil {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        let extent = Extent { n: self.nodes as u32, coefficient: 0.0, second: 0.0, pad: 0 };
        let buffers: [&dyn crate::device::AnyBuffer; 6] =
            [&self.neighbours, &self.rows, &self.patterns, &self.mass, x, y];
        device.run(&STENCIL, self.nodes, &extent, &buffers)
    }
}
