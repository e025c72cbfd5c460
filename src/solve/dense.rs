//! A dense matrix on the device, for systems of a few hundred unknowns.

use bytemuck::{Pod, Zeroable};
use nalgebra::DMatrix;
use rayon::prelude::*;

use super::cg::Operator;
use crate::device::{Access, Buffer, Device, DeviceError, INDEX_WGSL, Kernel};

/// Rows that a CPU task takes.
const GRAIN: usize = 64;

/// `struct Size` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Size {
    n: u32,
    pad: [u32; 3],
}

static DENSE_MULTIPLY: Kernel = Kernel {
    name: "dense_multiply",
    wgsl: &[INDEX_WGSL, include_str!("dense_multiply.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: |args| {
        let (matrix, x) = (args.read::<f32>(0), args.read::<f32>(1));
        let y = args.write::<f32>(2);
        let n = x.len();
        y.par_iter_mut().with_min_len(GRAIN).zip(matrix.par_chunks(n.max(1))).for_each(|(y, row)| {
            *y = dot(row, x);
        });
    },
};

/// In eight running sums: a compiler makes vectors of them.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&DENSE_MULTIPLY];

/// A square matrix, usually the inverse of another.
#[derive(Debug)]
pub struct Dense {
    size: usize,
    rows: Buffer<f32>,
}

impl Dense {
    /// The matrix on a device, in `f32`.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(device: &Device, matrix: &DMatrix<f64>) -> Result<Dense, DeviceError> {
        let size = matrix.nrows();
        let rows: Vec<f32> = (0..size * size).map(|k| matrix[(k / size, k % size)] as f32).collect();
        Ok(Dense { size, rows: device.upload("dense matrix", &rows)? })
    }

    /// Number of unknowns.
    pub fn size(&self) -> usize {
        self.size
    }
}

impl Operator for Dense {
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        let size = Size { n: self.size as u32, pad: [0; 3] };
        device.run(&DENSE_MULTIPLY, self.size, &size, &[&self.rows, x, y])
    }
}
