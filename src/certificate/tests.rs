use std::f64::consts::FRAC_PI_4;

use super::*;
use crate::model::{AuthoredSeam, GarmentSource, Panel, TriMesh};

/// A sheet of two panels, `n` by `n` cells of side `h` each, side by side in x and sewn; with a
/// patch of one cell sewn onto the first panel 3 mm above it.
fn sheet(n: usize, h: f64, patch: bool) -> Garment {
    let mut source = GarmentSource { name: "Sheet".into(), path: "/Sheet".into(), ..Default::default() };
    let mut seam = AuthoredSeam { name: "middle".into(), pairs: Vec::new(), offset: false };
    for panel in 0..2u32 {
        let first = source.mesh.points.len() as u32;
        let index = |i: usize, j: usize| first + (i * (n + 1) + j) as u32;
        for i in 0..=n {
            for j in 0..=n {
                let x = panel as f64 * n as f64 * h + i as f64 * h;
                source.mesh.points.push(Vec3::new(x, 0.0, j as f64 * h));
            }
        }
        for i in 0..n {
            for j in 0..n {
                let (a, b, c, d) = (index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j));
                push(&mut source, panel, &[[a, b, c], [a, c, d]]);
            }
        }
        source.panels.push(Panel::default());
    }
    let stride = (n + 1) as u32;
    for j in 0..stride {
        seam.pairs.push([n as u32 * stride + j, stride * stride + j]);
    }
    source.seams.push(seam);
    if patch {
        let first = source.mesh.points.len() as u32;
        let under = [0, 1, stride + 1, stride];
        for &u in &under {
            let p = source.mesh.points[u as usize] + Vec3::new(0.0, 0.003, 0.0);
            source.mesh.points.push(p);
        }
        push(&mut source, 2, &[[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        source.panels.push(Panel::default());
        let pairs = (0..4).map(|k| [first + k, under[k as usize]]).collect();
        source.seams.push(AuthoredSeam { name: "patch".into(), pairs, offset: true });
    }
    Garment::from_source(source).expect("well formed")
}

/// Warp along -z and weft along x, so that panels are seen from above.
fn push(source: &mut GarmentSource, panel: u32, triangles: &[[u32; 3]]) {
    for tri in triangles {
        let corner = |i: u32| {
            let p = source.mesh.points[i as usize];
            Vec2::new(-p.z, -p.x)
        };
        source.corner_pattern.push(tri.map(corner));
        source.mesh.triangles.push(*tri);
        source.panel_of_triangle.push(panel);
    }
}

fn dressed(garment: &Garment) -> Dressed<'_> {
    let (points, pattern) = (&garment.points, &garment.pattern);
    Dressed { garment, points, pattern, skin: None, offsets: None, bound: None }
}

/// A box from `lo` to `hi`, closed, seen from outside.
fn block(lo: Vec3, hi: Vec3) -> Surface {
    let pick = |bit: usize, k: usize, c: usize| if c >> bit & 1 == 1 { hi[k] } else { lo[k] };
    let points = (0..8).map(|c| Vec3::new(pick(0, 0, c), pick(1, 1, c), pick(2, 2, c))).collect();
    let quads: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Surface::new(TriMesh { points, triangles })
}

fn rigid(garment: &Garment) -> Skin {
    let n = garment.points.len();
    Skin { influences: 1, joint_indices: vec![0; n], joint_weights: vec![1.0; n] }
}

fn one(garment: &Garment, points: &[Vec3], skin: Option<&Skin>, body: &Surface) -> Certificate {
    let pattern = &garment.pattern;
    let dressed = Dressed { garment, points, pattern, skin, offsets: None, bound: None };
    let input = Input { body, source_bodies: &[body], garments: &[dressed] };
    measure(&input).remove(0)
}

fn far_block() -> Surface {
    block(Vec3::new(0.0, -2.0, 0.0), Vec3::new(1.0, -1.0, 1.0))
}

#[test]
fn the_source_on_its_own_body_is_faultless() {
    let garment = sheet(4, 0.05, true);
    let skin = rigid(&garment);
    let certificate = one(&garment, &garment.points, Some(&skin), &far_block());
    let expected = Certificate {
        weight_sum_error_max: Some(0.0),
        seam_weight_error_max: Some(0.0),
        strain_warp: certificate.strain_warp,
        strain_weft: certificate.strain_weft,
        strain_shear: certificate.strain_shear,
        ..Certificate::default()
    };
    assert_eq!(certificate, expected);
    let strains = [certificate.strain_warp, certificate.strain_weft, certificate.strain_shear];
    assert!(strains.iter().flatten().all(|s| s.abs() < 1e-13), "{strains:?}");
}

#[test]
fn a_stretched_sheet_has_its_strain() {
    let garment = sheet(4, 0.05, false);
    // 10 % along x, which is the weft; sheared by 0.2 along the warp.
    let points: Vec<Vec3> =
        garment.points.iter().map(|p| Vec3::new(1.1 * p.x, 0.0, p.z + 0.2 * p.x)).collect();
    let c = one(&garment, &points, None, &far_block());
    let weft = 1.1f64.hypot(0.2);
    for k in 0..3 {
        assert!(c.strain_warp[k].abs() < 1e-12);
        assert!((c.strain_weft[k] - (weft - 1.0)).abs() < 1e-12);
        assert!((c.strain_shear[k] - 0.2 / weft).abs() < 1e-12);
    }
    let f = nalgebra::Matrix2::new(1.0, 0.2, 0.0, 1.1);
    let svd = f.svd(true, true);
    let v = svd.v_t.expect("asked for");
    let s = v.transpose() * nalgebra::Matrix2::from_diagonal(&svd.singular_values) * v;
    assert!((c.strain_change_p99 - (s - nalgebra::Matrix2::identity()).amax()).abs() < 1e-12);
    assert_eq!(c.weight_sum_error_max, None);
}

#[test]
fn folds_are_measured_inside_of_panels() {
    let garment = sheet(2, 0.1, false);
    // Bent by a right angle at the seam (which does not count), and by half of it at x = 0.1.
    let turned = |p: &Vec3| {
        let (a, b) = ((p.x - 0.1).clamp(0.0, 0.1), (p.x - 0.2).max(0.0));
        let (c, s) = (FRAC_PI_4.cos(), FRAC_PI_4.sin());
        Vec3::new(p.x.min(0.1) + a * c - b * s, a * s + b * c, p.z)
    };
    let points: Vec<Vec3> = garment.points.iter().map(turned).collect();
    let c = one(&garment, &points, None, &far_block());
    // Of the 8 inner edges of each panel 2 are bent, in the first panel only.
    assert!((c.fold_angle_rms - FRAC_PI_4 * (2.0f64 / 16.0).sqrt()).abs() < 1e-12, "{}", c.fold_angle_rms);
    assert_eq!(c.source_fold_angle_rms, 0.0);
}

#[test]
fn crossing_the_body_is_counted_and_its_depth_measured() {
    let garment = sheet(4, 0.05, false);
    let body = block(Vec3::new(0.12, -1.0, 0.06), Vec3::new(0.28, 0.03, 0.14));
    let c = one(&garment, &garment.points, None, &body);
    assert!(c.body_intersections > 0);
    assert_eq!(c.body_intersections, c.source_body_intersections);
    // The points at z = 0.10 and x = 0.15 .. 0.25 are 3 cm below the top, which is nearest.
    assert!((c.body_penetration_max_m - 0.03).abs() < 1e-12, "{}", c.body_penetration_max_m);
    let lifted: Vec<Vec3> = garment.points.iter().map(|p| p + Vec3::y() * 0.031).collect();
    let c = one(&garment, &lifted, None, &body);
    assert_eq!((c.body_intersections, c.body_penetration_max_m), (0, 0.0));
    assert!(c.source_body_intersections > 0);
}

#[test]
fn a_sheet_folded_through_itself_is_counted() {
    let garment = sheet(4, 0.05, false);
    // Rolled up until the end has passed through the start.
    let rolled: Vec<Vec3> = garment
        .points
        .iter()
        .map(|p| {
            let (angle, radius) = (p.x / 0.4 * 7.0, 0.0571 + 0.03 * (p.x / 0.4 - 0.5) * (p.z - 0.1) / 0.1);
            Vec3::new(radius * angle.cos(), radius * angle.sin(), p.z)
        })
        .collect();
    let c = one(&garment, &rolled, None, &far_block());
    assert!(c.self_intersections > 0);
    assert_eq!(c.source_self_intersections, 0);
    assert_eq!(c.seam_gap_max_m, 0.0);
}

#[test]
fn layers_are_counted_on_both_sides_and_per_source_body() {
    let (flat, mut upright) = (sheet(3, 0.05, false), sheet(3, 0.05, false));
    let through = |p: &Vec3| Vec3::new(p.x, p.z - 0.07, 0.08);
    upright.points.iter_mut().for_each(|p| *p = through(p));
    let body = far_block();
    let both = [dressed(&flat), dressed(&upright)];
    let c = measure(&Input { body: &body, source_bodies: &[&body], garments: &both });
    assert!(c[0].layer_intersections > 0);
    assert_eq!(c[0].layer_intersections, c[1].layer_intersections);
    assert_eq!(c[0].source_layer_intersections, c[0].layer_intersections);
    // Authored on two bodies, they never met before.
    upright.body = 1;
    let both = [dressed(&flat), dressed(&upright)];
    let c = measure(&Input { body: &body, source_bodies: &[&body, &body], garments: &both });
    assert!(c[0].layer_intersections > 0);
    assert_eq!(c[0].source_layer_intersections, 0);
}

#[test]
fn seams_that_open_and_offsets_that_change_are_found() {
    let garment = sheet(2, 0.05, true);
    let groups = &garment.groups;
    let body = far_block();
    let mut points = garment.points.clone();
    let sewn = (0..points.len())
        .rev()
        .find(|&v| (0..v).any(|w| groups.weld_of_vertex[w] == groups.weld_of_vertex[v]))
        .expect("the panels are sewn");
    points[sewn].z += 2e-4;
    assert!((one(&garment, &points, None, &body).seam_gap_max_m - 2e-4).abs() < 1e-12);
    let mut points = garment.points.clone();
    let patched = groups.has_offset.iter().position(|&o| o).expect("the patch has an offset");
    let node = points[groups.anchor_of_node[groups.node_of_vertex[patched] as usize] as usize];
    let length = (points[patched] - node).norm();
    points[patched] = node + Vec3::x() * length; // turned with the cloth: no gap
    assert!(one(&garment, &points, None, &body).seam_gap_max_m < 1e-12);
    points[patched] = node + Vec3::x() * (length + 5e-4);
    assert!((one(&garment, &points, None, &body).seam_gap_max_m - 5e-4).abs() < 1e-12);
}

#[test]
fn weights_are_judged() {
    let garment = sheet(2, 0.05, true);
    let body = far_block();
    let n = garment.points.len();
    let mut skin =
        Skin { influences: 2, joint_indices: [3, 5].repeat(n), joint_weights: [0.75, 0.25].repeat(n) };
    // The same weights in another order are the same weights.
    let last = 2 * n - 2;
    skin.joint_indices.swap(last, last + 1);
    skin.joint_weights.swap(last, last + 1);
    let c = one(&garment, &garment.points, Some(&skin), &body);
    assert_eq!((c.weight_sum_error_max, c.seam_weight_error_max), (Some(0.0), Some(0.0)));
    // The last vertex belongs to the patch, which is sewn onto the sheet.
    skin.joint_weights[last] += 0.125;
    let c = one(&garment, &garment.points, Some(&skin), &body);
    assert_eq!((c.weight_sum_error_max, c.seam_weight_error_max), (Some(0.125), Some(0.125)));
    skin.joint_weights[last] = f64::NAN;
    let c = one(&garment, &garment.points, Some(&skin), &body);
    assert_eq!(c.weight_sum_error_max, Some(f64::INFINITY));
}

#[test]
fn positions_that_are_not_finite_never_pass() {
    let garment = sheet(2, 0.05, false);
    let mut points = garment.points.clone();
    points[3].x = f64::NAN;
    let c = one(&garment, &points, None, &far_block());
    assert_eq!(c.body_penetration_max_m, f64::INFINITY);
    assert_eq!(c.seam_gap_max_m, f64::INFINITY);
    assert!(!Thresholds::default().broken("Sheet", &c, &StageFigures::default()).is_empty());
}

#[test]
fn the_keys_are_those_of_the_contract() {
    let json = serde_json::to_value(Certificate::default()).expect("plain data");
    let keys: Vec<&str> = json.as_object().expect("an object").keys().map(String::as_str).collect();
    for key in [
        "body_intersections",
        "body_penetration_max_m",
        "layer_intersections",
        "self_intersections",
        "strain_warp",
        "strain_weft",
        "strain_shear",
        "strain_change_p99",
        "source_self_intersections",
        "seam_gap_max_m",
        "weight_sum_error_max",
        "seam_weight_error_max",
    ] {
        assert!(keys.contains(&key), "{key}");
    }
}
