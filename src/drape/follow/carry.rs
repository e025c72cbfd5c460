//! How cloth goes along with a surface that moves under it.
//!
//! A point at the signed distance `s` over a surface point `c` with the normal `n` goes to
//! `c' + s n'`, with `c'` and `n'` interpolated over the triangle that has moved: it follows the
//! skin's motion and its rotation. With the distance the share of that motion fades out, so that
//! a loose hem keeps its inertia. This is only where a step's search begins, and the place from
//! which slip against the skin counts; where the cloth ends the step decides.

use rayon::prelude::*;

use crate::geometry::{Closest, Surface};
use crate::model::Vec3;

/// Up to this distance cloth goes along whole [m].
const WHOLE: f64 = 0.01;
/// From this distance on it does not go along [m].
const NOT: f64 = 0.05;

/// How a point goes along.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carried {
    /// Its displacement [m].
    pub by: Vec3,
    /// The share of the surface's motion that this is, 0 to 1.
    pub share: f64,
}

/// How points `x` go along with the closest of the `surfaces`, whose points go to those of `to`.
pub fn carried(surfaces: &[&Surface], to: &[&Surface], x: &[Vec3]) -> Vec<Carried> {
    x.par_iter()
        .map(|p| {
            let Some((s, c)) = nearest(surfaces, p) else { return Carried::default() };
            let t = surfaces[s].mesh().triangles[c.triangle as usize];
            let blend = |of: &dyn Fn(u32) -> Vec3| (0..3).map(|k| of(t[k]) * c.barycentric[k]).sum::<Vec3>();
            let normal = |on: &Surface| blend(&|i| on.point_normal(i)).try_normalize(0.0);
            let (before, after) = (normal(surfaces[s]), normal(to[s]));
            let (before, after) = (before.unwrap_or_else(Vec3::zeros), after.unwrap_or_else(Vec3::zeros));
            let signed = c.distance * (p - c.point).dot(&before).signum();
            let there = blend(&|i| to[s].mesh().points[i as usize]);
            let share = 1.0 - smooth((c.distance - WHOLE) / (NOT - WHOLE));
            Carried { by: (there - c.point + (after - before) * signed) * share, share }
        })
        .collect()
}

/// The longest way of what is near one of the points `x` [m], where `surfaces`' points go to `to`.
pub fn longest(surfaces: &[&Surface], to: &[Vec<Vec3>], x: &[Vec3]) -> f64 {
    let way = |p: &Vec3| {
        let Some((s, c)) = nearest(surfaces, p) else { return 0.0 };
        let (from, to) = (&surfaces[s].mesh().points, &to[s]);
        let corners = surfaces[s].mesh().triangles[c.triangle as usize];
        corners.iter().map(|&i| (to[i as usize] - from[i as usize]).norm()).fold(0.0, f64::max)
    };
    x.par_iter().map(way).reduce(|| 0.0, f64::max)
}

/// The closest of the surfaces within [`NOT`], and where.
fn nearest(surfaces: &[&Surface], p: &Vec3) -> Option<(usize, Closest)> {
    let near = surfaces.iter().enumerate().filter_map(|(s, on)| Some((s, on.closest_within(p, NOT)?)));
    near.min_by(|a, b| a.1.distance.total_cmp(&b.1.distance))
}

/// 0 below 0, 1 above 1, smooth between.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::TriMesh;
    use nalgebra::Rotation3;

    fn square(turn: &Rotation3<f64>) -> Surface {
        let p = |x: f64, z: f64| turn * Vec3::new(x, 0.0, z);
        let points = vec![p(-1.0, -1.0), p(1.0, -1.0), p(1.0, 1.0), p(-1.0, 1.0)];
        Surface::new(TriMesh { points, triangles: vec![[0, 2, 1], [0, 3, 2]] })
    }

    #[test]
    fn near_points_turn_with_the_surface_and_far_ones_stay() {
        let turn = Rotation3::from_euler_angles(0.3, 0.5, -0.2);
        let (still, turned) = (square(&Rotation3::identity()), square(&turn));
        let x = [Vec3::new(0.2, 5e-3, 0.1), Vec3::new(-0.4, 0.1, 0.3), Vec3::new(0.2, -4e-3, 0.5)];
        let found = carried(&[&still], &[&turned], &x);
        assert!((x[0] + found[0].by - turn * x[0]).norm() < 1e-12);
        assert_eq!(found[1], Carried::default());
        assert!((x[2] + found[2].by - turn * x[2]).norm() < 1e-12);
        assert_eq!((found[0].share, found[2].share), (1.0, 1.0));
        // The farthest corner of what is near goes farthest.
        let farthest = (turn * Vec3::new(1.0, 0.0, 1.0) - Vec3::new(1.0, 0.0, 1.0)).norm();
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]| Vec3::new(a, 0.0, b));
        let ways = corners.map(|c| (turn * c - c).norm());
        let expected = ways.iter().copied().fold(0.0, f64::max);
        let found = longest(&[&still], &[turned.mesh().points.clone()], &x);
        assert!((found - expected).abs() < 1e-12 && farthest <= expected, "{found} {expected}");
        assert_eq!(longest(&[&still], &[turned.mesh().points.clone()], &x[1..2]), 0.0);
    }
}
