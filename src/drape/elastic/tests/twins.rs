//! The `f32` twin against the `f64` judge, on the CPU device.

use nalgebra::DMatrix;

use super::super::{Elastic, Error};
use super::*;
use crate::device::Device;

/// The Hessian at `points` as a dense matrix.
pub(super) fn dense_hessian(device: &Device, cloth: &Cloth, points: &[Vec3]) -> DMatrix<f64> {
    let mut elastic = Elastic::new(device, cloth).unwrap();
    elastic.rebase(device, points).unwrap();
    let u = device.zeros("u", 3 * cloth.node_count).unwrap();
    elastic.linearise(device, &u).unwrap();
    let hessian = elastic.hessian();
    let start = device.read(&hessian.row_start).unwrap();
    let (columns, blocks) = (device.read(&hessian.columns).unwrap(), device.read(&hessian.blocks).unwrap());
    let mut dense = DMatrix::zeros(3 * cloth.node_count, 3 * cloth.node_count);
    for row in 0..cloth.node_count {
        assert_eq!(columns[elastic.diagonal_slots()[row] as usize] as usize, row);
        for k in start[row] as usize..start[row + 1] as usize {
            for (i, &value) in blocks[k].iter().enumerate() {
                dense[(3 * row + i / 3, 3 * columns[k] as usize + i % 3)] = f64::from(value);
            }
        }
    }
    dense
}

/// Vertex positions with the nodes moved by `u`.
fn displaced(cloth: &Cloth, points: &[Vec3], u: &[f32]) -> Vec<Vec3> {
    let moved = |v: usize| {
        let n = 3 * cloth.node_of_vertex[v] as usize;
        points[v] + Vec3::from_fn(|i, _| f64::from(u[n + i]))
    };
    (0..points.len()).map(moved).collect()
}

fn gradients(device: &Device, elastic: &mut Elastic, u: &[f32]) -> Vec<f64> {
    let u = device.upload("u", u).unwrap();
    elastic.linearise(device, &u).unwrap();
    device.read(elastic.gradient()).unwrap().into_iter().map(f64::from).collect()
}

fn garments() -> Vec<Garment> {
    let far = |p: &Vec2| rolled(12.0, 0.5)(p) + Vec3::new(0.3, 1.4, -0.2);
    vec![garment_of(&panel(9, 8, 0.02, Split::Irregular, 0.3), &Fabric::default(), far), sewn(7, 0.02, 1.3)]
}

#[test]
fn twin_agrees_with_the_judge() {
    let device = Device::cpu();
    for garment in garments() {
        let cloth = cloth_of(&garment);
        let mut elastic = Elastic::new(&device, &cloth).unwrap();
        elastic.rebase(&device, &garment.points).unwrap();
        for size in [0.0, 1e-6, 1e-3, 8e-3] {
            let mut noise = Noise(17);
            let u: Vec<f32> = (0..3 * cloth.node_count).map(|_| (size * noise.next()) as f32).collect();
            let (energy, gradient) = elastic.judge(&displaced(&cloth, &garment.points, &u));
            let found = elastic.energy(&device, &device.upload("u", &u).unwrap()).unwrap();
            assert!((found - energy).abs() < 1e-6 * energy.max(1e-9), "{size}: {found:e} {energy:e}");
            let found = gradients(&device, &mut elastic, &u);
            let largest = gradient.iter().map(|g| g.norm()).fold(1e-7, f64::max);
            for (k, f) in found.iter().enumerate() {
                let error = (f - gradient[k / 3][k % 3]).abs();
                assert!(error < 3e-6 * largest, "{size} {k}: {error:e} of {largest:e}");
            }
        }
    }
}

#[test]
fn pressing_adds_bending_about_another_shape_and_goes_away() {
    let device = Device::cpu();
    for garment in garments() {
        let cloth = cloth_of(&garment);
        let mut elastic = Elastic::new(&device, &cloth).unwrap();
        let mut noise = Noise(5);
        let mut displaced = |size: f64| {
            let u: Vec<f32> = (0..3 * cloth.node_count).map(|_| (size * noise.next()) as f32).collect();
            displaced(&cloth, &garment.points, &u)
        };
        let (shape, points) = (displaced(1e-3), displaced(1e-3));
        let about = elastic.angles(&shape);
        let still = device.zeros::<f32>("u", 3 * cloth.node_count).unwrap();
        let mut gradient = |factor: f64, points: &[Vec3]| {
            elastic.press(&device, factor, &about).unwrap();
            assert_eq!(elastic.energy(&device, &still), Err(Error::NoReference));
            elastic.rebase(&device, points).unwrap();
            let (energy, gradient) = elastic.judge(points);
            assert!((elastic.energy(&device, &still).unwrap() - energy).abs() < 1e-9 * energy);
            gradient
        };
        let difference = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>();
        let size = |g: &[Vec3]| g.iter().map(Vec3::norm).fold(0.0, f64::max);
        let (own, three, nine) = (gradient(1.0, &points), gradient(3.0, &points), gradient(9.0, &points));
        let (two, eight) = (difference(&three, &own), difference(&nine, &own));
        let four_times: Vec<Vec3> = two.iter().map(|g| 4.0 * g).collect();
        assert!(size(&difference(&eight, &four_times)) < 1e-9 * size(&eight), "linear in what is added");
        // Where the cloth has the angles that it is pressed to, only its own forces are left.
        let at_shape = difference(&gradient(9.0, &shape), &gradient(1.0, &shape));
        assert!(size(&at_shape) < 1e-9 * size(&eight));
        assert_eq!(gradient(1.0, &points), own);
    }
}

