//! Made tangles, each small: what starts crossed, inside or pinched ends clean and converged.

use super::*;
use crate::drape::contact::fixed::Fixed;

fn weightless() -> Params {
    Params { gravity: 0.0, frames: 1, ..untangling() }
}

/// A box between two corners, closed, facing outward.
fn cuboid(lo: Vec3, hi: Vec3) -> TriMesh {
    let at = |i: u32, low: f64, high: f64| if i == 0 { low } else { high };
    let points = (0..8u32)
        .map(|i| Vec3::new(at(i & 1, lo.x, hi.x), at(i >> 1 & 1, lo.y, hi.y), at(i >> 2, lo.z, hi.z)))
        .collect();
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    TriMesh { points, triangles }
}

/// The garment of `source`, clean there (its parts' sides are the right ones), draped from where
/// `start` has it.
fn from(source: &Garment, start: &Garment) -> Output {
    assert!(intersect::self_intersections(&Surface::new(source.mesh())).is_empty());
    let input = Input { points: &start.points, ..still(source, &[], &[]) };
    run(&Device::cpu(), &input, &weightless()).unwrap()
}

fn assert_clean(garment: &Garment, out: &Output, colliders: &[&Surface]) {
    assert!(out.info.converged && out.info.crossings == [0, 0], "{:?}", out.info);
    let cloth = Surface::new(garment.mesh_at(&out.points));
    assert!(intersect::self_intersections(&cloth).is_empty());
    for collider in colliders {
        assert!(intersect::mesh_intersections(&cloth, collider).is_empty());
    }
}

#[test]
fn two_sheets_that_cross_in_a_slit_part() {
    // The contour ends on a border of either sheet and cuts nothing off: it has to shrink.
    let flat = |x: f64, y: f64| Vec3::new(x, 0.0, y - 0.0981);
    let up = |x: f64, y: f64| Vec3::new(x - 0.163, y - 0.1013, 0.0007 + 0.05 * x);
    let garment = patches(8, 0.2, &[&flat, &|x, y| up(x, y) - Vec3::x() * 0.1]);
    let out = from(&garment, &patches(8, 0.2, &[&flat, &up]));
    assert!(out.info.crossings_before[1] > 4);
    assert_clean(&garment, &out, &[]);
}

#[test]
fn a_sleeve_through_a_sheet_comes_back_out() {
    // A tube with its end through a sheet: its contour is a loop that keeps its length.
    let tube = |x: f64, y: f64| {
        let turn = std::f64::consts::TAU * y / 0.2 * 0.93;
        Vec3::new(0.028 * turn.cos() + 0.1003, 0.05 - x, 0.028 * turn.sin() + 0.0997)
    };
    let flat = |x: f64, y: f64| Vec3::new(x, -0.1017, y);
    let garment = patches(10, 0.2, &[&tube, &|x, y| flat(x, y) - Vec3::y() * 0.1]);
    let out = from(&garment, &patches(10, 0.2, &[&tube, &flat]));
    assert!(out.info.crossings_before[1] > 10);
    assert_clean(&garment, &out, &[]);
}

#[test]
fn a_cap_ten_centimetres_deep_leaves_the_ball() {
    let cap = |x: f64, y: f64| {
        let (u, v) = ((x - 0.1) * 7.0, (y - 0.1) * 7.0);
        Vec3::new(u, 1.2, v).normalize() * 0.15
    };
    let ball = sphere(0.25, 16);
    let garment = patches(12, 0.2, &[&cap]);
    let params = Params { gravity: 0.0, frames: 2, ..untangling() };
    let out = drape(&garment, &[&ball], &[], &params);
    assert_eq!(out.info.inside_before, 169);
    assert!(out.info.draws > 0 && out.info.draws < 20, "{:?}", out.info);
    assert_clean(&garment, &out, &[&ball]);
    assert!(out.points.iter().all(|p| p.norm() > 0.24 && p.norm() < 0.30));
}

#[test]
fn an_upper_layer_that_starts_below_goes_through() {
    let floor = ground(0.0);
    let lower = patches(8, 0.3, &[&|x, y| Vec3::new(x, 9e-3, y)]);
    let layer = Surface::new(lower.mesh());
    let slope = |x: f64, y: f64| Vec3::new(x + 0.02, 4e-3 + 0.03 * (x - 0.05), y + 0.03);
    let upper = patches(7, 0.25, &[&slope]);
    let out = drape(&upper, &[&floor], &[&layer], &untangling());
    assert!(out.info.inside_before > 0 && out.info.crossings_before[0] > 0);
    assert_clean(&upper, &out, &[&floor, &layer]);
    assert!(out.points.iter().all(|p| p.y > 9e-3), "{:?}", mean(&out.points));
}

