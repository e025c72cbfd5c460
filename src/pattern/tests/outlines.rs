//! Sewn lengths in all their forms, and what an outline keeps.

use super::*;

/// Without weights and bounds of shape.
fn bare() -> Params {
    let loose = 1e3;
    Params {
        straight_weight: 0.0,
        straight_bound: loose,
        corner_bound: loose,
        mirror: false,
        ..Params::default()
    }
}

/// The garment stretched unevenly, panel by panel, and shaken by a millimetre, node by node.
fn uneven(garment: &Garment) -> Vec<Vec3> {
    let grow = |v: usize| {
        let mut seed = 7919 * (1 + u64::from(garment.groups.node_of_vertex[v]));
        let shake = Vec3::from_fn(|_, _| {
            noise(&mut seed);
            1e-3 * noise(&mut seed)
        });
        let (p, panel) = (garment.points[v], f64::from(garment.panel_of_vertex[v]));
        let (a, b) =
            (1.1 + 0.1 * panel + 0.1 * (7.0 * p.y).sin(), 1.15 - 0.1 * panel + 0.1 * (5.0 * p.x).cos());
        Vec3::new(p.x * a, p.y * b, p.z) + shake
    };
    (0..garment.points.len()).map(grow).collect()
}

fn flat(p: Vec2) -> Vec3 {
    Vec3::new(p.x, p.y, 0.0)
}

#[test]
fn straight_runs_and_corners_stay_within_their_bounds() {
    let (garment, target) = bumpy();
    let (_, free) = run(&garment, &target, &bare()).unwrap();
    assert!(free.shape.straight_deviation_max > 0.012 && free.shape.corner_change_max_deg > 3.2, "{free:?}");
    let params = Params::default();
    let (_, info) = run(&garment, &target, &params).unwrap();
    assert!(info.converged && info.bounds_held > 0, "{info:?}");
    assert!(info.shape.straight_deviation_max < params.straight_bound + 1e-4, "{info:?}");
    assert!(info.shape.corner_change_max_deg < params.corner_bound + 0.01, "{info:?}");
    assert!(info.strain_change_p99 < 2.0 * free.strain_change_p99, "{info:?} {free:?}");
}

#[test]
fn a_bound_that_is_slack_costs_nothing() {
    let (garment, target) = bumpy();
    let wide = Params { straight_bound: 0.5, corner_bound: 90.0, mirror: false, ..Params::default() };
    let wider = Params { straight_bound: 5.0, corner_bound: 170.0, ..wide.clone() };
    let [a, b] = [wide, wider].map(|params| run(&garment, &target, &params).unwrap());
    assert_eq!(a.1.bounds_held, 0);
    assert!(largest_difference(&a.0, &b.0) < 1e-12);
}

#[test]
fn mirrored_panels_stay_mirrored() {
    let mut sheet = Sheet::new(8, 6);
    sheet.panel(Vec2::new(0.0, 0.05), 0.4, 0.3);
    sheet.panel(Vec2::new(0.0, -0.35), 0.4, 0.3);
    // Warp is up, weft is left and right, and the cloth bulges forwards.
    let garment = sheet.garment(|p| Vec3::new(p.y, p.x, 0.8 * p.x * p.x + p.y * p.y));
    assert_eq!(Runs::new(&garment).mirrored.len(), 4, "each edge of one panel has one of the other");
    let mut seed = 5;
    let target: Vec<Vec3> = (garment.points.iter())
        .map(|p| p * 1.2 + Vec3::new(noise(&mut seed), noise(&mut seed), noise(&mut seed)) * 1e-3)
        .collect();
    let apart = |mirror: bool| {
        let (_, info) = run(&garment, &target, &Params { mirror, ..Params::default() }).unwrap();
        assert!(info.converged);
        info.shape.mirror_distance_max_m
    };
    assert!(apart(true) < 1e-7 && apart(false) > 1e-5, "{} {}", apart(true), apart(false));
    // A target that is half as wide again on one side is not symmetric, and is left alone.
    let lopsided: Vec<Vec3> =
        garment.points.iter().map(|p| Vec3::new(if p.x > 0.0 { 1.5 * p.x } else { p.x }, p.y, p.z)).collect();
    let (pattern, _) = run(&garment, &lopsided, &Params::default()).unwrap();
    let Runs { runs, mirrored, .. } = Runs::new(&garment);
    let ratios = mirrored.iter().map(|&[r, s]| runs[r].length(&pattern) / runs[s].length(&pattern));
    assert!(ratios.map(|r| (r - 1.0).abs()).fold(0.0, f64::max) > 0.2);
}

