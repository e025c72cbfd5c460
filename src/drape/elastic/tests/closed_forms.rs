//! Closed forms: rigid motion, conserved totals, tension of a strip, cylinders, refinement.

use std::f64::consts::FRAC_PI_4;

use super::super::element::NONE;
use super::super::judge::Judge;
use super::*;

fn rigid(p: &Vec3) -> Vec3 {
    nalgebra::Rotation3::from_euler_angles(1.1, -0.7, 2.4) * p + Vec3::new(-3.0, 1.4, 8.0)
}

#[test]
fn rigid_motion_makes_no_force() {
    let sheet = garment_of(&panel(6, 5, 0.02, Split::Irregular, 0.3), &Fabric::default(), flat);
    for garment in [sheet, sewn(4, 0.02, 2.0)] {
        let judge = Judge::new(&cloth_of(&garment));
        let points: Vec<Vec3> = garment.points.iter().map(rigid).collect();
        let (energy, gradient) = judge.judge(&points);
        let largest = gradient.iter().map(|g| g.norm()).fold(0.0, f64::max);
        // Rounding at 10 m: 1e-15 / 0.02 in strain, times 1200 N/m times 0.02 m.
        assert!(energy < 1e-18 && largest < 1e-9, "{energy:e} J, {largest:e} N");
    }
}

#[test]
fn forces_have_neither_resultant_nor_torque() {
    let sheet = garment_of(&panel(6, 5, 0.02, Split::Irregular, 0.3), &Fabric::default(), flat);
    for garment in [sheet, sewn(4, 0.02, 2.0)] {
        let mut noise = Noise(5);
        let moved: Vec<Vec3> = (0..garment.groups.node_count).map(|_| noise.vec3(0.008)).collect();
        let nodes = garment.groups.node_points(&garment.points);
        let points: Vec<Vec3> =
            garment.groups.node_of_vertex.iter().map(|&n| nodes[n as usize] + moved[n as usize]).collect();
        let (_, gradient) = Judge::new(&cloth_of(&garment)).judge(&points);
        let size: f64 = gradient.iter().map(|g| g.norm()).sum();
        let force: Vec3 = gradient.iter().sum();
        let torque: Vec3 =
            gradient.iter().zip(garment.groups.node_points(&points)).map(|(g, p)| p.cross(g)).sum();
        assert!(size > 1.0 && force.norm() < 1e-12 * size && torque.norm() < 1e-12 * size);
    }
}

#[test]
fn energy_does_not_depend_on_how_triangles_are_turned() {
    let (pattern, triangles) = panel(6, 5, 0.02, Split::Irregular, 0.3);
    let place = rolled(12.0, 0.5);
    let energy = |turn: &dyn Fn(usize, [u32; 3]) -> [u32; 3]| {
        let turned = triangles.iter().enumerate().map(|(t, &tri)| turn(t, tri)).collect();
        let garment = garment_of(&(pattern.clone(), turned), &Fabric::default(), &place);
        Judge::new(&cloth_of(&garment)).judge(&garment.points).0
    };
    let expected = energy(&|_, tri| tri);
    let [a, b, c] = [0, 1, 2];
    let same = [
        energy(&|_, tri| [tri[b], tri[c], tri[a]]),
        energy(&|_, tri| [tri[a], tri[c], tri[b]]),
        energy(&|t, tri| if t % 3 == 0 { [tri[c], tri[b], tri[a]] } else { tri }),
    ];
    for other in same {
        assert!((other - expected).abs() < 1e-12 * expected, "{other} {expected}");
    }
}

#[test]
fn energy_does_not_depend_on_the_side_of_a_panel() {
    let (mut pattern, triangles) = panel(6, 5, 0.02, Split::Irregular, 0.3);
    let place = rolled(12.0, 0.5);
    let garment = garment_of(&(pattern.clone(), triangles.clone()), &Fabric::default(), &place);
    let expected = Judge::new(&cloth_of(&garment)).judge(&garment.points).0;
    for p in &mut pattern {
        p.y = -p.y; // the panel laid face down
    }
    let unmirrored = |p: &Vec2| place(&Vec2::new(p.x, -p.y));
    let garment = garment_of(&(pattern, triangles), &Fabric::default(), unmirrored);
    let found = Judge::new(&cloth_of(&garment)).judge(&garment.points).0;
    assert!((found - expected).abs() < 1e-12 * expected, "{found} {expected}");
}

#[test]
fn strip_in_tension_pulls_with_stiffness_times_strain_times_width() {
    let fabric = Fabric::default();
    let (length, width, strain) = (0.2, 0.06, 0.03);
    for split in [Split::Diagonal, Split::Alternating, Split::Irregular] {
        for (turn, stiffness) in [(0.0, fabric.stretch_warp), (2.0 * FRAC_PI_4, fabric.stretch_weft)] {
            let garment = garment_of(&panel(20, 6, 0.01, split, turn), &fabric, flat);
            let along = Vec3::new(f64::cos(turn), 0.0, f64::sin(turn));
            let points: Vec<Vec3> =
                garment.points.iter().map(|p| p + along * (strain * p.dot(&along))).collect();
            let (energy, gradient) = Judge::new(&cloth_of(&garment)).judge(&points);
            let expected = stiffness * strain * width;
            let nodes = garment.groups.node_points(&garment.points);
            let end = gradient.iter().zip(&nodes).filter(|(_, p)| p.dot(&along) > length - 1e-9);
            let force: f64 = end.map(|(g, _)| g.dot(&along)).sum();
            let inside = gradient
                .iter()
                .zip(&nodes)
                .filter(|(_, p)| p.dot(&along) > 1e-9 && p.dot(&along) < length - 1e-9);
            let unbalanced = inside.map(|(g, _)| g.norm()).fold(0.0, f64::max);
            assert!((force - expected).abs() < 1e-9 * expected, "{split:?}: {force} N, {expected} N");
            assert!((energy - 0.5 * expected * strain * length).abs() < 1e-9 * energy);
            assert!(unbalanced < 1e-9 * expected, "{split:?}: {unbalanced:e} N inside");
        }
    }
}

