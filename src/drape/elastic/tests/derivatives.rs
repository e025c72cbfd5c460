//! Gradients and Hessians against finite differences, in `f64`, near-degenerate ones too.

use nalgebra::{DMatrix, Matrix6, Vector6};

use super::super::hinge::{self, HingeRest};
use super::super::judge::Judge;
use super::super::stretch::{self, Stretch, StretchRest};
use super::*;

/// Step of central differences; their error is about `STEP^2` times third derivatives.
pub(super) const STEP: f64 = 1e-5;

/// Deformation gradients: flat, stretched, compressed, collapsed nearly, sheared nearly to
/// parallel columns, both ways.
pub(super) fn deformations() -> Vec<[Vec3; 2]> {
    let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
    vec![
        [x, y],
        [x * 1.01 + y * 0.02, y * 0.99],
        [x * 3.0 + z, y * 2.5 - z * 0.5],
        [x * 0.3, y * 0.4 + z * 0.1],
        [x * 0.05, y],
        [x, x * 0.98 + y * 0.05],
        [x, -x * 0.98 + y * 0.05],
        [x * 0.7 + y * 0.4 - z * 0.2, x * 0.5 - y * 0.9 + z * 0.3],
    ]
}

pub(super) fn rest(stiffness: [f64; 3]) -> StretchRest<f64> {
    StretchRest { shape: [[1.0, 0.0], [0.0, 1.0]], stiffness }
}

pub(super) fn at(columns: [Vec3; 2]) -> Stretch<f64> {
    stretch::stretch(&stretch::reference(columns), [Vec3::zeros(); 2])
}

pub(super) fn moved(columns: &[Vec3; 2], k: usize, by: f64) -> [Vec3; 2] {
    let mut moved = *columns;
    moved[k / 3][k % 3] += by;
    moved
}

#[test]
fn stretch_gradient_is_the_energys() {
    let rest = rest([3.0, 2.0, 0.7]);
    for f in deformations() {
        let [w, t] = stretch::gradient(&rest, &at(f));
        let gradient = Vector6::new(w.x, w.y, w.z, t.x, t.y, t.z);
        for k in 0..6 {
            let energy = |by| stretch::energy(&rest, &at(moved(&f, k, by)));
            let difference = (energy(STEP) - energy(-STEP)) / (2.0 * STEP);
            assert!((difference - gradient[k]).abs() < 1e-8 * (1.0 + gradient.norm()), "{f:?} {k}");
        }
    }
}

#[test]
fn stretch_hessian_is_the_gradients_without_negative_eigenvalues() {
    // Each term is filtered for itself, so each is compared for itself.
    for stiffness in [[3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.7]] {
        let rest = rest(stiffness);
        for f in deformations() {
            let mut difference = Matrix6::zeros();
            for k in 0..6 {
                let [a, b] = [STEP, -STEP].map(|by| stretch::gradient(&rest, &at(moved(&f, k, by))));
                for r in 0..6 {
                    difference[(r, k)] = (a[r / 3][r % 3] - b[r / 3][r % 3]) / (2.0 * STEP);
                }
            }
            let mut eigen = ((difference + difference.transpose()) * 0.5).symmetric_eigen();
            eigen.eigenvalues.apply(|value| *value = value.max(0.0));
            let expected = eigen.recompose();
            let [ww, wf, ff] = stretch::hessian(&rest, &at(f));
            let mut hessian = Matrix6::zeros();
            hessian.fixed_view_mut::<3, 3>(0, 0).copy_from(&ww);
            hessian.fixed_view_mut::<3, 3>(0, 3).copy_from(&wf);
            hessian.fixed_view_mut::<3, 3>(3, 0).copy_from(&wf.transpose());
            hessian.fixed_view_mut::<3, 3>(3, 3).copy_from(&ff);
            // Third derivatives are at most k / |F_w|^2, and the step's error their change.
            let smallest = f[0].norm().min(f[1].norm());
            let tolerance = 1e-8 * (1.0 + difference.norm()) / smallest.powi(3).min(1.0);
            let error = (hessian - expected).abs().max();
            assert!(error < tolerance, "{stiffness:?} {f:?}: {error:e}");
        }
    }
}

