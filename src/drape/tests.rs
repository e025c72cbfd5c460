//! Closed forms and conserved quantities: fall, rest, friction, hanging, layers, tangles.

mod elastica;
mod statics;
mod tangles;

use super::phases::advance;
use super::setup::simulation;
use super::simulation::Simulation;
use super::*;
use crate::geometry::intersect;
use crate::model::{GarmentSource, Panel, TriMesh};

/// Square patches of `n` by `n` cells and side `size` [m], one panel each, with `place`
/// giving the corner positions of each patch.
pub(super) fn patches(n: usize, size: f64, places: &[&dyn Fn(f64, f64) -> Vec3]) -> Garment {
    let mut source = GarmentSource { name: "patch".into(), ..GarmentSource::default() };
    for (p, place) in places.iter().enumerate() {
        let first = source.mesh.points.len() as u32;
        let uv = |i: u32| {
            let (row, column) = (i as usize / (n + 1), i as usize % (n + 1));
            Vec2::new(row as f64, column as f64) * (size / n as f64)
        };
        for i in 0..((n + 1) * (n + 1)) as u32 {
            source.mesh.points.push(place(uv(i).x, uv(i).y));
        }
        for row in 0..n as u32 {
            for column in 0..n as u32 {
                let a = row * (n as u32 + 1) + column;
                let (b, c, d) = (a + 1, a + n as u32 + 1, a + n as u32 + 2);
                let split =
                    if (row + column) % 2 == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] };
                for t in split {
                    source.corner_pattern.push(t.map(|i| uv(i) + Vec2::new(0.0, 2.0 * p as f64 * size)));
                    source.mesh.triangles.push(t.map(|i| i + first));
                    source.panel_of_triangle.push(p as u32);
                }
            }
        }
        source.panels.push(Panel::default());
    }
    Garment::from_source(source).unwrap()
}

/// The default drape without its settling phase.
fn untangling() -> Params {
    Params { settle: false, ..Params::default() }
}

/// A large square at the origin, facing up, tilted about z by `slope` [rad].
fn ground(slope: f64) -> Surface {
    let (c, s) = (slope.cos(), slope.sin());
    let p = |x: f64, z: f64| Vec3::new(x * c, x * s, z);
    let points = vec![p(-2.0, -2.0), p(2.0, -2.0), p(2.0, 2.0), p(-2.0, 2.0)];
    Surface::new(TriMesh { points, triangles: vec![[0, 2, 1], [0, 3, 2]] })
}

pub(super) fn sphere(radius: f64, rings: u32) -> Surface {
    let sectors = 2 * rings;
    let mut points = vec![Vec3::y() * radius, -Vec3::y() * radius];
    for i in 1..rings {
        for j in 0..sectors {
            let (u, v) =
                (std::f64::consts::PI * f64::from(i) / f64::from(rings), f64::from(j) / f64::from(sectors));
            let v = std::f64::consts::TAU * v;
            points.push(Vec3::new(u.sin() * v.cos(), u.cos(), u.sin() * v.sin()) * radius);
        }
    }
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => 1,
        i => 2 + (i - 1) * sectors + j % sectors,
    };
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..sectors {
            triangles.extend([
                [at(i, j), at(i, j + 1), at(i + 1, j)],
                [at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)],
            ]);
        }
    }
    triangles.retain(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
    Surface::new(TriMesh { points, triangles })
}

/// The garment where its source has it.
fn still<'a>(garment: &'a Garment, colliders: &'a [&'a Surface], layers: &'a [&'a Surface]) -> Input<'a> {
    Input { colliders, layers, ..Input::alone(garment) }
}

/// Vertices of the panel's row at `x` [m].
fn row(garment: &Garment, x: f64) -> Vec<u32> {
    (0..garment.points.len() as u32).filter(|&v| (garment.pattern[v as usize].x - x).abs() < 1e-9).collect()
}

fn drape(garment: &Garment, colliders: &[&Surface], layers: &[&Surface], params: &Params) -> Output {
    let input = still(garment, colliders, layers);
    run(&Device::cpu(), &input, params).unwrap()
}

fn mean(points: &[Vec3]) -> Vec3 {
    points.iter().sum::<Vec3>() / points.len() as f64
}

#[test]
fn falls_freely() {
    let garment = patches(6, 0.3, &[&|x, y| Vec3::new(x, 1.0, y)]);
    let params = Params { damping: 0.0, frames: 3, ..untangling() };
    let out = drape(&garment, &[], &[], &params);
    let (n, h) = (12.0, FRAME / 4.0);
    // Implicit Euler: v = g n h, and the fall is g h^2 n (n + 1) / 2.
    let fall = 9.81 * h * h * n * (n + 1.0) / 2.0;
    assert!((1.0 - mean(&out.points).y - fall).abs() < 1e-4 * fall);
    let energy = 0.5 * 0.15 * 0.09 * (9.81 * n * h) * (9.81 * n * h);
    assert!((out.info.kinetic_energy_j / energy - 1.0).abs() < 1e-3);
    assert!(out.info.converged);
}

