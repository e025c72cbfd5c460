//! Triangle pairs that intersect, by exact predicates.
//!
//! Triangles are closed sets: touching counts. Triangles that share points (by index) count
//! only if they meet beyond what they share. Signs of determinants are exact
//! [Shewchuk 1997], and coplanar cases are decided exactly in a projection, so that the answer
//! is the one for the very coordinates given.
//!
//! Two triangles meet iff an edge of one meets the other. If they share one point v, whatever
//! else they have in common lies on a ray from v that leaves one of them through its edge
//! opposite to v while still within the other: so only these two edges are tested. If they
//! share an edge, they meet beyond it iff they are coplanar and on one side of it. Triangles
//! with the same three points always count.
//!
//! A triangle whose corners lie exactly on one line is met by the edges of others, but two such
//! triangles are not tested against one another.

use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::Surface;
use crate::model::Vec3;

/// Pairs `[triangle of a, triangle of b]` that intersect, sorted. Points of the two meshes are
/// never shared.
pub fn mesh_intersections(a: &Surface, b: &Surface) -> Vec<[u32; 2]> {
    pairs(a, b, &|i, j| meet_apart(&a.mesh().corners(i as usize), &b.mesh().corners(j as usize)))
}

/// Pairs of triangles of one mesh that intersect, each once with the smaller index first, sorted.
pub fn self_intersections(surface: &Surface) -> Vec<[u32; 2]> {
    let (mesh, nodes) = (surface.mesh(), surface.nodes());
    let corners = |t: u32| &mesh.triangles[t as usize];
    let after = |i: usize| {
        // What stands before a leaf has met it already.
        let (own, mut found, mut at) = (&nodes[i], Vec::new(), i + 1);
        while let Some(node) = nodes.get(at) {
            if !node.overlaps(&own.lo.into(), &own.hi.into()) {
                at = node.skip as usize;
                continue;
            }
            let (s, t) = (own.triangle.min(node.triangle), own.triangle.max(node.triangle));
            if node.is_leaf() && triangles_meet(&mesh.points, corners(s), corners(t)) {
                found.push([s, t]);
            }
            at += 1;
        }
        found
    };
    let leaves = (0..nodes.len()).into_par_iter().filter(|&i| nodes[i].is_leaf());
    let mut found: Vec<[u32; 2]> = leaves.flat_map_iter(after).collect();
    found.sort_unstable();
    found
}

fn pairs(a: &Surface, b: &Surface, meet: &(dyn Fn(u32, u32) -> bool + Sync)) -> Vec<[u32; 2]> {
    (0..a.mesh().triangles.len() as u32)
        .into_par_iter()
        .flat_map_iter(|i| {
            let [p, q, r] = a.mesh().corners(i as usize);
            let mut found = Vec::new();
            b.triangles_in_box(&p.inf(&q).inf(&r), &p.sup(&q).sup(&r), &mut |j| {
                if meet(i, j) {
                    found.push([i, j]);
                }
            });
            found.sort_unstable();
            found
        })
        .collect()
}

/// Whether two triangles over the same points meet beyond the points that they share. A
/// triangle that names a point twice meets nothing.
pub fn triangles_meet(points: &[Vec3], s: &[u32; 3], t: &[u32; 3]) -> bool {
    let repeats = |x: &[u32; 3]| x[0] == x[1] || x[1] == x[2] || x[2] == x[0];
    if repeats(s) || repeats(t) {
        return false;
    }
    let at = |x: &[u32; 3], k: usize| points[x[k % 3] as usize];
    let (ps, pt) = ([0, 1, 2].map(|k| at(s, k)), [0, 1, 2].map(|k| at(t, k)));
    let (mut shared, mut count) = ([(0, 0); 3], 0);
    for i in 0..3 {
        if let Some(j) = t.iter().position(|p| *p == s[i]) {
            shared[count] = (i, j);
            count += 1;
        }
    }
    match shared[..count] {
        [] => meet_apart(&ps, &pt),
        [(i, j)] => {
            let (s, t) = ([at(s, i + 1), at(s, i + 2)], [at(t, j + 1), at(t, j + 2)]);
            !apart_around(&ps[i], &s, &t)
                && (segment_meets_triangle(&s[0], &s[1], &pt) || segment_meets_triangle(&t[0], &t[1], &ps))
        }
        [(i0, j0), (i1, j1)] => folded_over(&at(s, i0), &at(s, i1), &at(s, 3 - i0 - i1), &at(t, 3 - j0 - j1)),
        _ => true,
    }
}