#[test]
fn collapsed_triangle_has_finite_derivatives() {
    let rest = rest([3.0, 2.0, 0.7]);
    for f in [[Vec3::zeros(); 2], [Vec3::x(), Vec3::zeros()], [Vec3::x(), Vec3::x()]] {
        let s = at(f);
        let [ww, wf, ff] = stretch::hessian(&rest, &s);
        let finite = |m: &nalgebra::Matrix3<f64>| m.iter().all(|x| x.is_finite());
        assert!(finite(&ww) && finite(&wf) && finite(&ff), "{f:?}");
        assert!(stretch::gradient(&rest, &s).iter().all(|g| g.iter().all(|x| x.is_finite())));
    }
}

#[test]
fn energy_change_is_the_difference_of_energies() {
    let rest = rest([3.0, 2.0, 0.7]);
    let mut noise = Noise(3);
    for f in deformations() {
        let reference = stretch::reference(f);
        for size in [1.0, 1e-3] {
            let change = [noise.vec3(size), noise.vec3(size)];
            let s = stretch::stretch(&reference, change);
            let whole = stretch::energy(&rest, &at([f[0] + change[0], f[1] + change[1]]));
            let difference = whole - stretch::energy(&rest, &at(f));
            assert!((stretch::energy_change(&rest, &s) - difference).abs() < 1e-12 * (1.0 + whole));
        }
    }
}

/// Points of a hinge whose edge has length `l` and whose triangles have the height `h` and
/// are folded to `angle`.
pub(super) fn folded(l: f64, h: f64, angle: f64) -> [Vec3; 4] {
    let far = Vec3::new(0.8 * l, h * angle.cos(), h * angle.sin());
    let points = [Vec3::zeros(), Vec3::new(l, 0.0, 0.0), Vec3::new(0.3 * l, -h, 0.0), far];
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.9, 2.0);
    points.map(|p| turn * p + Vec3::new(0.1, 1.4, -0.2))
}

fn angle_of(p: &[Vec3; 4]) -> f64 {
    hinge::angle(&(p[1] - p[0]), &(p[2] - p[0]), &(p[3] - p[0]))
}

#[test]
fn hinge_gradient_is_the_angles() {
    let rest = HingeRest { angle: 0.0, floor_edge: 1e-12, floor_normal: [1e-18; 2] };
    for (l, h) in [(0.01, 0.01), (0.01, 2e-4), (5e-4, 0.02)] {
        // Flat, hardly bent, a right angle, folded nearly shut to either side.
        for angle in [0.0, 1e-6, 0.3, -1.57, 3.1, -3.1] {
            let points = folded(l, h, angle);
            assert!((angle_of(&points).abs() - f64::abs(angle)).abs() < 1e-9);
            let gradient = hinge::gradient(
                &rest,
                &(points[1] - points[0]),
                &(points[2] - points[0]),
                &(points[3] - points[0]),
            );
            let size: f64 = gradient.iter().map(|g| g.norm()).sum();
            let step = 1e-4 * l.min(h);
            for k in 0..12 {
                let moved = |by: f64| {
                    let mut moved = points;
                    moved[k / 3][k % 3] += by;
                    angle_of(&moved)
                };
                let difference = (moved(step) - moved(-step)) / (2.0 * step);
                let error = (difference - gradient[k / 3][k % 3]).abs();
                assert!(error < 1e-6 * size, "l {l} h {h} angle {angle} {k}: {error:e} of {size:e}");
            }
        }
    }
}

#[test]
fn bend_takes_the_shorter_way_round() {
    // A seam folded at rest to 3.1 and now past pi, which `angle` gives as -3.1.
    let bend = hinge::bend(3.1, -3.1);
    assert!((bend - (2.0 * std::f64::consts::PI - 6.2)).abs() < 1e-12);
    assert!((hinge::bend(-3.1, 3.1) + bend).abs() < 1e-12);
}

/// Cloths with both kinds of hinges, and positions: crumpled, stretched, compressed.
pub(super) fn states() -> Vec<(Cloth, Vec<Vec3>)> {
    let sheet = garment_of(&panel(4, 3, 0.02, Split::Irregular, 0.6), &Fabric::default(), flat);
    let seam = sewn(3, 0.02, 1.2);
    let mut slivers = panel(4, 3, 0.02, Split::Irregular, 0.0);
    slivers.0.iter_mut().for_each(|p| p.y *= 0.02);
    let slivers = garment_of(&slivers, &Fabric::default(), flat);
    let mut states = Vec::new();
    for garment in [sheet, seam, slivers] {
        let rough_by = if states.len() == 8 { 0.02 } else { 1.0 };
        for (scale, rough) in [(1.0, 0.0), (1.0, 0.005), (1.6, 0.002), (0.5, 0.003)] {
            let mut noise = Noise(11);
            let moved: Vec<Vec3> =
                (0..garment.groups.node_count).map(|_| noise.vec3(rough * rough_by)).collect();
            let points = (0..garment.points.len())
                .map(|v| garment.points[v] * scale + moved[garment.groups.node_of_vertex[v] as usize])
                .collect();
            states.push((cloth_of(&garment), points));
        }
    }
    states
}

