//! States of rest, and what must not depend on how the scene is turned.

use nalgebra::Rotation3;

use super::*;
use crate::model::AuthoredSeam;

/// Steps of 1/24 s until at rest.
fn settle(simulation: &mut Simulation<'_>) {
    let mut info = Info { converged: true, ..Info::default() };
    for _ in 0..300 {
        advance(simulation, FRAME, 0.3, &mut info, 2).unwrap();
        if simulation.net_force() < 5e-3 {
            break;
        }
    }
    assert!(info.converged && simulation.net_force() < 5e-3, "{}: {info:?}", simulation.net_force());
}

#[test]
fn lifted_and_lowered_hems_come_to_the_same_rest() {
    let size = 0.3;
    let garment = patches(6, size, &[&|x, y| Vec3::new(y, 1.0 - x, 0.0)]);
    let device = Device::cpu();
    let top = row(&garment, 0.0);
    let rest = |place: &dyn Fn(&Vec2) -> Vec3| {
        let points: Vec<Vec3> = garment.pattern.iter().map(place).collect();
        let input = Input { pinned: &top, points: &points, ..still(&garment, &[], &[]) };
        let params = Params { tolerance: 1e-3, ..Params::default() };
        let mut simulation = simulation(&device, &input, &params).unwrap();
        settle(&mut simulation);
        simulation.x
    };
    // The lower half swung up to the front by 140 degrees; pulled down by a tenth.
    let lifted = rest(&|p| {
        let below = (p.x - 0.5 * size).max(0.0);
        let turn = f64::to_radians(140.0);
        Vec3::new(p.y, 1.0 - p.x.min(0.5 * size) - below * turn.cos(), below * turn.sin())
    });
    let lowered = rest(&|p| Vec3::new(p.y, 1.0 - 1.1 * p.x, 0.0));
    let apart = lifted.iter().zip(&lowered).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(apart < 5e-3, "{apart}");
}

/// A sheet with a patch that is sewn on at one side with an offset of 8 mm.
fn pocketed() -> Garment {
    let n = 4;
    let patch = patches(n, 0.2, &[&|x, y| Vec3::new(x, 0.05, y), &|x, y| Vec3::new(x, 0.058, y)]);
    let mut source = GarmentSource {
        name: "pocketed".into(),
        mesh: TriMesh { points: patch.source_points.clone(), triangles: Vec::new() },
        panels: patch.panels.clone(),
        panel_of_triangle: patch.panel_of_triangle.clone(),
        ..GarmentSource::default()
    };
    for t in &patch.triangles {
        source.mesh.triangles.push(t.map(|v| patch.point_of_vertex[v as usize]));
        source.corner_pattern.push(t.map(|v| patch.pattern[v as usize]));
    }
    let first = ((n + 1) * (n + 1)) as u32;
    let pairs = (0..=n as u32).map(|i| [first + i, i]).collect();
    source.seams.push(AuthoredSeam { name: "pocket".into(), pairs, offset: true });
    Garment::from_source(source).unwrap()
}

#[test]
fn a_turned_scene_gives_the_turned_result() {
    let garment = pocketed();
    assert!(garment.groups.has_offset.contains(&true));
    let ball = sphere(0.1, 10);
    let params = Params { tolerance: 1e-3, cg_tolerance: 1e-2, ..Params::default() };
    let device = Device::cpu();
    let result = |turn: &Rotation3<f64>| {
        let points: Vec<Vec3> = garment.points.iter().map(|p| turn * (p + Vec3::y() * 0.06)).collect();
        let mesh = ball.mesh();
        let body = Surface::new(TriMesh {
            points: mesh.points.iter().map(|p| turn * p).collect(),
            triangles: mesh.triangles.clone(),
        });
        let colliders = [&body];
        let input = Input { points: &points, ..still(&garment, &colliders, &[]) };
        let mut simulation = simulation(&device, &input, &params).unwrap();
        simulation.gravity = turn * Vec3::new(0.0, -9.81, 0.0);
        let mut info = Info { converged: true, ..Info::default() };
        for _ in 0..8 {
            advance(&mut simulation, 0.5 * FRAME, 0.1, &mut info, 0).unwrap();
        }
        assert!(info.converged, "{info:?}");
        simulation.offsets.turn(&simulation.x.clone());
        let out = simulation.offsets.vertices(&simulation.x);
        out.iter().map(|p| turn.inverse() * p).collect::<Vec<_>>()
    };
    let upright = result(&Rotation3::identity());
    let moved = upright.iter().zip(&garment.points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(moved > 0.03, "{moved}");
    for axis in [Vec3::x_axis(), Vec3::z_axis()] {
        let turned = result(&Rotation3::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2));
        let apart = upright.iter().zip(&turned).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(apart < 1e-4, "{apart}");
    }
}

/// Of two sheets with short folds, held squeezed to a tenth less, the pressed one comes to rest with
/// smaller bends.
#[test]
fn squeezed_folds_are_pressed_out() {
    let garment = patches(24, 0.3, &[&|x, y| Vec3::new(x, 0.0, y)]);
    let wave = |p: &Vec3| {
        Vec3::new(0.9 * p.x, 0.012 + 0.004 * (std::f64::consts::TAU * p.x / 0.05).cos(), 0.9 * p.z)
    };
    let points: Vec<Vec3> = garment.points.iter().map(wave).collect();
    let floor = ground(0.0);
    let ends = [row(&garment, 0.0), row(&garment, 0.3)].concat();
    let bends = |press: f64| {
        let input = Input { points: &points, pinned: &ends, colliders: &[&floor], ..Input::alone(&garment) };
        let out = run(&Device::cpu(), &input, &Params { press, ..Params::default() }).unwrap();
        assert!(out.info.converged && out.info.at_rest, "{:?}", out.info);
        assert_eq!(out.info.pressed, press);
        let cloth = cloth::Cloth::new(&garment, &garment.pattern, &cloth::Options::default()).unwrap();
        let angles = elastic::Elastic::new(&Device::cpu(), &cloth).unwrap().angles(&out.points);
        (angles.iter().map(|a| a * a).sum::<f64>() / angles.len() as f64).sqrt()
    };
    let (left, pressed) = (bends(1.0), bends(64.0));
    assert!(pressed < 0.95 * left, "{pressed} {left}");
}