/// Whether a plane through `v`, across the way from one pair of points to the other, has them surely on
/// its two sides; most triangles that share a point are so.
fn apart_around(v: &Vec3, s: &[Vec3; 2], t: &[Vec3; 2]) -> bool {
    let (s, t) = (s.map(|p| p - v), t.map(|p| p - v));
    let way = (t[0] + t[1]).normalize() - (s[0] + s[1]).normalize();
    // Rounding of differences, products and sums is below 1e-15 of the terms. What is no number fails.
    let height = |d: &Vec3| (d.dot(&way), 1e-14 * d.abs().dot(&way.abs()));
    let (below, above) = (|h: (f64, f64)| h.0 < -h.1, |h: (f64, f64)| h.0 > h.1);
    s.iter().all(|d| below(height(d))) && t.iter().all(|d| above(height(d)))
}

/// Whether two triangles without shared points have a point in common.
pub fn meet_apart(s: &[Vec3; 3], t: &[Vec3; 3]) -> bool {
    // Most pairs end here: all corners of one strictly on one side of the other.
    let apart = |a: &[Vec3; 3], b: &[Vec3; 3]| {
        let side = b.map(|p| side_of_plane(a, &p));
        side.iter().all(|&d| d > 0.0) || side.iter().all(|&d| d < 0.0)
    };
    if apart(s, t) || apart(t, s) {
        return false;
    }
    (0..3).any(|k| segment_meets_triangle(&s[k], &s[(k + 1) % 3], t))
        || (0..3).any(|k| segment_meets_triangle(&t[k], &t[(k + 1) % 3], s))
}

/// Whether the closed segment `pq` and the closed triangle have a point in common.
pub fn segment_meets_triangle(p: &Vec3, q: &Vec3, t: &[Vec3; 3]) -> bool {
    let (sp, sq) = (side_of_plane(t, p), side_of_plane(t, q));
    if sp == 0.0 && sq == 0.0 {
        return coplanar_segment_meets_triangle(p, q, t);
    }
    if (sp > 0.0 && sq > 0.0) || (sp < 0.0 && sq < 0.0) {
        return false;
    }
    // The line pq crosses the plane within the segment; it passes the triangle iff all edges
    // lie on the same side of it.
    let turns = [0, 1, 2].map(|k| orient(p, q, &t[k], &t[(k + 1) % 3]));
    turns.iter().all(|&x| x >= 0.0) || turns.iter().all(|&x| x <= 0.0)
}

/// Whether triangles `uva` and `uvb` lie in one plane and on one side of `uv`.
fn folded_over(u: &Vec3, v: &Vec3, a: &Vec3, b: &Vec3) -> bool {
    if orient(u, v, a, b) != 0.0 {
        return false;
    }
    projection(&[*u, *v, *a]).is_some_and(|axis| {
        let (sa, sb) = (turn(axis, u, v, a), turn(axis, u, v, b));
        (sa > 0.0 && sb > 0.0) || (sa < 0.0 && sb < 0.0)
    })
}

fn coplanar_segment_meets_triangle(p: &Vec3, q: &Vec3, t: &[Vec3; 3]) -> bool {
    let Some(axis) = projection(t) else {
        return false;
    };
    let inside = [0, 1, 2].map(|k| turn(axis, &t[k], &t[(k + 1) % 3], p));
    if inside.iter().all(|&x| x >= 0.0) || inside.iter().all(|&x| x <= 0.0) {
        return true;
    }
    (0..3).any(|k| segments_meet(axis, p, q, &t[k], &t[(k + 1) % 3]))
}

