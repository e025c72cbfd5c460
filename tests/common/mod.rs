//! What several integration tests share: the switch for tests that need a GPU, random
//! numbers, and a way to run one kernel on one device.

#![allow(dead_code, reason = "each test binary uses its own part")]

pub mod stencil;

use std::io::Write;

use bytemuck::Pod;
use dressform::device::{AnyBuffer, Device, DeviceChoice, Kernel};

/// The GPU, software adapters included.
///
/// Where there is none the caller skips, and says so past the capture of test output;
/// with `DRESSFORM_REQUIRE_GPU=1`, as in CI, that is a failure. This is the only switch.
pub fn gpu(test: &str) -> Option<Device> {
    match Device::open(&DeviceChoice::Gpu) {
        Ok(device) => Some(device),
        Err(error) if std::env::var("DRESSFORM_REQUIRE_GPU").is_ok_and(|v| v == "1") => {
            panic!("{test} needs a GPU: {error}")
        }
        Err(error) => {
            writeln!(std::io::stderr(), "SKIPPED on the GPU: {test}: {error}").expect("stderr");
            None
        }
    }
}

/// The CPU, and the GPU where there is one.
pub fn devices(test: &str) -> Vec<Device> {
    std::iter::once(Device::cpu()).chain(gpu(test)).collect()
}

/// Random numbers that are the same on every machine (xorshift64*).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// Uniform in -1..1.
    pub fn signed(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u32 << 23) as f32 - 1.0
    }

    pub fn vector(&mut self, n: usize) -> Vec<f32> {
        (0..n).map(|_| self.signed()).collect()
    }
}

/// The bits of floats, for buffers that are handled without their type.
pub fn words(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Runs a kernel once and returns all its buffers.
pub fn run<P: Pod>(
    device: &Device,
    kernel: &'static Kernel,
    invocations: usize,
    params: &P,
    buffers: &[Vec<u32>],
) -> Vec<Vec<u32>> {
    let buffers: Vec<_> = buffers.iter().map(|b| device.upload("test", b).expect("upload")).collect();
    let bound: Vec<&dyn AnyBuffer> = buffers.iter().map(|b| b as &dyn AnyBuffer).collect();
    device.run(kernel, invocations, params, &bound).expect("run");
    buffers.iter().map(|b| device.read(b).expect("read")).collect()
}
