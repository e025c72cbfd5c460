//! Dot products and updates of vectors.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};

/// Lanes of a block in a dot product; `LANES` in dot_partial.wgsl.
const LANES: usize = 256;
/// Elements that a lane sums; `TURNS` in dot_partial.wgsl.
const TURNS: usize = 64;
/// Blocks that a CPU task takes.
const GRAIN: usize = 4;

/// Parameters of a kernel over `n` elements; `struct Count` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Count {
    pub n: u32,
    pub blocks: u32,
    pub pad: [u32; 2],
}

impl Count {
    pub fn new(n: usize) -> Self {
        Count { n: n as u32, blocks: n.div_ceil(LANES * TURNS) as u32, pad: [0; 2] }
    }

    pub fn partials(&self) -> usize {
        self.blocks as usize * LANES
    }
}

/// Each lane of each block sums its stride of `x * y`.
static DOT_PARTIAL: Kernel = Kernel {
    name: "dot_partial",
    wgsl: &[INDEX_WGSL, include_str!("dot_partial.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: dot_partial,
};

fn dot_partial(args: &mut HostArgs<'_>) {
    let (x, y) = (args.read::<f32>(0), args.read::<f32>(1));
    let partials = args.write::<f32>(2);
    let block = LANES * TURNS;
    let blocks = partials.par_chunks_mut(LANES).zip(x.par_chunks(block).zip(y.par_chunks(block)));
    blocks.with_min_len(GRAIN).for_each(|(sums, (x, y))| {
        sums.fill(0.0);
        for (x, y) in x.chunks(LANES).zip(y.chunks(LANES)) {
            for (sum, (x, y)) in sums.iter_mut().zip(x.iter().zip(y)) {
                *sum += x * y;
            }
        }
    });
}

/// Scratch for dot products of vectors of one length.
#[derive(Debug)]
pub struct Dot {
    pub(super) count: Count,
    pub(super) partials: Buffer<f32>,
}

impl Dot {
    /// For vectors of `n` elements.
    ///
    /// # Errors
    /// As [`Device::zeros`].
    pub fn new(device: &Device, n: usize) -> Result<Dot, DeviceError> {
        let count = Count::new(n);
        Ok(Dot { count, partials: device.zeros("dot partials", count.partials())? })
    }

    /// Leaves the partial sums of `x . y` in the scratch buffer.
    pub(super) fn run(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError> {
        device.run(&DOT_PARTIAL, self.count.partials(), &self.count, &[x, y, &self.partials])
    }

    /// `x . y`, the partial sums added in f64 on the host.
    ///
    /// # Errors
    /// As [`Device::read`].
    pub fn dot(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<f64, DeviceError> {
        self.run(device, x, y)?;
        Ok(device.read(&self.partials)?.iter().map(|&p| f64::from(p)).sum())
    }
}

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&DOT_PARTIAL];