#[test]
fn an_upper_layer_goes_over_an_overhanging_fold() {
    // The lower layer stands up in a loop, wider than its foot; the upper one passes through it.
    let fold = |x: f64, z: f64| {
        let turn = std::f64::consts::TAU * ((x - 0.1) / 0.1).clamp(0.0, 1.0);
        Vec3::new(x - 0.05 * turn.sin(), 0.01 + 0.02 * (1.0 - turn.cos()), z)
    };
    let layer = Surface::new(patches(36, 0.3, &[&fold]).mesh());
    assert!(intersect::self_intersections(&layer).is_empty());
    let upper = patches(14, 0.28, &[&|x, z| Vec3::new(x + 0.01, 0.022, z + 0.01)]);
    let out = drape(&upper, &[], &[&layer], &weightless());
    assert!(out.info.crossings_before[0] > 0 && out.info.lifts == 1, "{:?}", out.info);
    assert_clean(&upper, &out, &[&layer]);
    let over_it = out.points.iter().filter(|p| (p.x - 0.15).abs() < 0.03);
    assert!(over_it.clone().count() > 20 && over_it.clone().all(|p| p.y > 0.045));
}

#[test]
fn cloth_pinched_in_a_fold_finds_its_side() {
    // A fold of 3 mm: less than the contact distance on either side.
    let lower = cuboid(Vec3::new(-0.1, -0.1, -0.1), Vec3::new(0.3, 0.0, 0.3));
    let upper = cuboid(Vec3::new(-0.1, 3e-3, -0.1), Vec3::new(0.3, 0.1, 0.3));
    let (lower, upper) = (Surface::new(lower), Surface::new(upper));
    let wave = |x: f64, y: f64| Vec3::new(x, 1.5e-3 + 6e-3 * (40.0 * x).sin() * (35.0 * y).cos(), y);
    let garment = patches(12, 0.2, &[&wave]);
    let out = drape(&garment, &[&lower, &upper], &[], &weightless());
    assert!(out.info.inside_before > 20);
    assert_clean(&garment, &out, &[&lower, &upper]);
    assert!(out.points.iter().all(|p| p.y > 0.0 && p.y < 3e-3));
}

#[test]
fn skin_inside_of_a_body_that_crosses_itself_is_no_way_out() {
    // Two balls that overlap in a lens.
    let centres = [-0.06, 0.06].map(|x| Vec3::new(x, 0.0, 0.0));
    let mut mesh = TriMesh { points: Vec::new(), triangles: Vec::new() };
    for centre in &centres {
        let (ball, first) = (sphere(0.1, 24), mesh.points.len() as u32);
        mesh.points.extend(ball.mesh().points.iter().map(|p| p + centre));
        mesh.triangles.extend(ball.mesh().triangles.iter().map(|t| t.map(|p| p + first)));
    }
    let surface = Surface::new(mesh);
    let body = Fixed::new(&surface, true);
    let at = Vec3::new(0.02, 0.05, 0.0);
    assert!((body.side(&at).point - centres[1]).norm() < 0.08);
    let out = body.way_out(&at, None);
    assert!(out.signed < 0.0 && centres.iter().all(|c| (out.point - c).norm() > 0.09), "{out:?}");
    // In one ball alone, outside of the other, whose skin is the nearest.
    let at = Vec3::new(-0.045, 0.0, 0.0);
    let side = body.side(&at);
    assert!(side.signed > 0.0 && !body.is_inside(&at, &side) && body.is_buried(&at, &side));
    let beside = Vec3::new(0.0, 0.09, 0.0);
    assert!(!body.is_buried(&beside, &body.side(&beside)));
}

