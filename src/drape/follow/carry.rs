//! How cloth goes along with a surface that moves under it.
//!
//! A point at the signed distance `s` over a surface point `c` with the normal `n` goes to
//! `c' + s n'`, with `c'` and `n'` interpolated over the triangle that has moved: it follows the
//! skin's motion and its rotation. With the distance the share of that motion fades out, so that
//! a loose hem keeps its inertia. This is only where a step's search begins, and the place from
//! which slip against the skin counts; where the cloth ends the step decides.

use rayon::prelude::*;

use crate::geometry::Surface;
use crate::model::Vec3;

/// Up to this distance cloth goes along whole [m].
const WHOLE: f64 = 0.01;
/// From this distance on it does not go along [m].
const NOT: f64 = 0.05;

/// The displacements of points `x` with the closest of the `surfaces`, whose points go to `to`
/// with the normals `normals`.
pub fn displacements(surfaces: &[&Surface], to: &[&Surface], x: &[Vec3]) -> Vec<Vec3> {
    x.par_iter()
        .map(|p| {
            let near = surfaces
                .iter()
                .enumerate()
                .filter_map(|(s, surface)| surface.closest_within(p, NOT).map(|closest| (s, closest)));
            let Some((s, c)) = near.min_by(|a, b| a.1.distance.total_cmp(&b.1.distance)) else {
                return Vec3::zeros();
            };
            let t = surfaces[s].mesh().triangles[c.triangle as usize];
            let blend = |of: &[Vec3]| (0..3).map(|k| of[t[k] as usize] * c.barycentric[k]).sum::<Vec3>();
            let unit = |n: Vec3| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            let before = unit(blend(surfaces[s].point_normals()));
            let after = unit(blend(to[s].point_normals()));
            let signed = c.distance * (p - c.point).dot(&before).signum();
            let moved = blend(&to[s].mesh().points) - c.point + (after - before) * signed;
            moved * (1.0 - smooth((c.distance - WHOLE) / (NOT - WHOLE)))
        })
        .collect()
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
        let d = displacements(&[&still], &[&turned], &x);
        assert!((x[0] + d[0] - turn * x[0]).norm() < 1e-12);
        assert_eq!(d[1], Vec3::zeros());
        assert!((x[2] + d[2] - turn * x[2]).norm() < 1e-12);
    }
}
