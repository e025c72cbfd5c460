//! A clamped strip under its own weight against the planar heavy elastica.

use super::*;
use crate::drape::elastic::tests::{Split, flat, garment_of, panel};
use crate::model::Fabric;

/// Tip of the heavy elastica of length 1, clamped level: `theta'' = -load (1 - s) cos theta`
/// with `theta(0) = 0`, `theta'(1) = 0` and `load = rho g L^3 / D`; along and down.
///
/// Shooting on `theta'(0)` by bisection over a fourth-order Runge-Kutta solution; the
/// branch that hangs down has `theta` between 0 and a right angle.
fn elastica(load: f64) -> (f64, f64) {
    let steps = 2000;
    let h = 1.0 / f64::from(steps);
    let shoot = |bend: f64| {
        let slope = |s: f64, y: [f64; 4]| [y[1], -load * (1.0 - s) * y[0].cos(), y[0].cos(), y[0].sin()];
        let mut y = [0.0, bend, 0.0, 0.0];
        for i in 0..steps {
            let s = f64::from(i) * h;
            let at = |k: [f64; 4], by: f64| std::array::from_fn(|j| y[j] + by * k[j]);
            let k1 = slope(s, y);
            let k2 = slope(s + 0.5 * h, at(k1, 0.5 * h));
            let k3 = slope(s + 0.5 * h, at(k2, 0.5 * h));
            let k4 = slope(s + h, at(k3, h));
            y = std::array::from_fn(|j| y[j] + h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            if y[0] > std::f64::consts::FRAC_PI_2 || y[0] < -0.1 {
                // Past the vertical: bent too much; swung back: too little.
                return (if y[0] > 0.0 { 1.0 } else { -1.0 }, y);
            }
        }
        (y[1], y)
    };
    let (mut low, mut high) = (0.0, load + 1.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if shoot(middle).0 > 0.0 { high = middle } else { low = middle }
    }
    let (_, y) = shoot(0.5 * (low + high));
    (y[2], y[3])
}

#[test]
fn shooting_gives_eulers_beam_for_small_loads() {
    let (_, down) = elastica(1e-3);
    assert!((down / (1e-3 / 8.0) - 1.0).abs() < 1e-4);
}

/// Load and tip (along, down) by collocation: SciPy's `solve_bvp` on the same boundary-value
/// problem with the tip's coordinates as third and fourth unknowns, tolerance 1e-10.
const COLLOCATED: [(f64, f64, f64); 5] = [
    (1.0, 0.9912463953, 0.1234714020),
    (5.0, 0.8466571800, 0.4959050446),
    (10.0, 0.6563537612, 0.7001997155),
    (30.0, 0.3427636807, 0.8730924232),
    (100.0, 0.1592233826, 0.9375239354),
];

#[test]
fn shooting_agrees_with_collocation() {
    for (load, along, down) in COLLOCATED {
        let (x, y) = elastica(load);
        assert!((x - along).hypot(y - down) < 1e-6, "{load}: {x} {y}");
    }
}

/// Tip of a strip of `n` quads at the load, relative to its length: along and down.
fn tip(n: usize, split: Split, turn: f64, load: f64) -> (f64, f64) {
    let length = 0.2;
    // The tangent is level in the middle of the held column of quads: that is the clamp.
    let h = length / (n as f64 + 0.5);
    let k = Fabric::default().density * 9.81 * length.powi(3) / load;
    let fabric = Fabric { bending_warp: k, bending_weft: k, bending_shear: 2.0 * k, ..Fabric::default() };
    let garment = garment_of(&panel(n + 1, (n / 3).max(2), h, split, turn), &fabric, flat);
    let along = Vec3::new(turn.cos(), 0.0, turn.sin());
    let s = |v: u32| garment.points[v as usize].dot(&along) - h;
    let all = 0..garment.points.len() as u32;
    let held: Vec<u32> = all.clone().filter(|&v| s(v) < 0.5 * h).collect();
    let params = Params { tolerance: 1e-3, cg_tolerance: 1e-2, ..Params::default() };
    let input = Input { pinned: &held, ..still(&garment, &[], &[]) };
    let device = Device::cpu();
    let mut simulation = simulation(&device, &input, &params).unwrap();
    let mut info = Info { converged: true, ..Info::default() };
    for _ in 0..60 {
        advance(&mut simulation, 0.05, 0.6, &mut info, 1).unwrap();
        if simulation.net_force() < 2e-3 {
            break;
        }
    }
    assert!(info.converged && simulation.net_force() < 2e-3);
    let end: Vec<Vec3> = all
        .filter(|&v| s(v) > (n as f64 - 0.5) * h)
        .map(|v| simulation.x[garment.groups.node_of_vertex[v as usize] as usize])
        .collect();
    ((mean(&end).dot(&along) - 0.5 * h) / length, -mean(&end).y / length)
}

#[test]
fn clamped_strip_hangs_as_the_heavy_elastica() {
    // Two densities, two directions of the panel, three ways to split it.
    for (n, split, turn) in [
        (8, Split::Diagonal, 0.0),
        (16, Split::Diagonal, 0.8),
        (12, Split::Irregular, 0.0),
        (12, Split::Alternating, 1.2),
    ] {
        for load in [1.0, 10.0, 100.0] {
            let ((x, y), (ex, ey)) = (tip(n, split, turn, load), elastica(load));
            let error = (x - ex).hypot(y - ey);
            assert!(error < 0.03, "{n} {split:?} {turn}, load {load}: {x} {y}, {ex} {ey}");
        }
    }
}