#[test]
fn coarse_cloth_over_a_sharp_elbow_crosses_nothing() {
    // Between two vertices of the cloth the wedge's edge would come through.
    let points = [(-0.3, 0.0), (0.3, 0.0), (0.0, 0.35)]
        .iter()
        .flat_map(|&(x, y)| [-0.3, 0.3].map(|z| Vec3::new(x + 0.017, y, z)));
    let triangles =
        vec![[0, 4, 2], [1, 3, 5], [0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 0, 5], [5, 0, 1]];
    let wedge = Surface::new(TriMesh { points: points.collect(), triangles });
    assert!(wedge.is_closed() && wedge.winding_number(&Vec3::new(0.0, 0.1, 0.0)) > 0.5);
    let garment = patches(4, 0.4, &[&|x, y| Vec3::new(x - 0.2, 0.354, y - 0.2)]);
    let params = Params { frames: 8, damping: 0.2, ..untangling() };
    let out = drape(&garment, &[&wedge], &[], &params);
    assert_clean(&garment, &out, &[&wedge]);
    let lowest = out.points.iter().map(|p| p.y).fold(f64::MAX, f64::min);
    assert!(lowest < 0.25, "it hangs over the edge: {lowest}");
}

#[test]
fn from_a_clean_start_nothing_crosses() {
    for seed in 0..4 {
        let turn = |k: f64| (f64::from(seed) * 2.1 + k).sin();
        let first = |x: f64, y: f64| Vec3::new(x - 0.1, 0.13 + 0.1 * turn(1.0) * x, y - 0.1);
        let second =
            |x: f64, y: f64| Vec3::new(x - 0.1 + 0.04 * turn(2.0), 0.19 + 0.2 * turn(3.0) * y, y - 0.12);
        let garment = patches(7, 0.2, &[&first, &second]);
        let ball = sphere(0.1, 10);
        let start = Surface::new(garment.mesh());
        assert!(intersect::self_intersections(&start).is_empty());
        assert!(intersect::mesh_intersections(&start, &ball).is_empty());
        let params = Params { frames: 6, damping: 0.02, ..untangling() };
        let out = drape(&garment, &[&ball], &[], &params);
        assert_clean(&garment, &out, &[&ball]);
    }
}

/// Adds a block over a polygon in x and y that can be seen whole from its first corner.
fn prism(mesh: &mut TriMesh, outline: &[[f64; 2]], z: [f64; 2]) {
    let (first, n) = (mesh.points.len() as u32, outline.len() as u32);
    mesh.points.extend(z.iter().flat_map(|&z| outline.iter().map(move |p| Vec3::new(p[0], p[1], z))));
    let mut add = |t: [u32; 3]| mesh.triangles.push(t.map(|i| first + i));
    for i in 0..n {
        let j = (i + 1) % n;
        add([i, j, n + j]);
        add([i, n + j, n + i]);
    }
    for i in 1..n - 1 {
        add([0, i + 1, i]);
        add([n, n + i, n + i + 1]);
    }
}

#[test]
fn cloth_behind_a_closed_neck_is_carried_out_of_its_slot() {
    // A slot of 5 mm, less than two layers with their distances need, that two ridges close: pushes
    // and loosening alone leave cloth in it.
    let half = 2.5e-3;
    let profile = [
        [-0.1, -0.012],
        [-0.1, -0.08],
        [-half, -0.08],
        [-half, -0.02],
        [1e-3, -0.012],
        [-half, -4e-3],
        [-half, 0.0],
        [-0.1, 0.0],
    ];
    let mut mirrored = profile.map(|[x, y]| [-x, y]);
    mirrored[1..].reverse();
    let mut mesh = TriMesh { points: Vec::new(), triangles: Vec::new() };
    prism(&mut mesh, &profile, [-0.1, 0.2]);
    prism(&mut mesh, &mirrored, [-0.1, 0.2]);
    let body = Surface::new(mesh);
    assert!([-0.05, 0.05].iter().all(|x| body.winding_number(&Vec3::new(*x, -0.02, 0.0)) > 0.9));
    let fold = |x: f64, z: f64| {
        let s = x - 0.035;
        Vec3::new(6e-4 * (s / 4e-3).clamp(-1.0, 1.0), s.abs() - 0.03, z)
    };
    let garment = patches(14, 0.07, &[&fold]);
    let out = drape(&garment, &[&body], &[], &Params { push_steps: 8, ..weightless() });
    assert!(out.info.crossings_before[0] > 100 && out.info.carries == 1, "{:?}", out.info);
    assert_clean(&garment, &out, &[&body]);
    assert!(out.points.iter().all(|p| p.y > 0.0), "all of it is out of the slot");
}
