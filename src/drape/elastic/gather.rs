//! Assembly: what every node and every block collects from its elements.
//!
//! The sparsity and, for each node and each block on or above the diagonal, the list of
//! contributions are made once; the lists' order is that of the elements, so sums come out
//! the same in every run. Blocks above the diagonal are gathered in a compact buffer, then
//! copied and transposed to their two places ([`MIRROR`]).

use rayon::prelude::*;

use super::element::{BendElement, NONE};
use super::membrane::{self, unpack_rest};
use super::{GRAIN, bending, stretch};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};

const STRETCH_GATHER: &str = include_str!("stretch_gather.wgsl");

/// `gradient = ` stretch's part, by node.
pub static STRETCH_GRADIENT: Kernel = Kernel {
    name: "stretch_gradient",
    wgsl: &[INDEX_WGSL, STRETCH_GATHER, include_str!("stretch_gradient.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stretch_gradient,
};

/// `gradient += ` bending's part, by node.
pub static BEND_GRADIENT: Kernel = Kernel {
    name: "bend_gradient",
    wgsl: &[INDEX_WGSL, include_str!("bend_gradient.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: bend_gradient,
};

/// `upper = ` stretch's part, by block.
pub static STRETCH_BLOCKS: Kernel = Kernel {
    name: "stretch_blocks",
    wgsl: &[INDEX_WGSL, STRETCH_GATHER, include_str!("stretch_blocks.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stretch_blocks,
};

/// `upper += ` bending's part, by block.
pub static BEND_BLOCKS: Kernel = Kernel {
    name: "bend_blocks",
    wgsl: &[INDEX_WGSL, include_str!("bend_blocks.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: bend_blocks,
};

/// Blocks from those on and above the diagonal.
pub static MIRROR: Kernel = Kernel {
    name: "mirror_blocks",
    wgsl: &[INDEX_WGSL, include_str!("mirror_blocks.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: mirror,
};

/// For each receiver the contributions it sums.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    /// First item of each receiver, shape `[receivers + 1]`.
    pub start: Vec<u32>,
    /// Items, in order of the elements.
    pub items: Vec<u32>,
}

impl Lists {
    /// From pairs (receiver, item).
    fn new(receivers: usize, pairs: &[(u32, u32)]) -> Lists {
        let mut start = vec![0u32; receivers + 1];
        for &(receiver, _) in pairs {
            start[receiver as usize + 1] += 1;
        }
        for i in 0..receivers {
            start[i + 1] += start[i];
        }
        let mut next = start.clone();
        let mut items = vec![0; pairs.len()];
        for &(receiver, item) in pairs {
            let at = &mut next[receiver as usize];
            items[*at as usize] = item;
            *at += 1;
        }
        Lists { start, items }
    }
}

/// The Hessian's sparsity and all lists.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    /// First block of each row, shape `[nodes + 1]`.
    pub row_start: Vec<u32>,
    /// Column of each block, ascending in a row.
    pub columns: Vec<u32>,
    /// The block on the diagonal of each row.
    pub diagonal: Vec<u32>,
    /// Where each block comes from: `2 upper + transposed`.
    pub source: Vec<u32>,
    /// Number of blocks on and above the diagonal.
    pub upper: usize,
    /// By node: `4 triangle + corner`.
    pub stretch_nodes: Lists,
    /// By node: `8 element + node`.
    pub bend_nodes: Lists,
    /// By upper block: `16 triangle + 4 corner + corner`.
    pub stretch_blocks: Lists,
    /// By upper block: `64 element + 8 node + node`.
    pub bend_blocks: Lists,
}

impl Assembly {
    /// For triangles and bending elements over `node_count` nodes.
    pub fn new(node_count: usize, triangles: &[[u32; 3]], elements: &[BendElement]) -> Assembly {
        let mut keys: Vec<u64> = (0..node_count as u32).map(|i| key(i, i)).collect();
        let stencils = elements.iter().map(|e| &e.nodes[..]).chain(triangles.iter().map(|t| &t[..]));
        for nodes in stencils {
            upper_pairs(nodes, |_, _, key| keys.push(key));
        }
        keys.par_sort_unstable();
        keys.dedup();
        let mut assembly = sparsity(node_count, &keys);
        let find = |key: u64| keys.binary_search(&key).expect("every pair was listed") as u32;
        let (mut nodes, mut blocks) = (Vec::new(), Vec::new());
        for (t, tri) in triangles.iter().enumerate() {
            nodes.extend((0..3).map(|i| (tri[i as usize], 4 * t as u32 + i)));
            upper_pairs(tri, |i, j, key| blocks.push((find(key), 16 * t as u32 + 4 * i + j)));
        }
        assembly.stretch_nodes = Lists::new(node_count, &nodes);
        assembly.stretch_blocks = Lists::new(keys.len(), &blocks);
        nodes.clear();
        blocks.clear();
        for (e, element) in elements.iter().enumerate() {
            for (i, &node) in element.nodes.iter().enumerate() {
                if node != NONE {
                    nodes.push((node, 8 * e as u32 + i as u32));
                }
            }
            upper_pairs(&element.nodes, |i, j, key| blocks.push((find(key), 64 * e as u32 + 8 * i + j)));
        }
        assembly.bend_nodes = Lists::new(node_count, &nodes);
        assembly.bend_blocks = Lists::new(keys.len(), &blocks);
        assembly
    }
}

/// Sorts as (row, column) does.
fn key(row: u32, column: u32) -> u64 {
    u64::from(row) << 32 | u64::from(column)
}

/// Calls `f(i, j, key)` for local nodes whose block is on or above the diagonal.
fn upper_pairs(nodes: &[u32], mut f: impl FnMut(u32, u32, u64)) {
    for (i, &a) in nodes.iter().enumerate() {
        for (j, &b) in nodes.iter().enumerate() {
            if a != NONE && b != NONE && a <= b {
                f(i as u32, j as u32, key(a, b));
            }
        }
    }
}

/// Rows and columns of the whole matrix from the sorted keys of its upper part.
fn sparsity(node_count: usize, keys: &[u64]) -> Assembly {
    let mut blocks: Vec<(u64, u32)> = Vec::with_capacity(2 * keys.len());
    for (upper, &k) in keys.iter().enumerate() {
        let (row, column) = ((k >> 32) as u32, k as u32);
        blocks.push((k, 2 * upper as u32));
        if row != column {
            blocks.push((key(column, row), 2 * upper as u32 + 1));
        }
    }
    blocks.sort_unstable();
    let mut assembly =
        Assembly { upper: keys.len(), row_start: vec![0; node_count + 1], ..Assembly::default() };
    for (at, &(k, source)) in blocks.iter().enumerate() {
        let (row, column) = ((k >> 32) as u32, k as u32);
        if row == column {
            assembly.diagonal.push(at as u32);
        }
        assembly.row_start[row as usize + 1] = at as u32 + 1;
        assembly.columns.push(column);
        assembly.source.push(source);
    }
    assembly
}

fn stretch_gradient(args: &mut HostArgs<'_>) {
    let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
    let (rest, derivatives) = (args.read::<[f32; 8]>(2), args.read::<f32>(3));
    let gradient = args.write::<[f32; 3]>(4);
    gradient.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(node, g)| {
        let mut sum = [0.0f32; 3];
        for &item in &items[start[node] as usize..start[node + 1] as usize] {
            let (t, corner) = ((item / 4) as usize, (item % 4) as usize);
            let [a, b] = stretch::shapes(&unpack_rest(&rest[t]))[corner];
            let d = &derivatives[membrane::DERIVATIVES * t..][..6];
            for k in 0..3 {
                sum[k] += a * d[k] + b * d[3 + k];
            }
        }
        *g = sum;
    });
}

fn bend_gradient(args: &mut HostArgs<'_>) {
    let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
    let derivatives = args.read::<f32>(2);
    let gradient = args.write::<[f32; 3]>(3);
    gradient.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(node, g)| {
        let mut sum = [0.0f32; 3];
        for &item in &items[start[node] as usize..start[node + 1] as usize] {
            let d = &derivatives[bending::DERIVATIVES * (item / 8) as usize..][..bending::DERIVATIVES];
            let j = &d[3 + 9 * (item % 8) as usize..][..9];
            for k in 0..3 {
                sum[k] += d[0] * j[k] + d[1] * j[3 + k] + d[2] * j[6 + k];
            }
        }
        for k in 0..3 {
            g[k] += sum[k];
        }
    });
}

fn stretch_blocks(args: &mut HostArgs<'_>) {
    let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
    let (rest, derivatives) = (args.read::<[f32; 8]>(2), args.read::<f32>(3));
    let upper = args.write::<[f32; 9]>(4);
    upper.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(block, out)| {
        let mut sum = [0.0f32; 9];
        for &item in &items[start[block] as usize..start[block + 1] as usize] {
            let t = (item / 16) as usize;
            let shapes = stretch::shapes(&unpack_rest(&rest[t]));
            let [iw, if_] = shapes[(item / 4 % 4) as usize];
            let [jw, jf] = shapes[(item % 4) as usize];
            let (ww, wf, fw, ff) = (iw * jw, iw * jf, if_ * jw, if_ * jf);
            let d = &derivatives[membrane::DERIVATIVES * t..][..membrane::DERIVATIVES];
            for r in 0..3 {
                for c in 0..3 {
                    let s = SYMMETRIC[3 * r + c];
                    let across = wf * d[18 + 3 * r + c] + fw * d[18 + 3 * c + r];
                    sum[3 * r + c] += ww * d[6 + s] + ff * d[12 + s] + across;
                }
            }
        }
        *out = sum;
    });
}

/// Where element (row, column) of a symmetric matrix is packed.
const SYMMETRIC: [usize; 9] = [0, 1, 2, 1, 3, 4, 2, 4, 5];

fn bend_blocks(args: &mut HostArgs<'_>) {
    let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
    let derivatives = args.read::<f32>(2);
    let upper = args.write::<[f32; 9]>(3);
    upper.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(block, out)| {
        let mut sum = [[0.0f32; 4]; 3];
        for &item in &items[start[block] as usize..start[block + 1] as usize] {
            let d = &derivatives[bending::DERIVATIVES * (item / 64) as usize..][..bending::DERIVATIVES];
            let a = &d[3 + 9 * (item / 8 % 8) as usize..][..9];
            let b = &d[3 + 9 * (item % 8) as usize..][..9];
            // A fourth column of zeros makes every row one vector.
            let b = [0, 3, 6].map(|k| [b[k], b[k + 1], b[k + 2], 0.0]);
            for r in 0..3 {
                for c in 0..4 {
                    sum[r][c] += a[r] * b[0][c] + a[3 + r] * b[1][c] + a[6 + r] * b[2][c];
                }
            }
        }
        for k in 0..9 {
            out[k] += sum[k / 3][k % 3];
        }
    });
}

fn mirror(args: &mut HostArgs<'_>) {
    let (source, upper) = (args.read::<u32>(0), args.read::<[f32; 9]>(1));
    let blocks = args.write::<[f32; 9]>(2);
    blocks.par_iter_mut().with_min_len(4 * GRAIN).enumerate().for_each(|(k, block)| {
        let b = &upper[(source[k] / 2) as usize];
        *block = match source[k] % 2 {
            0 => *b,
            _ => [b[0], b[3], b[6], b[1], b[4], b[7], b[2], b[5], b[8]],
        };
    });
}