/// `points` with coordinate `k` of the nodes moved.
pub(super) fn nudged(cloth: &Cloth, points: &[Vec3], k: usize, by: f64) -> Vec<Vec3> {
    let mut moved = points.to_vec();
    for (p, &node) in moved.iter_mut().zip(&cloth.node_of_vertex) {
        if node as usize == k / 3 {
            p[k % 3] += by;
        }
    }
    moved
}

#[test]
fn whole_gradient_is_the_energys() {
    for (cloth, points) in states() {
        let judge = Judge::new(&cloth);
        let (_, gradient) = judge.judge(&points);
        // Where forces vanish, compare with those of a strain of 1e-4.
        let size = gradient.iter().map(|g| g.norm()).fold(1e-3, f64::max);
        for k in 0..3 * cloth.node_count {
            let energy = |by| judge.judge(&nudged(&cloth, &points, k, by)).0;
            let difference = (energy(1e-7) - energy(-1e-7)) / 2e-7;
            let error = (difference - gradient[k / 3][k % 3]).abs();
            assert!(error < 1e-5 * size, "{k}: {error:e} of {size:e}");
        }
    }
}

/// The amounts of all bending elements.
fn amounts(judge: &Judge, points: &[Vec3]) -> Vec<f64> {
    judge.measure(points).amounts.into_flattened()
}

#[test]
fn bending_hessian_is_gauss_newton() {
    let device = crate::device::Device::cpu();
    for (mut cloth, points) in states() {
        for fabric in &mut cloth.fabrics {
            *fabric = bending_only();
        }
        let judge = Judge::new(&cloth);
        let n = 3 * cloth.node_count;
        let rows = amounts(&judge, &points).len();
        let mut jacobian = DMatrix::zeros(rows, n);
        for k in 0..n {
            let [a, b] = [1e-7, -1e-7].map(|by| amounts(&judge, &nudged(&cloth, &points, k, by)));
            for r in 0..rows {
                jacobian[(r, k)] = (a[r] - b[r]) / 2e-7;
            }
        }
        let expected = jacobian.transpose() * jacobian;
        let found = twins::dense_hessian(&device, &cloth, &points);
        let error = (&found - &expected).abs().max();
        assert!(error < 1e-4 * expected.abs().max(), "{error:e} of {:e}", expected.abs().max());
    }
}

#[test]
fn hessian_is_the_gradients_in_tension() {
    // Flat panels in tension, folded at the seam by the rest angle: no eigenvalue is
    // negative and no bend differs from rest, so that nothing was left out.
    let device = crate::device::Device::cpu();
    let mut garments = vec![sewn(3, 0.02, 0.9)];
    garments.push(garment_of(&panel(4, 3, 0.02, Split::Irregular, 0.0), &Fabric::default(), flat));
    for garment in garments {
        let cloth = cloth_of(&garment);
        let points: Vec<Vec3> = garment.points.iter().map(|p| p * 1.1).collect();
        let judge = Judge::new(&cloth);
        let n = 3 * cloth.node_count;
        let mut expected = DMatrix::zeros(n, n);
        for k in 0..n {
            let [a, b] = [1e-7, -1e-7].map(|by| judge.judge(&nudged(&cloth, &points, k, by)).1);
            for r in 0..n {
                expected[(r, k)] = (a[r / 3][r % 3] - b[r / 3][r % 3]) / 2e-7;
            }
        }
        let found = twins::dense_hessian(&device, &cloth, &points);
        let error = (&found - &expected).abs().max();
        assert!(error < 1e-5 * expected.abs().max(), "{error:e} of {:e}", expected.abs().max());
    }
}

#[test]
fn hessian_is_symmetric_and_positive_semidefinite() {
    let device = crate::device::Device::cpu();
    for (cloth, points) in states() {
        let hessian = twins::dense_hessian(&device, &cloth, &points);
        assert!(hessian == hessian.transpose());
        let values = hessian.symmetric_eigenvalues();
        // f32 rounding of entries of size `max` over about 20 blocks a row.
        assert!(values.min() > -1e-5 * values.max(), "{} .. {}", values.min(), values.max());
    }
}
