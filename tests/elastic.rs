//! Elastic energies on every device against the judge in `f64`.

mod common;

use common::Random;
use dressform::device::Device;
use dressform::drape::cloth::{Cloth, Options};
use dressform::drape::elastic::Elastic;
use dressform::model::{Fabric, Garment, GarmentSource, Panel, TriMesh, Vec2, Vec3};

/// Side of a quad [m].
const H: f64 = 0.02;

/// Two panels of 6 by 8 quads, the second turned in its own coordinates, sewn together and
/// folded by 1.3 rad along their common edge; the first is rolled.
fn garment() -> Garment {
    let (columns, rows) = (12u32, 8u32);
    let place = |i: u32, j: u32| {
        let (x, z) = (H * (f64::from(i) - 6.0), H * f64::from(j));
        let (far, rolled) = (x.max(0.0), x.min(0.0));
        Vec3::new(far * 1.3f64.cos() + rolled, far * 1.3f64.sin() + 6.0 * rolled * rolled + 1.4, z)
    };
    let at = |i: u32, j: u32| j * (columns + 1) + i;
    let mut points = Vec::new();
    for j in 0..=rows {
        points.extend((0..=columns).map(|i| place(i, j)));
    }
    let (mut triangles, mut corners, mut panels) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..rows {
        for i in 0..columns {
            let panel = i / 6;
            let uv = |point: u32| {
                let p = Vec2::new(H * f64::from(point % (columns + 1)), H * f64::from(point / (columns + 1)));
                if panel == 1 { Vec2::new(1.0 - p.y, p.x) } else { p }
            };
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            for tri in [[a, b, c], [a, c, d]] {
                triangles.push(tri);
                corners.push(tri.map(uv));
                panels.push(panel);
            }
        }
    }
    let panel = Panel { fabric: Fabric::default(), ..Panel::default() };
    let source = GarmentSource {
        name: "folded".to_owned(),
        mesh: TriMesh { points, triangles },
        corner_pattern: corners,
        panel_of_triangle: panels,
        panels: vec![panel.clone(), panel],
        ..GarmentSource::default()
    };
    Garment::from_source(source).expect("a valid garment")
}

/// What a device makes of displacements: energy, gradient, blocks.
fn evaluate(device: &Device, garment: &Garment, cloth: &Cloth, u: &[f32]) -> (f64, Vec<f32>, Vec<[f32; 9]>) {
    let mut elastic = Elastic::new(device, cloth).expect("new");
    elastic.rebase(device, &garment.points).expect("rebase");
    let u = device.upload("u", u).expect("upload");
    elastic.linearise(device, &u).expect("linearise");
    let gradient = device.read(elastic.gradient()).expect("read");
    let blocks = device.read(&elastic.hessian().blocks).expect("read");
    (elastic.energy(device, &u).expect("energy"), gradient, blocks)
}

#[test]
fn every_device_agrees_with_the_judge() {
    let garment = garment();
    let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).expect("cloth");
    assert!(cloth.hinges.iter().any(|h| h.seam));
    let judge = Elastic::new(&Device::cpu(), &cloth).expect("new");
    for device in common::devices("elastic energies") {
        // At rest, a settling step, a step that crumples.
        for size in [0.0f32, 1e-4, 6e-3] {
            let mut random = Random::new(31);
            let u: Vec<f32> = random.vector(3 * cloth.node_count).iter().map(|x| size * x).collect();
            let points: Vec<Vec3> = (0..garment.points.len())
                .map(|v| {
                    let node = 3 * cloth.node_of_vertex[v] as usize;
                    garment.points[v] + Vec3::from_fn(|i, _| f64::from(u[node + i]))
                })
                .collect();
            let (energy, gradient) = judge.judge(&points);
            let (found, forces, blocks) = evaluate(&device, &garment, &cloth, &u);
            let name = device.info().name;
            // Some ten roundings in a strain, as many elements around a node.
            assert!((found - energy).abs() < 1e-6 * energy, "{name} {size}: {found:e} J, {energy:e} J");
            let largest = gradient.iter().map(|g| g.norm()).fold(0.0, f64::max);
            for (k, &force) in forces.iter().enumerate() {
                let error = (f64::from(force) - gradient[k / 3][k % 3]).abs();
                assert!(error < 5e-6 * largest, "{name} {size} {k}: {error:e} of {largest:e} N");
            }
            let (_, _, expected) = evaluate(&Device::cpu(), &garment, &cloth, &u);
            let largest = expected.iter().flatten().fold(0.0f32, |m, x| m.max(x.abs()));
            for (block, expected) in blocks.iter().zip(&expected) {
                for (x, e) in block.iter().zip(expected) {
                    assert!((x - e).abs() < 5e-6 * largest, "{name} {size}: {x} is not {e}");
                }
            }
        }
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let garment = garment();
    let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).expect("cloth");
    let u: Vec<f32> = Random::new(5).vector(3 * cloth.node_count).iter().map(|x| 1e-3 * x).collect();
    for device in common::devices("elastic energies twice") {
        let [a, b] = [0, 1].map(|_| evaluate(&device, &garment, &cloth, &u));
        assert!(a == b, "{}", device.info().name);
    }
}
