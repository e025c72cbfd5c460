//! The disc of Cusick's drape test: 15 cm in radius, clamped between two discs of 9 cm.

use dressform::model::{Fabric, Garment, GarmentSource, Vec2, Vec3};

/// Radius of the cloth [m].
pub const DISC: f64 = 0.15;
/// Radius of what clamps it [m].
pub const PEDESTAL: f64 = 0.09;

/// A flat disc of rings about `h` apart, two of them half a spacing to either side of the
/// pedestal's rim, so that a clamp on all up to the outer one is a clamp at the rim.
fn disc(h: f64) -> (Vec<Vec2>, Vec<[u32; 3]>) {
    let outer = ((DISC - PEDESTAL) / h - 0.5).round().max(1.0);
    let h = (DISC - PEDESTAL) / (outer + 0.5);
    let inner = (PEDESTAL / h - 0.5).floor();
    let mut radii: Vec<f64> = (0..=inner as usize).map(|k| PEDESTAL - h * (0.5 + inner - k as f64)).collect();
    radii.extend((0..=outer as usize).map(|k| PEDESTAL + h * (0.5 + k as f64)));
    let (mut points, mut triangles) = (vec![Vec2::zeros()], Vec::new());
    let mut last = (0u32, 1u32); // first point and number of points of the ring before
    for (ring, &r) in radii.iter().enumerate() {
        let count = ((std::f64::consts::TAU * r / h).round() as u32).max(6);
        let first = points.len() as u32;
        // Every other ring starts half a spacing aside, so that no spoke runs through all.
        let shift = 0.5 * (ring % 2) as f64;
        points.extend((0..count).map(|i| {
            let turn = std::f64::consts::TAU * (f64::from(i) + shift) / f64::from(count);
            Vec2::new(r * turn.cos(), r * turn.sin())
        }));
        stitch(last, (first, count), &points, &mut triangles);
        last = (first, count);
    }
    (points, triangles)
}

/// Triangles between two rings, given as first point and number of points.
fn stitch(inside: (u32, u32), outside: (u32, u32), points: &[Vec2], triangles: &mut Vec<[u32; 3]>) {
    let at = |ring: (u32, u32), i: u32| ring.0 + i % ring.1;
    let angle = |ring: (u32, u32), i: u32| {
        let p = points[at(ring, i) as usize];
        p.y.atan2(p.x).rem_euclid(std::f64::consts::TAU) + std::f64::consts::TAU * f64::from(i / ring.1)
    };
    if inside.1 == 1 {
        triangles.extend((0..outside.1).map(|i| [inside.0, at(outside, i), at(outside, i + 1)]));
        return;
    }
    let (mut i, mut j) = (0, 0);
    while i < inside.1 || j < outside.1 {
        let onward = j < outside.1 && (i >= inside.1 || angle(outside, j + 1) <= angle(inside, i + 1));
        if onward {
            triangles.push([at(inside, i), at(outside, j), at(outside, j + 1)]);
            j += 1;
        } else {
            triangles.push([at(inside, i), at(outside, j), at(inside, i + 1)]);
            i += 1;
        }
    }
}

/// A disc of elements of about `h` [m], flat but for a ripple of so many waves, with its face up (1) or
/// down (-1).
pub fn garment(fabric: &Fabric, h: f64, waves: f64, face: f64) -> Garment {
    let (pattern, triangles) = disc(h);
    // A ripple of a tenth of a millimetre, for folds to start from.
    let place = |p: &Vec2| {
        let out = (p.norm() - PEDESTAL).max(0.0) / (DISC - PEDESTAL);
        Vec3::new(p.x, face * 1e-4 * out * (waves * p.y.atan2(p.x) + 40.0 * p.x).sin(), -p.y)
    };
    let source = GarmentSource::sheet(&fabric.name, &pattern, &triangles, fabric, place);
    Garment::from_source(source).expect("a disc is a garment")
}

/// The vertices of a disc of elements of about `h` [m] that are clamped.
pub fn clamped(garment: &Garment, h: f64) -> Vec<u32> {
    let within = |v: &u32| garment.pattern[*v as usize].norm() < PEDESTAL + 0.6 * h;
    (0..garment.points.len() as u32).filter(within).collect()
}