#[test]
fn the_front_of_a_band_is_not_the_mirror_image_of_its_back() {
    let mut sheet = Sheet::new(2, 16);
    sheet.panel(Vec2::new(0.0, 0.0), 0.04, 0.4);
    sheet.panel(Vec2::new(0.0, 1.0), 0.04, 0.4);
    // Two halves of ellipses, the back flatter than the front.
    let garment = sheet.garment(|p| {
        let (half, depth) = if p.y < 0.5 { (p.y, 0.1) } else { (p.y - 1.0, -0.06) };
        let angle = std::f64::consts::PI * half / 0.4;
        Vec3::new(0.15 * angle.cos(), p.x, depth * angle.sin())
    });
    let runs = Runs::new(&garment);
    assert!(!runs.mirrored.is_empty());
    assert!(
        runs.mirrored.iter().all(|&[r, s]| runs.runs[r].panel == runs.runs[s].panel),
        "{:?}",
        runs.mirrored
    );
}

#[test]
fn one_long_edge_meets_several_short_ones() {
    let mut sheet = Sheet::new(6, 6);
    sheet.panel(Vec2::zeros(), 0.4, 0.3);
    let long: Vec<u32> = (0..7).map(|j| j * 7 + 6).collect();
    sheet.rows = 4;
    let (low, high) = (49, 49 + 28);
    sheet.panel(Vec2::new(0.6, 0.0), 0.4, 0.15);
    sheet.panel(Vec2::new(0.6, 0.4), 0.4, 0.15);
    let lower = (0..4).map(|j| [long[j], low + 7 * j as u32]);
    let upper = (0..4).map(|j| [long[j + 3], high + 7 * j as u32]);
    let pairs = lower.chain(upper).collect();
    sheet.source.seams.push(AuthoredSeam { name: "long".into(), pairs, offset: false });
    let garment = sheet.garment(flat);
    check_lengths(&garment, 2);
}

#[test]
fn gathers_keep_their_ease() {
    let mut sheet = Sheet::new(8, 6);
    sheet.panel(Vec2::zeros(), 0.4, 0.3);
    sheet.panel(Vec2::new(0.6, 0.0), 0.4, 0.36);
    sheet.sew(0, 1);
    let garment = sheet.garment(flat);
    let ease = garment.chains()[0].relative_difference(&garment.pattern);
    assert!((ease.abs() - 0.06 / 0.33).abs() < 1e-12);
    let pattern = check_lengths(&garment, 1);
    let kept = garment.chains()[0].relative_difference(&pattern);
    assert!((kept - ease).abs() < 1e-4, "{kept} {ease}");
}

#[test]
fn a_tube_and_a_dart_are_sewn_to_themselves() {
    let mut sheet = strip();
    sheet.sew(0, 0);
    let turn = std::f64::consts::TAU / 0.6;
    let garment = sheet.garment(|p| Vec3::new((p.x * turn).cos() * 0.095, p.y, (p.x * turn).sin() * 0.095));
    check_lengths(&garment, 1);

    // A slit from the middle of the strip to its upper edge, opened to a wedge.
    let mut sheet = strip();
    let open = |p: &mut Vec2| p.x += 0.2 * (p.y - 0.15).max(0.0);
    for corners in &mut sheet.source.corner_pattern {
        let right = corners.iter().map(|p| p.x).sum::<f64>() / 3.0 > 0.3;
        corners.iter_mut().filter(|p| right && (p.x - 0.3).abs() < 1e-9).for_each(open);
    }
    let garment = sheet.garment(flat);
    check_lengths(&garment, 1);
}

/// Refits to an uneven target; chains must be there and keep their lengths' relation.
fn check_lengths(garment: &Garment, chains: usize) -> Vec<Vec2> {
    let target = uneven(garment);
    let open = Params { seam_iterations: 0, ..Params::default() };
    let (_, before) = run(garment, &target, &open).unwrap();
    let (pattern, info) = run(garment, &target, &Params::default()).unwrap();
    assert_eq!(info.chains, chains);
    assert!(before.seam_mismatch_max > 1e-4, "{before:?}");
    assert!(info.converged && info.seam_mismatch_max < 1e-4 && info.flipped_triangles == 0, "{info:?}");
    pattern
}