#[test]
fn rests_on_the_ground() {
    let garment = patches(8, 0.3, &[&|x, y| Vec3::new(x, 2.5e-3, y)]);
    let params = Params { settle: true, tolerance: 1e-2, ..Params::default() };
    let out = drape(&garment, &[&ground(0.0)], &[], &params);
    assert!(out.info.converged && out.info.at_rest, "{:?}", out.info);
    assert!(out.points.iter().all(|p| p.y > 1.9e-3 && p.y < 2e-3), "{:?}", mean(&out.points));
}

/// Displacement down a slope with tangent `tan` in so many frames [m].
fn slide(tan: f64, frames: usize) -> f64 {
    let slope = f64::atan(tan);
    let (c, s) = (slope.cos(), slope.sin());
    // Where the penalty carries the weight, so that friction is right from the first step.
    let gap = 2e-3 - 0.15 * 9.81 * c / 2.5e6 * (81.0 / 64.0);
    let garment = patches(8, 0.3, &[&|x, y| Vec3::new(x * c - gap * s, x * s + gap * c, y)]);
    let params = Params { damping: 0.0, tolerance: 1e-2, frames, ..untangling() };
    let out = drape(&garment, &[&ground(slope)], &[], &params);
    assert!(out.info.converged);
    (mean(&garment.points) - mean(&out.points)).dot(&Vec3::new(c, s, 0.0))
}

#[test]
fn sticks_and_slips_at_the_coefficient_of_friction() {
    // Cotton: 0.4. Sticking creeps below `friction_speed`.
    let stuck = slide(0.95 * 0.4, 6);
    assert!(stuck.abs() < 1e-3 * 0.25 * 1.1, "{stuck}");
    let slipped = slide(1.05 * 0.4, 6);
    let slope = f64::atan(1.05 * 0.4);
    let expected = 0.5 * 9.81 * (slope.sin() - 0.4 * slope.cos()) * 0.25 * 0.25;
    assert!(slipped > 0.7 * expected && slipped < 1.3 * expected, "{slipped} {expected}");
    // The acceleration, by second differences: the first step's lagged normal force is that of
    // cloth laid down with every pair in contact, and costs a part of one step's speed.
    let acceleration = slide(0.8, 6) - 2.0 * slide(0.8, 4) + slide(0.8, 2);
    let slope = f64::atan(0.8);
    let expected = 9.81 * (slope.sin() - 0.4 * slope.cos()) * (2.0 * FRAME) * (2.0 * FRAME);
    assert!((acceleration / expected - 1.0).abs() < 0.02, "{acceleration} {expected}");
}

#[test]
fn hangs_by_its_weight() {
    let (n, size) = (8, 0.4);
    let garment = patches(n, size, &[&|x, y| Vec3::new(y, 1.0 - x, 0.0)]);
    let params = Params { tolerance: 1e-3, cg_tolerance: 1e-3, ..untangling() };
    let top = row(&garment, 0.0);
    let input = Input { pinned: &top, ..still(&garment, &[], &[]) };
    let device = Device::cpu();
    let mut simulation = simulation(&device, &input, &params).unwrap();
    let mut info = Info { converged: true, ..Info::default() };
    for _ in 0..40 {
        advance(&mut simulation, 0.05, 0.5, &mut info, 0).unwrap();
    }
    assert!(info.converged, "{info:?}");
    let bottom: Vec<f64> = (0..garment.points.len())
        .filter(|&v| (garment.pattern[v].x - size).abs() < 1e-9)
        .map(|v| simulation.x[garment.groups.node_of_vertex[v] as usize].y)
        .collect();
    let stretch = (1.0 - size) - bottom.iter().sum::<f64>() / bottom.len() as f64;
    // Weight below, over the warp's stiffness, integrated: rho g L^2 / (2 k).
    let expected = 0.15 * 9.81 * size * size / (2.0 * 1200.0);
    assert!((stretch / expected - 1.0).abs() < 0.05, "{stretch} {expected}");
}

