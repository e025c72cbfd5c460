//! The kernels of contact on the GPU against their twins on the CPU: forces, products and
//! inverse diagonal blocks of the same stencils.

mod common;

use dressform::device::Device;
use dressform::drape::contact::KERNELS;
use dressform::drape::contact::operator::Stencils;
use dressform::drape::contact::stencil::{Kind, Stencil};
use dressform::model::Vec3;
use dressform::solve::bsr::{BlockDiagonal, Bsr};
use nalgebra::Matrix3;

const NODES: usize = 300;
/// Inverse square of a time step [1/s^2].
const INERTIA: f64 = 9216.0;

/// Stencils of every kind, with gaps on both sides of where a barrier turns logarithmic.
fn stencils() -> (Vec<Stencil>, Vec<Vec3>) {
    let wave = |i: usize, f: f64| (i as f64 * f).sin();
    let moved = (0..NODES).map(|i| Vec3::new(wave(i, 1.1), wave(i, 2.3), wave(i, 3.7)) * 1e-5).collect();
    let list = (0..2000).map(|i| {
        let kind = [Kind::Barrier, Kind::Spring, Kind::Friction, Kind::Force][i % 4];
        let t = 0.5 + 0.45 * wave(i, 5.1);
        Stencil {
            kind,
            nodes: std::array::from_fn(|k| ((i * 7 + k * 11) % NODES) as u32),
            weights: [t, 1.0 - t, -0.3, -0.7],
            normal: Vec3::new(wave(i, 0.7), wave(i, 1.9), 1.0).normalize(),
            gap: if kind == Kind::Friction { 0.0 } else { 2e-3 * t },
            radius: if kind == Kind::Friction { 1e-5 } else { 2e-3 },
            stiffness: 500.0,
        }
    });
    (list.collect(), moved)
}

/// Gradient, product and inverse diagonal on one device.
fn run(device: &Device) -> [Vec<f32>; 3] {
    let (list, moved) = stencils();
    let stencils = Stencils::new(device, NODES, &list, &moved).unwrap();
    let columns: Vec<u32> = (0..NODES as u32).collect();
    let starts: Vec<u32> = (0..=NODES as u32).collect();
    let elastic = Bsr::new(device, &starts, &columns).unwrap();
    let mass = device.upload("mass", &vec![1e-4f32; NODES]).unwrap();
    let at = device.upload("at", &columns).unwrap();
    let x: Vec<f32> = (0..3 * NODES).map(|i| (i as f32 * 0.37).sin()).collect();
    let x = device.upload("x", &x).unwrap();
    let gradient = device.zeros::<f32>("gradient", 3 * NODES).unwrap();
    stencils.add_gradient(device, INERTIA, &mass, &x, &gradient).unwrap();
    let product = device.zeros::<f32>("product", 3 * NODES).unwrap();
    stencils.add_product(device, INERTIA, &mass, &x, &product).unwrap();
    let inverse = BlockDiagonal { blocks: device.zeros("inverse", NODES).unwrap() };
    stencils.invert_diagonal(device, INERTIA, &mass, &elastic, &at, &inverse).unwrap();
    let inverse = device.read(&inverse.blocks).unwrap().concat();
    [device.read(&gradient).unwrap(), device.read(&product).unwrap(), inverse]
}

#[test]
fn every_kernel_of_contact_agrees_with_its_twin() {
    assert_eq!(KERNELS.len(), 4, "a kernel was added that this test does not run");
    let Some(gpu) = common::gpu("every_kernel_of_contact_agrees_with_its_twin") else { return };
    // Some 27 stencils meet at a node, each a dozen rounded operations; the logarithm of a
    // barrier is good to a few units in the last place.
    let rounding = 27.0 * 12.0 * 4.0 * f32::EPSILON;
    let [gradient, product, inverse] = run(&gpu);
    let [gradient_cpu, product_cpu, inverse_cpu] = run(&Device::cpu());
    for (name, found, expected) in [("gradient", gradient, gradient_cpu), ("product", product, product_cpu)] {
        let largest = expected.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        assert!(largest > 0.0, "{name} is nothing");
        close(name, &found, &expected, rounding * largest);
    }
    // An inverse answers a rounding of its matrix by |A^-1|^2 |A|.
    for (found, expected) in inverse.chunks(9).zip(inverse_cpu.chunks(9)) {
        let block = Matrix3::from_row_slice(expected);
        let matrix = block.try_inverse().expect("an inverse has one");
        close("inverse diagonal", found, expected, rounding * block.norm().powi(2) * matrix.norm());
    }
}

fn close(name: &str, found: &[f32], expected: &[f32], bound: f32) {
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= bound, "{name}[{i}]: {f} on the GPU, {e} on the CPU, bound {bound}");
    }
}
