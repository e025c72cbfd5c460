//! What several integration tests share: the switch for tests that need a GPU, random
//! numbers, and a way to run one kernel on one device.

#![allow(dead_code, reason = "each test binary uses its own part")]

pub mod stencil;

use std::io::Write;

use bytemuck::Pod;
use dressform::device::{AnyBuffer, Device, DeviceChoice, Kernel};
use dressform::model::{TriMesh, Vec3};

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

/// The middle of the ball, far from the origin [m].
pub const BALL: [f64; 3] = [0.3, 1.2, -0.4];

/// A knobbly ball about [`BALL`], `rings` by `2 rings`; `open` leaves a
/// cap off.
pub fn ball(rings: usize, open: bool) -> TriMesh {
    let sectors = 2 * rings;
    let mut points = Vec::new();
    for i in 0..=rings {
        let polar = std::f64::consts::PI * (i as f64 / rings as f64);
        for j in 0..sectors {
            let turn = std::f64::consts::TAU * j as f64 / sectors as f64;
            let radius = 0.4 + 0.05 * (5.0 * turn).sin() * (7.0 * polar).sin();
            let direction = Vec3::new(polar.sin() * turn.sin(), polar.cos(), polar.sin() * turn.cos());
            points.push(Vec3::from(BALL) + direction * radius);
        }
    }
    let at = |i: usize, j: usize| (i * sectors + j % sectors) as u32;
    let rows = if open { rings * 3 / 4 } else { rings };
    let triangles = (0..rows)
        .flat_map(|i| (0..sectors).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect();
    TriMesh { points, triangles }
}