#[test]
fn layers_stack() {
    let lower = patches(8, 0.3, &[&|x, y| Vec3::new(x, 2.2e-3, y)]);
    let floor = ground(0.0);
    let first = drape(&lower, &[&floor], &[], &untangling());
    // Panels lie with their outside up: their triangles wind counter-clockwise from above.
    let layer = Surface::new(lower.mesh_at(&first.points));
    let upper = patches(7, 0.25, &[&|x, y| Vec3::new(x + 0.02, 5e-3, y + 0.03)]);
    let params = Params { frames: 24, damping: 0.3, ..untangling() };
    let second = drape(&upper, &[&floor], &[&layer], &params);
    assert!(second.info.converged, "{:?}", second.info);
    assert!(second.points.iter().all(|p| p.y > 2.5e-3 && p.y < 4.1e-3), "{:?}", mean(&second.points));
    let top = Surface::new(upper.mesh_at(&second.points));
    assert!(intersect::mesh_intersections(&top, &layer).is_empty());
}

#[test]
fn parts_of_one_garment_stack() {
    let low = |x: f64, y: f64| Vec3::new(x, 2.2e-3, y);
    let high = |x: f64, y: f64| Vec3::new(x + 0.013, 8e-3, y + 0.007);
    let garment = patches(6, 0.2, &[&low, &high]);
    let params = Params { frames: 24, damping: 0.3, ..untangling() };
    let out = drape(&garment, &[&ground(0.0)], &[], &params);
    assert!(out.info.converged, "{:?}", out.info);
    assert!(intersect::self_intersections(&Surface::new(garment.mesh_at(&out.points))).is_empty());
    let above = mean(&out.points[49..]).y - mean(&out.points[..49]).y;
    assert!(above > 1e-3 && above < 3e-3, "{above}");
}

#[test]
fn a_start_inside_is_pushed_out() {
    // The cloth cuts through the ball's cap, 8 mm below its top.
    let garment = patches(12, 0.3, &[&|x, y| Vec3::new(x - 0.15, 0.092, y - 0.15)]);
    let ball = sphere(0.1, 12);
    let out = drape(&garment, &[&ball], &[], &untangling());
    assert!(out.info.inside_before > 0 && out.info.crossings_before[0] > 0);
    assert!(out.info.converged && out.info.crossings == [0, 0], "{:?}", out.info);
    let cloth = Surface::new(garment.mesh_at(&out.points));
    assert!(intersect::mesh_intersections(&cloth, &ball).is_empty());
    let again = drape(&garment, &[&ball], &[], &untangling());
    assert!(out.points == again.points, "a rerun gives the same bytes");
}

#[test]
fn bad_input_is_refused() {
    let garment = patches(2, 0.1, &[&|x, y| Vec3::new(x, 0.0, y)]);
    let mut points = garment.points.clone();
    let device = Device::cpu();
    let try_run = |points: &[Vec3], params: &Params| {
        let input = Input { points, ..still(&garment, &[], &[]) };
        run(&device, &input, params).unwrap_err()
    };
    assert!(matches!(try_run(&points[1..], &untangling()), Error::Length { .. }));
    let params = Params { tolerance: f64::NAN, ..untangling() };
    assert!(matches!(try_run(&points, &params), Error::Setting { name: "tolerance", .. }));
    let pinned = Input { pinned: &[9], ..still(&garment, &[], &[]) };
    let refused = run(&device, &pinned, &untangling()).unwrap_err();
    assert!(matches!(refused, Error::Pinned { vertex: 9, .. }));
    points[3].y = f64::INFINITY;
    assert!(matches!(try_run(&points, &untangling()), Error::NotFinite { vertex: 3, .. }));
}

#[test]
fn a_sheet_settles_on_a_ball_and_is_at_rest_by_its_net_force() {
    let garment = patches(8, 0.3, &[&|x, y| Vec3::new(x - 0.15, 0.105, y - 0.15)]);
    let ball = sphere(0.1, 10);
    let colliders = [&ball];
    let params = Params { frames: 0, settle: true, ..Params::default() };
    let output = run(&Device::cpu(), &still(&garment, &colliders, &[]), &params).unwrap();
    let info = &output.info;
    assert!(info.at_rest && info.converged && info.settle_steps > 2, "{info:?}");
    assert!(info.residual <= params.rest_tolerance, "{info:?}");
    assert_eq!(info.crossings, [0, 0]);
    // Its corners hang below the ball's top by most of their length beyond it.
    let lowest = output.points.iter().map(|p| p.y).fold(f64::MAX, f64::min);
    assert!(lowest < 0.05, "{lowest}");
    // From there nothing moves on.
    let again = Input { points: &output.points, ..still(&garment, &colliders, &[]) };
    let second = run(&Device::cpu(), &again, &params).unwrap();
    let apart = output.points.iter().zip(&second.points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(second.info.at_rest && apart < 1e-3, "{apart}");
}
