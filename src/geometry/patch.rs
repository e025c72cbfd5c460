//! The few triangles of a surface that matter to points close together.

use robust::{Coord3D, orient3d};

use super::bvh::Node;
use super::surface::{Closest, Surface};
use super::triangle;
use crate::model::Vec3;

/// Triangles around a centre: enough to find the closest point, and to count crossings, for
/// every point within a radius of it. Many such questions at one place cost a fraction of as
/// many walks through the whole hierarchy.
#[derive(Debug)]
pub struct Patch<'a> {
    surface: &'a Surface,
    leaves: Vec<Node>,
}

impl<'a> Patch<'a> {
    /// For points within `radius` of `centre`, which is `distance` away from the surface [m].
    ///
    /// The triangle closest to such a point is at most `distance + 2 radius` from the centre.
    pub fn new(surface: &'a Surface, centre: &Vec3, distance: f64, radius: f64) -> Patch<'a> {
        let reach = (distance + 2.0 * radius) * (1.0 + 1e-9);
        let (mut leaves, mut i) = (Vec::new(), 0);
        let nodes = surface.nodes();
        while let Some(node) = nodes.get(i) {
            if beyond(node, centre) > reach * reach {
                i = node.skip as usize;
                continue;
            }
            if node.is_leaf() {
                leaves.push(*node);
            }
            i += 1;
        }
        Patch { surface, leaves }
    }

    /// As [`Surface::closest`].
    pub fn closest(&self, p: &Vec3) -> Closest {
        let mut best =
            Closest { point: *p, triangle: u32::MAX, barycentric: [0.0; 3], distance: f64::INFINITY };
        for leaf in &self.leaves {
            if beyond(leaf, p) >= best.distance {
                continue;
            }
            let triangle = leaf.triangle;
            let corners = self.surface.mesh().corners(triangle as usize);
            let barycentric = triangle::closest(p, &corners);
            let point = triangle::at(&corners, &barycentric);
            let distance = (point - p).norm_squared();
            if distance < best.distance {
                best = Closest { point, triangle, barycentric, distance };
            }
        }
        best.distance = best.distance.sqrt();
        best
    }

    /// By how much the winding number at `q` exceeds that at `p`: each triangle passed against
    /// its normal adds one. Exact on a closed surface; `None` if the segment touches an edge.
    pub fn winding_change(&self, p: &Vec3, q: &Vec3) -> Option<i32> {
        let mut change = 0;
        for leaf in &self.leaves {
            let [a, b, c] = self.surface.mesh().corners(leaf.triangle as usize);
            let (from, to) = (side(&a, &b, &c, p), side(&a, &b, &c, q));
            if from * to > 0.0 {
                continue;
            }
            let around = [side(p, q, &a, &b), side(p, q, &b, &c), side(p, q, &c, &a)];
            let all = |sign: f64| around.iter().all(|s| s * sign > 0.0);
            if from != 0.0 && to != 0.0 && (all(1.0) || all(-1.0)) {
                change += if to > from { 1 } else { -1 };
            } else if around.iter().all(|&s| s >= 0.0) || around.iter().all(|&s| s <= 0.0) {
                return None;
            }
        }
        Some(change)
    }
}

/// Square of the distance of `p` from a node's box.
fn beyond(node: &Node, p: &Vec3) -> f64 {
    let beyond = |k: usize| (node.lo[k] - p[k]).max(p[k] - node.hi[k]).max(0.0);
    (0..3).map(|k| beyond(k) * beyond(k)).sum()
}

/// Positive if `d` lies below the plane of `a`, `b`, `c` (seen from above they turn left).
fn side(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> f64 {
    let [a, b, c, d] = [a, b, c, d].map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
    orient3d(a, b, c, d)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::{scatter, sphere};

    #[test]
    fn a_patch_answers_as_the_surface_does() {
        let surface = Surface::new(sphere(17, 23));
        let offsets: Vec<Vec3> = scatter(30).map(|p| p * (0.2 / 1.6)).collect();
        let mut crossed = 0;
        for centre in scatter(60) {
            let patch = Patch::new(&surface, &centre, surface.closest(&centre).distance, 0.2);
            let there = surface.winding_number(&centre).round() as i32;
            for p in offsets.iter().map(|o| centre + o) {
                assert!((patch.closest(&p).distance - surface.closest(&p).distance).abs() < 1e-12);
                let change = patch.winding_change(&centre, &p).expect("in general position");
                assert_eq!(there + change, surface.winding_number(&p).round() as i32);
                crossed += change.abs();
            }
        }
        assert!(crossed > 50, "{crossed}");
        let patch = Patch::new(&surface, &Vec3::y(), 0.0, 0.2);
        let up = Vec3::y() * 0.1;
        assert_eq!(patch.winding_change(&(Vec3::y() + up), &(Vec3::y() - up)), None, "through a vertex");
    }
}
