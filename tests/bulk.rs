//! Queries in bulk against the same queries one by one in f64.

mod common;

use dressform::device::Device;
use dressform::geometry::Surface;
use dressform::geometry::bulk::SurfaceOnDevice;
use dressform::model::{TriMesh, Vec3};

/// Points all around, every other one within millimetres of the surface.
fn queries(surface: &Surface, n: usize) -> Vec<Vec3> {
    let mut random = common::Random::new(11);
    let mut point = || Vec3::from_fn(|_, _| f64::from(random.signed()));
    (0..n)
        .map(|i| {
            let p = Vec3::new(0.3, 1.2, -0.4) + point() * 0.8;
            let near = surface.closest(&p).point + point() * 0.004;
            if i % 2 == 0 { p } else { near }
        })
        .collect()
}

fn check(device: &Device, surface: &Surface, n: usize) {
    let points = queries(surface, n);
    let name = device.info().name;
    let on_device = SurfaceOnDevice::new(device, surface).expect("upload");
    // Coordinates are rounded to half a unit in the last place of the box's half size.
    let rounding = f64::from(f32::EPSILON) * 0.8;
    let found = on_device.closest(device, &points).expect("closest");
    for (p, found) in points.iter().zip(&found) {
        let best = surface.closest(p);
        let corners = surface.mesh().corners(found.triangle as usize);
        let b = found.barycentric;
        let at = corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2];
        assert!((at - found.point).norm() < 1e-12 && ((at - p).norm() - found.distance).abs() < 1e-12);
        let excess = found.distance - best.distance;
        assert!((-1e-12..8.0 * rounding).contains(&excess), "{excess:e} from {p:?} on {name}");
    }
    let numbers = on_device.winding_numbers(device, &points).expect("winding numbers");
    for (p, &number) in points.iter().zip(&numbers) {
        let exact = surface.winding_number(p);
        // Some thousand terms are summed, and near the surface a rounded point sees a
        // triangle from elsewhere: a turn changes by rounding over distance.
        let bound = 1024.0 * f64::from(f32::EPSILON) + rounding / surface.closest(p).distance;
        let error = (f64::from(number) - exact).abs();
        assert!(error < bound, "{number}, not {exact}, at {p:?} on {name}");
    }
    let again = on_device.winding_numbers(device, &points).expect("winding numbers");
    assert_eq!(common::words(&numbers), common::words(&again), "the same bytes on {name}");
}

#[test]
fn bulk_queries_agree_with_single_ones() {
    for device in common::devices("bulk_queries_agree_with_single_ones") {
        for open in [false, true] {
            check(&device, &Surface::new(common::ball(24, open)), 2000);
        }
    }
}

#[test]
fn walks_longer_than_a_run_are_continued() {
    let surface = Surface::new(common::ball(16, true));
    let points = queries(&surface, 300);
    for device in common::devices("walks_longer_than_a_run_are_continued") {
        let whole = SurfaceOnDevice::new(&device, &surface).expect("upload");
        let cut = SurfaceOnDevice::new(&device, &surface).expect("upload").cut_after(17);
        let numbers = whole.winding_numbers(&device, &points).expect("numbers");
        assert_eq!(cut.winding_numbers(&device, &points).expect("numbers"), numbers);
        let closest = whole.closest(&device, &points).expect("closest");
        assert_eq!(cut.closest(&device, &points).expect("closest"), closest);
    }
}

#[test]
fn nothing_is_asked_and_nothing_is_there() {
    let (empty, one) = (Surface::new(TriMesh::default()), Surface::new(common::ball(3, false)));
    for device in common::devices("nothing_is_asked_and_nothing_is_there") {
        let nothing = SurfaceOnDevice::new(&device, &empty).expect("upload");
        let points = [Vec3::zeros(), Vec3::x()];
        let found = nothing.closest(&device, &points).expect("closest");
        assert!(found.iter().all(|c| c.distance == f64::INFINITY && c.triangle == u32::MAX));
        assert_eq!(nothing.winding_numbers(&device, &points).expect("numbers"), [0.0, 0.0]);
        let ball = SurfaceOnDevice::new(&device, &one).expect("upload");
        assert!(ball.closest(&device, &[]).expect("closest").is_empty());
        assert!(ball.winding_numbers(&device, &[]).expect("numbers").is_empty());
        let odd = [Vec3::new(f64::NAN, 0.0, 0.0)];
        assert_eq!(ball.closest(&device, &odd).expect("closest")[0].triangle, u32::MAX);
    }
}
