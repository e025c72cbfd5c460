//! The kernels on every device of this machine: what one costs to start, and what big ones take.
//!
//! ```text
//! cargo bench --bench kernels [-- DEVICE ...]
//! ```
//! Wall time, the least of five after one that compiles shaders, as a table in Markdown. Devices are
//! `cpu` and `gpu` if none is named.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use common::{Random, stencil};
use dressform::device::{Device, DeviceChoice};
use dressform::geometry::Surface;
use dressform::geometry::bulk::SurfaceOnDevice;
use dressform::model::Vec3;
use dressform::solve::bsr::{BlockDiagonal, Bsr};
use dressform::solve::cg::{Cg, CgParams, Operator};
use dressform::solve::vector::Dot;

/// Dispatches between two looks at the result.
const BATCH: usize = 1000;
/// Nodes along each side of the grid of springs.
const SIDES: [usize; 2] = [14, 37];
/// Iterations of conjugate gradients that are timed together.
const TURNS: usize = 200;
/// Rings of the ball that is asked, of 27,000 triangles.
const RINGS: usize = 82;
/// Points that are asked for.
const QUERIES: usize = 200_000;

/// Seconds of the fastest of five, after one that is not counted.
fn seconds(mut run: impl FnMut()) -> f64 {
    run();
    let mut once = || {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..5).map(|_| once()).fold(f64::INFINITY, f64::min)
}

fn row(device: &str, what: &str, seconds: f64, unit: &str) {
    println!("| {device} | {what} | {seconds:.3} {unit} |");
}

fn starts(device: &Device, name: &str) {
    let n = 3000;
    let dot = Dot::new(device, n).expect("dot");
    let x = device.upload("x", &Random::new(3).vector(n)).expect("upload");
    let y = device.zeros::<f32>("y", n).expect("zeros");
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let blocks = device.upload("blocks", &vec![identity; n / 3]).expect("upload");
    let identity = BlockDiagonal { blocks };
    let batch = seconds(|| {
        (0..BATCH).for_each(|_| identity.apply(device, &x, &y).expect("run"));
        device.finish().expect("finish");
    });
    row(name, "a dispatch, in batches", batch / BATCH as f64 * 1e6, "us");
    let read = seconds(|| {
        (0..100).for_each(|_| {
            dot.dot(device, &x, &x).expect("dot");
        })
    });
    row(name, "a dispatch and its read-back", read / 100.0 * 1e6, "us");
}

fn conjugate_gradients(device: &Device, name: &str, side: usize) {
    let s = stencil::springs(side);
    let mut a = Bsr::new(device, &s.row_start, &s.columns).expect("matrix");
    a.blocks = device.upload("blocks", &s.blocks).expect("upload");
    let inverse = BlockDiagonal { blocks: device.upload("inverse", &s.inverse).expect("upload") };
    let n = 3 * s.rows();
    let cg = Cg::new(device, n).expect("work vectors");
    let b = device.upload("b", &Random::new(8).vector(n)).expect("upload");
    let x = device.zeros::<f32>("x", n).expect("zeros");
    let params = CgParams { tolerance: 0.0, max_iterations: TURNS };
    let all = seconds(|| {
        cg.solve_from_zero(device, &a, &inverse, &b, &x, &params).expect("solve");
    });
    row(name, &format!("CG iteration, {} rows of 27 blocks", s.rows()), all / TURNS as f64 * 1e3, "ms");
}

fn queries(device: &Device, name: &str) {
    let surface = Surface::new(common::ball(RINGS, false));
    let on_device = SurfaceOnDevice::new(device, &surface).expect("upload");
    let mut random = Random::new(11);
    let points: Vec<Vec3> = (0..QUERIES)
        .map(|_| Vec3::from(common::BALL) + Vec3::from_fn(|_, _| 0.6 * f64::from(random.signed())))
        .collect();
    let numbers = seconds(|| drop(on_device.winding_numbers(device, &points).expect("winding numbers")));
    row(name, &format!("{QUERIES} winding numbers"), numbers * 1e3, "ms");
    let closest = seconds(|| drop(on_device.closest(device, &points).expect("closest points")));
    row(name, &format!("{QUERIES} closest points"), closest * 1e3, "ms");
}

fn main() {
    let mut asked: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    if asked.is_empty() {
        asked = vec!["cpu".into(), "gpu".into()];
    }
    println!("| device | what | wall |\n| --- | --- | --- |");
    for wanted in &asked {
        let choice: DeviceChoice = wanted.parse().unwrap_or(DeviceChoice::Cpu);
        let device = match Device::open(&choice) {
            Ok(device) => device,
            Err(error) => {
                println!("| {wanted} | skipped: {error} | |");
                continue;
            }
        };
        let name = device.info().name;
        starts(&device, &name);
        SIDES.iter().for_each(|&side| conjugate_gradients(&device, &name, side));
        queries(&device, &name);
    }
}