/// Whether two closed segments meet in the projection.
fn segments_meet(axis: usize, p: &Vec3, q: &Vec3, a: &Vec3, b: &Vec3) -> bool {
    let (pa, qa) = (turn(axis, a, b, p), turn(axis, a, b, q));
    let (ap, bp) = (turn(axis, p, q, a), turn(axis, p, q, b));
    let split = |x: f64, y: f64| (x > 0.0 && y < 0.0) || (x < 0.0 && y > 0.0);
    if split(pa, qa) && split(ap, bp) {
        return true;
    }
    let within = |x: &Vec3, a: &Vec3, b: &Vec3| {
        (0..3).filter(|&k| k != axis).all(|k| a[k].min(b[k]) <= x[k] && x[k] <= a[k].max(b[k]))
    };
    (pa == 0.0 && within(p, a, b))
        || (qa == 0.0 && within(q, a, b))
        || (ap == 0.0 && within(a, p, q))
        || (bp == 0.0 && within(b, p, q))
}

/// An axis along which the triangle projects to one with area; `None` if it has none at all.
fn projection(t: &[Vec3; 3]) -> Option<usize> {
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let first = normal.iamax();
    (0..3).map(|k| (first + k) % 3).find(|&axis| turn(axis, &t[0], &t[1], &t[2]) != 0.0)
}

fn turn(axis: usize, a: &Vec3, b: &Vec3, c: &Vec3) -> f64 {
    let flat = |p: &Vec3| Coord { x: p[(axis + 1) % 3], y: p[(axis + 2) % 3] };
    orient2d(flat(a), flat(b), flat(c))
}

fn side_of_plane(t: &[Vec3; 3], p: &Vec3) -> f64 {
    orient(&t[0], &t[1], &t[2], p)
}