/// Mean and largest relative error of the bending energy of triangles whose hinges are all
/// there, on a cylinder of curvature `kappa` in the panel's direction `angle`.
fn cylinder_error(mesh: &(Vec<Vec2>, Vec<[u32; 3]>), kappa: f64, angle: f64) -> (f64, f64) {
    let fabric = bending_only();
    let garment = garment_of(mesh, &fabric, rolled(kappa, angle));
    let cloth = cloth_of(&garment);
    let judge = Judge::new(&cloth);
    let amounts = judge.measure(&garment.points).amounts;
    let (c, s) = (angle.cos().powi(2), angle.sin().powi(2));
    let stiffness = fabric.bending_warp * c * c + fabric.bending_weft * s * s + fabric.bending_shear * c * s;
    let (mut energy, mut expected, mut largest) = (0.0, 0.0, 0.0f64);
    for (t, element) in judge.elements.iter().enumerate() {
        if !element.hinges.contains(&NONE) {
            let exact = 0.5 * stiffness * kappa * kappa * cloth.areas[t];
            let found: f64 = amounts[t].iter().map(|c| 0.5 * c * c).sum();
            energy += found;
            expected += exact;
            largest = largest.max((found / exact - 1.0).abs());
        }
    }
    (energy / expected - 1.0, largest)
}

/// Directions of curvature: warp, weft, two biases.
const DIRECTIONS: [f64; 4] = [0.0, 2.0 * FRAC_PI_4, FRAC_PI_4, -FRAC_PI_4];

#[test]
fn cylinders_are_exact_on_lattices() {
    for split in [Split::Diagonal, Split::Equilateral] {
        for turn in [0.0, 0.4, FRAC_PI_4] {
            let mesh = panel(12, 12, 0.01, split, turn);
            for angle in DIRECTIONS {
                // Edges are chords: an error of (kappa h)^2 / 12 and its like.
                let (_, largest) = cylinder_error(&mesh, 2.0, angle);
                assert!(largest < 1e-3, "{split:?} turned {turn}, direction {angle}: {largest:e}");
            }
        }
    }
}

#[test]
fn cylinders_are_exact_on_rows_of_any_width() {
    // Columns of widths 1, 2, 1, 2, ... along the curvature: halving every angle would be
    // off by a third in either direction.
    let (mut pattern, triangles) = panel(12, 8, 0.01, Split::Diagonal, 0.0);
    for p in &mut pattern {
        let column = (p.x / 0.01).round() as usize;
        p.x = 0.01 * (column + column / 2) as f64;
    }
    let (_, largest) = cylinder_error(&(pattern, triangles), 2.0, 0.0);
    assert!(largest < 1e-3, "{largest:e}");
}

#[test]
fn refinement_converges() {
    // The whole sheet, border included: hinges are missing along it, so bending is of first
    // order. A smooth stretch is of second order.
    let side = 0.16;
    let mut errors = Vec::new();
    for n in [8usize, 16, 32] {
        let mesh = panel(n, n, side / n as f64, Split::Equilateral, 0.0);
        let area: f64 = 0.75f64.sqrt() * side * side;
        let fabric = bending_only();
        let garment = garment_of(&mesh, &fabric, rolled(5.0, 0.0));
        let bending = Judge::new(&cloth_of(&garment)).judge(&garment.points).0;
        let exact_bending = 0.5 * fabric.bending_warp * 25.0 * area;
        let mesh = panel(n, n, side / n as f64, Split::Irregular, 0.0);
        let garment = garment_of(&mesh, &Fabric::default(), |p: &Vec2| Vec3::new(p.x + p.x * p.x, 0.0, p.y));
        let stretch = Judge::new(&cloth_of(&garment)).judge(&garment.points).0;
        // |F_w| - 1 = 2 x.
        let exact_stretch = 0.5 * Fabric::default().stretch_warp * 4.0 * side.powi(3) / 3.0 * side;
        errors.push([bending / exact_bending - 1.0, stretch / exact_stretch - 1.0].map(f64::abs));
    }
    for pair in errors.windows(2) {
        assert!(pair[1][0] < 0.6 * pair[0][0], "bending {errors:?}");
        assert!(pair[1][1] < 0.35 * pair[0][1], "stretch {errors:?}");
    }
}

#[test]
fn seam_keeps_its_source_angle_and_resists_others() {
    for fold in [0.0, 0.9, 2.9] {
        let garment = sewn(4, 0.02, fold);
        let cloth = cloth_of(&garment);
        let seams: Vec<_> = cloth.hinges.iter().filter(|h| h.seam).collect();
        assert_eq!(seams.len(), 4);
        assert!(seams.iter().all(|h| (h.rest_angle.abs() - fold).abs() < 1e-12));
        let judge = Judge::new(&cloth);
        assert!(judge.judge(&garment.points).0 < 1e-20);
        // Opened by 0.2: the spring's energy, half the angle squared times the stiffness of
        // each edge; both sides have the area h^2 / 2 and the panels' directions differ.
        let open = judge.judge(&sewn(4, 0.02, fold + 0.2).points).0;
        let fabric = Fabric::default();
        let k = 0.5 * (fabric.bending_warp + fabric.bending_weft) * cloth.options.seam_bending;
        assert!((open - 4.0 * 0.5 * k * 0.2 * 0.2).abs() < 1e-9 * open, "{fold}: {open:e}");
    }
}
