//! A drape to rest on the host and on the GPU: the same equilibrium, and the same bytes again.
//!
//! The sheet is clamped along one edge and hangs over a ball without friction: free cloth on a ball
//! has many equilibria, and friction makes more of them, between which rounding decides.

mod common;

use common::devices;
use dressform::device::Device;
use dressform::drape::{self, Input, Output, Params};
use dressform::geometry::Surface;
use dressform::model::{Fabric, Garment, GarmentSource, TriMesh, Vec2, Vec3};

/// Edge of the sheet [m], cells along it, and radius of the ball [m].
const SIDE: f64 = 0.16;
const CELLS: u32 = 8;
const RADIUS: f64 = 0.1;
/// Largest distance between the two equilibria [m].
const APART: f64 = 1e-4;

/// A square sheet a centimetre above the ball's top, its clamped edge before it.
fn sheet() -> Garment {
    let step = SIDE / f64::from(CELLS);
    let at = |i: u32, j: u32| i * (CELLS + 1) + j;
    let cells = || (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| (i, j)));
    let pattern: Vec<Vec2> = (0..=CELLS)
        .flat_map(|i| (0..=CELLS).map(move |j| Vec2::new(f64::from(i), f64::from(j)) * step))
        .collect();
    let triangles: Vec<[u32; 3]> = cells()
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, c, b], [a, d, c]]
        })
        .collect();
    let place = |p: &Vec2| Vec3::new(p.x - 0.5 * SIDE, RADIUS + 0.01, p.y - 0.5 * SIDE);
    let smooth = Fabric { friction: 0.0, ..Fabric::default() };
    let source = GarmentSource::sheet("sheet", &pattern, &triangles, &smooth, place);
    Garment::from_source(source).expect("a sheet is a garment")
}

/// A ball of rings and meridians about the origin.
fn ball() -> Surface {
    let (rings, meridians) = (14u32, 24u32);
    let mut points = vec![Vec3::new(0.0, RADIUS, 0.0), Vec3::new(0.0, -RADIUS, 0.0)];
    let turn = std::f64::consts::PI;
    for i in 1..rings {
        let down = turn * f64::from(i) / f64::from(rings);
        points.extend((0..meridians).map(|k| {
            let around = 2.0 * turn * f64::from(k) / f64::from(meridians);
            Vec3::new(down.sin() * around.cos(), down.cos(), down.sin() * around.sin()) * RADIUS
        }));
    }
    let at = |i: u32, k: u32| 2 + (i - 1) * meridians + k % meridians;
    let mut triangles = Vec::new();
    for k in 0..meridians {
        triangles.push([0, at(1, k + 1), at(1, k)]);
        triangles.push([1, at(rings - 1, k), at(rings - 1, k + 1)]);
        for i in 1..rings - 1 {
            triangles.push([at(i, k), at(i, k + 1), at(i + 1, k)]);
            triangles.push([at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)]);
        }
    }
    Surface::new(TriMesh { points, triangles })
}

fn settled(device: &Device) -> Output {
    let (garment, body) = (sheet(), ball());
    let clamped: Vec<u32> = (0..=CELLS).collect();
    let input = Input { colliders: &[&body], pinned: &clamped, ..Input::alone(&garment) };
    let params = Params { tolerance: 2e-3, rest_tolerance: 5e-3, ..Params::default() };
    let out = drape::run(device, &input, &params).expect("the sheet drapes");
    assert!(out.info.converged && out.info.at_rest, "{:?}", out.info);
    out
}

#[test]
fn twins_come_to_the_same_rest_and_reruns_to_the_same_bytes() {
    let mut rests = Vec::new();
    for device in devices("twins_come_to_the_same_rest_and_reruns_to_the_same_bytes") {
        let (first, again) = (settled(&device).points, settled(&device).points);
        assert_eq!(first, again);
        rests.push(first);
    }
    let moved = rests[0].iter().zip(&sheet().points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(moved > 0.03, "{moved}"); // the free edge hangs down
    for other in &rests[1..] {
        let apart = rests[0].iter().zip(other).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(apart < APART, "{apart}");
    }
}