fn orient(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> f64 {
    let coord = |p: &Vec3| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coord(a), coord(b), coord(c), coord(d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::sphere;
    use crate::model::TriMesh;

    fn v(x: f64, y: f64, z: f64) -> Vec3 {
        Vec3::new(x, y, z)
    }

    fn base() -> [Vec3; 3] {
        [v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(0.0, 1.0, 0.0)]
    }

    /// Every order of the corners and of the pair gives the same answer.
    fn meets(s: [Vec3; 3], t: [Vec3; 3]) -> bool {
        let orders = [[0, 1, 2], [1, 2, 0], [2, 1, 0], [0, 2, 1]];
        let answers: Vec<bool> = orders
            .iter()
            .flat_map(|i| orders.iter().map(move |j| (i.map(|k| s[k]), j.map(|k| t[k]))))
            .flat_map(|(s, t)| [meet_apart(&s, &t), meet_apart(&t, &s)])
            .collect();
        assert!(answers.iter().all(|a| *a == answers[0]), "{s:?} {t:?} {answers:?}");
        answers[0]
    }

    #[test]
    fn crossing_touching_and_apart() {
        assert!(meets(base(), [v(0.2, 0.2, -1.0), v(0.3, 0.2, 1.0), v(0.2, 0.3, 1.0)]));
        // A corner on the face, on an edge, at a corner; and the smallest step off each.
        let tip = |p: Vec3| [p, p + v(0.1, 0.0, 1.0), p + v(0.0, 0.1, 1.0)];
        let step = f64::MIN_POSITIVE;
        assert!(meets(base(), tip(v(0.25, 0.25, 0.0))));
        assert!(!meets(base(), tip(v(0.25, 0.25, step))));
        assert!(meets(base(), tip(v(0.5, 0.5, 0.0))));
        assert!(!meets(base(), tip(v(0.5, 0.5 + f64::EPSILON, 0.0))));
        assert!(meets(base(), tip(v(1.0, 0.0, 0.0))));
        assert!(!meets(base(), tip(v(1.0 + f64::EPSILON, 0.0, 0.0))));
        // Edge across edge.
        assert!(meets(base(), [v(0.5, 0.0, -1.0), v(0.5, 0.0, 1.0), v(0.5, -1.0, 0.0)]));
        assert!(!meets(base(), [v(0.5, -0.01, -1.0), v(0.5, -0.01, 1.0), v(0.5, -1.0, 0.0)]));
    }

    #[test]
    fn coplanar_triangles() {
        assert!(meets(base(), base()));
        assert!(meets(base(), base().map(|p| p * 0.2 + v(0.2, 0.2, 0.0)))); // one inside the other
        assert!(meets(base(), base().map(|p| p + v(0.3, 0.3, 0.0))));
        assert!(meets(base(), base().map(|p| p + v(1.0, 0.0, 0.0)))); // at a corner
        assert!(meets(base(), base().map(|p| v(p.x + 0.2, -p.y, 0.0)))); // along an edge
        assert!(!meets(base(), base().map(|p| p + v(1.0 + f64::EPSILON, 0.0, 0.0))));
        assert!(!meets(base(), base().map(|p| p + v(0.0, 0.0, 1e-300))));
        // In an oblique plane, where plain floating point does not see them as coplanar.
        let tilt = |p: Vec3| v(p.x, p.y, 0.5 * p.x + 0.25 * p.y);
        assert!(meets(base().map(tilt), base().map(|p| tilt(p * 0.25 + v(0.25, 0.25, 0.0)))));
        assert!(!meets(base().map(tilt), base().map(|p| tilt(p + v(0.75, 0.5, 0.0)))));
    }

    #[test]
    fn shared_point() {
        let mut points = base().to_vec();
        points.extend([v(-1.0, 0.0, 1.0), v(0.0, -1.0, 1.0)]); // only the point
        points.extend([v(0.5, 0.1, -1.0), v(0.5, 0.1, 1.0)]); // through the face
        points.extend([v(0.4, 0.2, 0.0), v(0.2, 0.4, 0.0)]); // coplanar, within
        points.extend([v(-0.4, 0.2, 0.0), v(-0.2, 0.4, 0.0)]); // coplanar, beside
        points.extend([v(2.0, 0.0, 0.0), v(2.0, 0.0, 1.0)]); // along an edge
        let meets = |t: [u32; 3]| {
            let (forth, back) =
                (triangles_meet(&points, &[0, 1, 2], &t), triangles_meet(&points, &t, &[0, 1, 2]));
            assert_eq!(forth, back);
            forth
        };
        assert!(!meets([0, 3, 4]));
        assert!(meets([5, 0, 6]));
        assert!(meets([7, 8, 0]));
        assert!(!meets([0, 9, 10]));
        assert!(meets([0, 11, 12]));
    }

    #[test]
    fn shared_edge_counts_only_when_folded_flat() {
        let mut points = base().to_vec();
        points.extend([v(0.3, -1.0, 0.0), v(0.3, 2.0, 0.0), v(0.3, 2.0, 1e-300)]);
        assert!(!triangles_meet(&points, &[0, 1, 2], &[1, 0, 3]));
        assert!(triangles_meet(&points, &[0, 1, 2], &[1, 0, 4]));
        assert!(!triangles_meet(&points, &[0, 1, 2], &[1, 0, 5]));
        assert!(triangles_meet(&points, &[0, 1, 2], &[2, 1, 0])); // one on top of the other
        assert!(!triangles_meet(&points, &[0, 1, 1], &[2, 1, 0])); // collapsed
    }

    #[test]
    fn a_clean_ball_has_none_and_two_crossing_balls_have_a_ring() {
        let ball = Surface::new(sphere(20, 30));
        assert!(self_intersections(&ball).is_empty());
        let mut other = sphere(21, 31);
        other.points.iter_mut().for_each(|p| *p += v(0.7, 0.013, 0.021));
        let shifted = Surface::new(other);
        let found = mesh_intersections(&ball, &shifted);
        let brute: Vec<[u32; 2]> = (0..ball.mesh().triangles.len() as u32)
            .flat_map(|i| (0..shifted.mesh().triangles.len() as u32).map(move |j| [i, j]))
            .filter(|[i, j]| {
                meet_apart(&ball.mesh().corners(*i as usize), &shifted.mesh().corners(*j as usize))
            })
            .collect();
        assert!(!found.is_empty());
        assert_eq!(found, brute);
        // As one mesh: the same pairs again, with the second ball's indices moved.
        let n = ball.mesh().points.len() as u32;
        let mut joined = ball.mesh().clone();
        joined.points.extend(&shifted.mesh().points);
        joined.triangles.extend(shifted.mesh().triangles.iter().map(|t| t.map(|i| i + n)));
        let m = ball.mesh().triangles.len() as u32;
        let moved: Vec<[u32; 2]> = found.iter().map(|[i, j]| [*i, j + m]).collect();
        assert_eq!(self_intersections(&Surface::new(joined)), moved);
        let empty = Surface::new(TriMesh::default());
        assert!(mesh_intersections(&empty, &ball).is_empty());
    }
}