#[test]
fn small_changes_of_energy_are_not_lost() {
    // Far below f32's resolution of the total, the change still follows the gradient.
    let device = Device::cpu();
    let garment = &garments()[0];
    let cloth = cloth_of(garment);
    let mut elastic = Elastic::new(&device, &cloth).unwrap();
    let mut noise = Noise(23);
    let points: Vec<Vec3> = garment.points.iter().map(|p| p * 1.05 + noise.vec3(1e-4)).collect();
    elastic.rebase(&device, &points).unwrap();
    let (energy, gradient) = elastic.judge(&points);
    let u: Vec<f32> = gradient.iter().flat_map(|g| [g.x, g.y, g.z].map(|g| (-1e-9 * g) as f32)).collect();
    let found = elastic.energy(&device, &device.upload("u", &u).unwrap()).unwrap() - energy;
    let expected = elastic.judge(&displaced(&cloth, &points, &u)).0 - energy;
    assert!(expected.abs() < 1e-6 * energy, "{expected:e} of {energy:e} is not small");
    assert!((found - expected).abs() < 1e-3 * expected.abs(), "{found:e} {expected:e}");
}

#[test]
fn twin_makes_no_force_of_rigid_motion() {
    let device = Device::cpu();
    for garment in garments() {
        let mut cloth = cloth_of(&garment);
        for hinge in &mut cloth.hinges {
            let [e, a, b] = hinge.edges(&garment.points);
            hinge.rest_angle = super::super::hinge::angle(&e, &a, &b);
        }
        // The rolled sheet's edges are chords; take them as they are for the rest shape.
        for (t, rest) in cloth.rest.iter_mut().enumerate() {
            let [p, q, r] = cloth.triangles[t].map(|v| garment.points[v as usize]);
            let x = (q - p).normalize();
            let y = (r - p) - x * x.dot(&(r - p));
            *rest = [Vec2::zeros(), Vec2::new((q - p).norm(), 0.0), Vec2::new(x.dot(&(r - p)), y.norm())];
        }
        let mut elastic = Elastic::new(&device, &cloth).unwrap();
        elastic.rebase(&device, &garment.points).unwrap();
        let turn = nalgebra::Rotation3::from_euler_angles(0.2, 0.1, -0.3);
        let nodes = garment.groups.node_points(&garment.points);
        let u: Vec<f32> = nodes
            .iter()
            .flat_map(|p| {
                let d = turn * p - p + Vec3::new(0.1, -0.2, 0.05);
                [d.x as f32, d.y as f32, d.z as f32]
            })
            .collect();
        // Displacements of 0.5 m are rounded to 3e-8 m, that is strains of 3e-6 over 1 cm.
        let limit = 3e-6 * Fabric::default().stretch_warp * 0.02 * 3.0;
        let forces = gradients(&device, &mut elastic, &u);
        assert!(
            forces.iter().all(|f| f.abs() < limit),
            "{:e}",
            forces.iter().fold(0.0, |m, f| f.abs().max(m))
        );
        // At the reference itself they are zero to rounding in f64, however far it is.
        let far: Vec<Vec3> = garment.points.iter().map(|p| turn * p + Vec3::new(0.0, 50.0, 0.0)).collect();
        elastic.rebase(&device, &far).unwrap();
        let forces = gradients(&device, &mut elastic, &vec![0.0; u.len()]);
        assert!(
            forces.iter().all(|f| f.abs() < 1e-9),
            "{:e}",
            forces.iter().fold(0.0, |m, f| f.abs().max(m))
        );
    }
}

#[test]
fn misuse_is_answered() {
    let device = Device::cpu();
    let garment = &garments()[1];
    let cloth = cloth_of(garment);
    let mut elastic = Elastic::new(&device, &cloth).unwrap();
    let u = device.zeros("u", 3 * cloth.node_count).unwrap();
    assert_eq!(elastic.energy(&device, &u), Err(Error::NoReference));
    let short = device.zeros("u", 3).unwrap();
    assert!(matches!(elastic.linearise(&device, &short), Err(Error::Length { found: 3, .. })));
    let mut points = garment.points.clone();
    points[2].y = f64::NAN;
    assert_eq!(elastic.rebase(&device, &points), Err(Error::NotFinite(2)));
    points.pop();
    assert!(matches!(elastic.rebase(&device, &points), Err(Error::Length { .. })));
}
