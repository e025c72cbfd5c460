//! Block-sparse rows of 3x3 blocks, and the inverse of their diagonal blocks.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::cg::Operator;
use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};

/// Rows that a CPU task takes.
const GRAIN: usize = 1024;

/// `struct Rows` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Rows {
    n: u32,
    pad: [u32; 3],
}

static BSR_MULTIPLY: Kernel = Kernel {
    name: "bsr_multiply",
    wgsl: &[INDEX_WGSL, include_str!("bsr_multiply.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: bsr_multiply,
};

fn bsr_multiply(args: &mut HostArgs<'_>) {
    let (row_start, columns) = (args.read::<u32>(0), args.read::<u32>(1));
    let (blocks, x) = (args.read::<[f32; 9]>(2), args.read::<[f32; 3]>(3));
    let y = args.write::<[f32; 3]>(4);
    y.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(row, y)| {
        let range = row_start[row] as usize..row_start[row + 1] as usize;
        // Products summed one by one, and each row of three at the end: that way they are vectors.
        let mut sum = [0.0f32; 9];
        for (b, column) in blocks[range.clone()].iter().zip(&columns[range]) {
            let v = x[*column as usize];
            let v = [v[0], v[1], v[2], v[0], v[1], v[2], v[0], v[1], v[2]];
            for k in 0..9 {
                sum[k] += b[k] * v[k];
            }
        }
        *y = std::array::from_fn(|i| sum[3 * i] + sum[3 * i + 1] + sum[3 * i + 2]);
    });
}

static BLOCK_MULTIPLY: Kernel = Kernel {
    name: "block_multiply",
    wgsl: &[INDEX_WGSL, include_str!("block_multiply.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: |args| {
        let (blocks, x) = (args.read::<[f32; 9]>(0), args.read::<[f32; 3]>(1));
        let y = args.write::<[f32; 3]>(2);
        y.par_iter_mut().with_min_len(4 * GRAIN).enumerate().for_each(|(row, y)| {
            let (b, v) = (&blocks[row], &x[row]);
            for i in 0..3 {
                y[i] = b[3 * i] * v[0] + b[3 * i + 1] * v[1] + b[3 * i + 2] * v[2];
            }
        });
    },
};

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&BSR_MULTIPLY, &BLOCK_MULTIPLY];

/// A square matrix of 3x3 blocks (row-major), with a sparsity that is fixed when it is made.
#[derive(Debug)]
pub struct Bsr {
    /// Number of block rows.
    pub rows: usize,
    /// First block of each row, shape `[rows + 1]`.
    pub row_start: Buffer<u32>,
    /// Block column of each block, ascending in a row.
    pub columns: Buffer<u32>,
    /// Blocks, shape `[blocks, 3, 3]`.
    pub blocks: Buffer<[f32; 9]>,
}

impl Bsr {
    /// A zero matrix with the given sparsity.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(device: &Device, row_start: &[u32], columns: &[u32]) -> Result<Bsr, DeviceError> {
        Ok(Bsr {
            rows: row_start.len() - 1,
            row_start: device.upload("bsr row starts", row_start)?,
            columns: device.upload("bsr columns", columns)?,
            blocks: device.zeros("bsr blocks", columns.len())?,
        })
    }
}

impl Operator for Bsr {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        let rows = Rows { n: self.rows as u32, pad: [0; 3] };
        device.run(&BSR_MULTIPLY, self.rows, &rows, &[&self.row_start, &self.columns, &self.blocks, x, y])
    }
}

/// A block-diagonal matrix, usually the inverse of another's diagonal (block Jacobi).
#[derive(Debug)]
pub struct BlockDiagonal {
    /// Blocks, shape `[rows, 3, 3]`.
    pub blocks: Buffer<[f32; 9]>,
}

impl Operator for BlockDiagonal {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        let rows = Rows { n: self.blocks.len() as u32, pad: [0; 3] };
        device.run(&BLOCK_MULTIPLY, self.blocks.len(), &rows, &[&self.blocks, x, y])
    }
}
