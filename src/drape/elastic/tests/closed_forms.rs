//! Closed forms: rigid motion, conserved totals, tension of a strip, cylinders, refinement.

use std::f64::consts::FRAC_PI_4;

use super::super::element::{self, NONE};
use super::super::hinge;
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

/// The bending stiffness of a flat sheet against displacements across it (linearised), and
/// the sheet's garment and cloth.
fn plate(mesh: &(Vec<Vec2>, Vec<[u32; 3]>), fabric: &Fabric) -> (nalgebra::DMatrix<f64>, Garment, Cloth) {
    let garment = garment_of(mesh, fabric, flat);
    let cloth = cloth_of(&garment);
    let judge = Judge::new(&cloth);
    let edges = judge.measure(&garment.points).hinge_edges;
    let mut stiffness = nalgebra::DMatrix::zeros(cloth.node_count, cloth.node_count);
    for (e, element) in judge.elements.iter().enumerate() {
        let rows = element::amount_gradients(&element.hinges, &judge.weights[e], |i| {
            let [a, b, c] = &edges[i];
            hinge::gradient(&judge.hinge_rest[i], a, b, c)
        });
        for (i, &a) in element.nodes.iter().enumerate().filter(|(_, n)| **n != NONE) {
            for (j, &b) in element.nodes.iter().enumerate().filter(|(_, n)| **n != NONE) {
                stiffness[(a as usize, b as usize)] +=
                    (0..3).map(|r| rows[i][r].y * rows[j][r].y).sum::<f64>();
            }
        }
    }
    (stiffness, garment, cloth)
}

/// Energy of a sheet that takes its own shape inside of a border of two rows held on a
/// parabolic cylinder with the unit curvature direction `angle`, over that of the cylinder.
fn relaxed(n: usize, split: Split, angle: f64) -> (f64, f64) {
    let fabric = bending_only();
    let side = 0.24;
    let h = side / n as f64;
    let (stiffness, garment, cloth) = plate(&panel(n, n, h, split, 0.0), &fabric);
    let exact = nalgebra::DVector::from_iterator(
        cloth.node_count,
        garment
            .groups
            .node_points(&garment.points)
            .iter()
            .map(|p| 0.5 * (p.x * angle.cos() + p.z * angle.sin()).powi(2)),
    );
    let inner: Vec<usize> = (0..cloth.node_count)
        .filter(|&v| {
            let p = garment.points[garment.groups.anchor_of_node[v] as usize];
            let rows = |x: f64| (x / h).min((side - x) / h);
            rows(p.x).min(rows(p.z)) > 1.5
        })
        .collect();
    let force = -(&stiffness * &exact).select_rows(&inner);
    let reduced = stiffness.select_rows(&inner).select_columns(&inner);
    let moved = reduced.cholesky().expect("held").solve(&force);
    let mut found = exact.clone();
    for (i, &v) in inner.iter().enumerate() {
        found[v] += moved[i];
    }
    let (c, s) = (angle.cos().powi(2), angle.sin().powi(2));
    let k = fabric.bending_warp * c * c + fabric.bending_weft * s * s + fabric.bending_shear * c * s;
    // Triangles at the border lack hinges: leave their part out of the comparison.
    let energy = |z: &nalgebra::DVector<f64>| 0.5 * (z.transpose() * &stiffness * z)[0];
    let exact_energy = 0.5 * k * side * side;
    (energy(&exact) / exact_energy, energy(&found) / exact_energy)
}

#[test]
fn relaxed_sheet_keeps_the_energy_of_a_cylinder() {
    for (split, low, high) in [(Split::Diagonal, 0.95, 1.001), (Split::Irregular, 0.94, 1.06)] {
        for angle in DIRECTIONS {
            let (held, relaxed) = relaxed(24, split, angle);
            assert!(
                low < relaxed && relaxed < high && held < 1.1 && relaxed <= held + 1e-9,
                "{split:?} {angle}: {held} {relaxed}"
            );
        }
    }
    // Alternating diagonals: exact along the grid, too stiff across its bias by a factor that
    // is known and bounded, and without soft modes.
    for angle in DIRECTIONS {
        let (held, relaxed) = relaxed(24, Split::Alternating, angle);
        assert!(relaxed > 0.95 && held < 1.9, "{angle}: {held} {relaxed}");
    }
}

/// Deflection of the free end of a clamped strip under a small uniform load over that of
/// Euler's beam, `q L^4 / (8 k)`, from the bending energy linearised about the flat strip.
fn cantilever(n: usize, split: Split, turn: f64) -> f64 {
    let (length, load) = (0.16, 1e-3);
    let k = 3e-5;
    let fabric = Fabric { bending_warp: k, bending_weft: k, bending_shear: 2.0 * k, ..bending_only() };
    let h = length / n as f64;
    let (stiffness, garment, cloth) = plate(&panel(n + 1, n / 2, h, split, turn), &fabric);
    let nodes = cloth.node_count;
    // Along the strip, from the clamp: the first column of quads is held.
    let along = |node: usize| {
        let p = garment.points[garment.groups.anchor_of_node[node] as usize];
        p.x * turn.cos() + p.z * turn.sin() - h
    };
    let free: Vec<usize> = (0..nodes).filter(|&node| along(node) > 1e-9).collect();
    let reduced = stiffness.select_rows(&free).select_columns(&free);
    let density = Fabric::default().density;
    let weights =
        nalgebra::DVector::from_iterator(free.len(), free.iter().map(|&n| cloth.masses[n] / density * load));
    let deflection = reduced.cholesky().expect("clamped").solve(&weights);
    let tips: Vec<f64> =
        (0..free.len()).filter(|&i| along(free[i]) > length - 1e-9).map(|i| deflection[i]).collect();
    let mean = tips.iter().sum::<f64>() / tips.len() as f64;
    mean / (load * length.powi(4) / (8.0 * k))
}

#[test]
fn cantilever_deflects_as_eulers_beam() {
    for split in [Split::Diagonal, Split::Alternating, Split::Irregular] {
        for turn in [0.0, 0.5] {
            // Soft by the triangles at the clamp and the free end: first order.
            let errors = [8, 16, 32].map(|n| cantilever(n, split, turn) - 1.0);
            assert!(errors[2] > 0.0 && errors[2] < 0.1, "{split:?} {turn}: {errors:?}");
            assert!(
                errors[1] < 0.6 * errors[0] && errors[2] < 0.6 * errors[1],
                "{split:?} {turn}: {errors:?}"
            );
        }
    }
}
