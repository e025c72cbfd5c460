//! Cloth on solids that move.

use super::*;
use crate::drape::tests::{patches, sphere};
use crate::geometry::intersect;
use crate::model::TriMesh;

fn surface_of(mesh: &TriMesh, place: impl Fn(&Vec3) -> Vec3) -> Surface {
    let points = mesh.points.iter().map(place).collect();
    Surface::new(TriMesh { points, triangles: mesh.triangles.clone() })
}

#[test]
fn cloth_stays_on_a_ball_that_moves_and_turns() {
    // A cloth over a ball that speeds up sideways, rises and spins; two layers.
    let lower = patches(10, 0.3, &[&|x, y| Vec3::new(x - 0.15, 0.1024, y - 0.15)]);
    let upper = patches(8, 0.2, &[&|x, y| Vec3::new(x - 0.1, 0.1054, y - 0.1)]);
    let ball = sphere(0.1, 12);
    let solids = [&ball];
    let first = Surface::new(lower.welded_mesh(&lower.points));
    let layers = [&first];
    let input = |garment, layers| Input { colliders: &solids, layers, ..Input::alone(garment) };
    let inputs = [input(&lower, &[]), input(&upper, &layers)];
    let params = Params::default();
    let device = Device::cpu();
    let mut follower = Follower::new(&device, &inputs, &params).unwrap();
    let mut now = ball.clone();
    for frame in 1..=12 {
        let t = f64::from(frame) * FRAME;
        let turn = nalgebra::Rotation3::from_euler_angles(0.0, 2.0 * t, 0.3 * t);
        now = surface_of(ball.mesh(), |p| turn * p + Vec3::new(0.4 * t * t, 0.2 * t, 0.0));
        follower.advance(&[now.mesh().points.clone()], FRAME).unwrap();
        let [a, b] = &follower.points()[..] else { panic!("two garments") };
        let (a, b) = (Surface::new(lower.welded_mesh(a)), Surface::new(upper.welded_mesh(b)));
        for (s, t) in [(&a, &now), (&b, &now), (&b, &a)] {
            assert!(intersect::mesh_intersections(s, t).is_empty(), "frame {frame}");
        }
        assert!(intersect::self_intersections(&a).is_empty() && intersect::self_intersections(&b).is_empty());
    }
    for info in follower.infos() {
        assert_eq!((info.blocked_steps, info.crossings, info.frames), (0, [0, 0], 12), "{info:?}");
        assert_eq!(info.unconverged_steps, 0);
    }
    // Friction took the cloth along: its top is still on the ball's.
    let centre = now.mesh().points.iter().sum::<Vec3>() / now.mesh().points.len() as f64;
    let top = follower.points()[0].iter().map(|p| p.y).fold(f64::MIN, f64::max);
    assert!((top - centre.y - 0.1).abs() < 6e-3, "{top} {centre}");
}

#[test]
fn cloth_between_closing_solids_is_counted_and_stays_finite() {
    // A plate comes down on cloth that lies on another, closer than cloth is thick.
    let garment = patches(6, 0.2, &[&|x, y| Vec3::new(x, 2.2e-3, y)]);
    let plate = |y: f64, up: bool| {
        let p = |x: f64, z: f64| Vec3::new(x, y, z);
        let points = vec![p(-1.0, -1.0), p(1.0, -1.0), p(1.0, 1.0), p(-1.0, 1.0)];
        let triangles = if up { vec![[0, 2, 1], [0, 3, 2]] } else { vec![[0, 1, 2], [0, 2, 3]] };
        Surface::new(TriMesh { points, triangles })
    };
    let (floor, lid) = (plate(0.0, true), plate(0.02, false));
    let solids = [&floor, &lid];
    let inputs = [Input { colliders: &solids, ..Input::alone(&garment) }];
    let (device, params) = (Device::cpu(), Params { max_newton: 20, push_steps: 2, ..Params::default() });
    let mut follower = Follower::new(&device, &inputs, &params).unwrap();
    let shut = plate(-1e-3, false).mesh().points.clone();
    follower.advance(&[floor.mesh().points.clone(), shut], FRAME).unwrap();
    assert!(follower.infos()[0].blocked_steps > 0, "{:?}", follower.infos());
    assert!(follower.points()[0].iter().all(|p| p.iter().all(|c| c.is_finite())));
}
