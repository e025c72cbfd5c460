//! Hierarchical winding numbers.
//!
//! The winding number of a surface around q is the sum of the signed solid angles of its
//! triangles over 4 pi: 1 inside and 0 outside of a closed surface, in between near the holes
//! of an open one [Jacobson 2013]. Far from a cluster of triangles the sum is replaced by its
//! Taylor expansion about the cluster's centre p [Barill 2018]. With r = p - q, d = x - p and
//! the integrals over the cluster's area with normal n, all three terms are
//!
//!   4 pi |r|^3 w(q) = N(r) + tr F - 3 F(r) / |r|^2 + (15 C(r) / |r|^2 - 3/2 lap C(r)) / |r|^2
//!   N(r) = int n.r,   F(r) = int (n.r)(d.r),   C(r) = 1/2 int (n.r)(d.r)^2
//!
//! N, F and C are a linear, a quadratic and a cubic form; the derivatives that they meet are
//! symmetric, so a form's coefficients (3 + 6 + 10) are all that is needed. *Where we differ
//! from Barill*: 19 coefficients instead of 3 + 9 + 27, and integrals over triangles exactly.

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};

use super::bvh::Node;
use super::triangle;
use crate::model::{TriMesh, Vec3};

/// A cluster is opened unless its centre is farther than this many radii. Barill's beta is 2,
/// with which our largest errors near finely meshed balls and a body are several 1e-3.
pub const OPENING: f64 = 3.5;

/// What the expansion needs of a node, parallel to the nodes; 192 bytes without padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Moments {
    /// Centre p of the expansion: area-weighted centroid [m].
    pub center: [f64; 3],
    /// Distance from the centre to the farthest corner of a triangle, or a bound of it [m].
    pub radius: f64,
    /// N: integral of the normal [m^2].
    pub normal: [f64; 3],
    /// Sum of the areas [m^2].
    pub area: f64,
    /// F by its coefficients xx, yy, zz, xy, yz, zx [m^3].
    pub quadratic: [f64; 6],
    /// C by its coefficients xxx, yyy, zzz, xxy, yyz, zzx, xyy, yzz, zxx, xyz [m^4].
    pub cubic: [f64; 10],
}

/// Clusters of up to this many nodes have their exact radius, larger ones a bound of it.
const EXACT: u32 = 8;

/// Moments of every node, children before parents.
pub(crate) fn moments(mesh: &TriMesh, nodes: &[Node]) -> Vec<Moments> {
    let mut all = vec![Moments::zeroed(); nodes.len()];
    for i in (0..nodes.len()).rev() {
        let node = &nodes[i];
        let mut m = if node.is_leaf() {
            leaf(mesh, node.triangle as usize)
        } else {
            join(&all[i + 1], &all[nodes[i + 1].skip as usize])
        };
        m.radius = radius(mesh, nodes, &all, i, &Vec3::from(m.center));
        all[i] = m;
    }
    all
}

/// Radius of node `i` about `center`: that of its children's balls or of its box where it has many nodes.
fn radius(mesh: &TriMesh, nodes: &[Node], all: &[Moments], i: usize, center: &Vec3) -> f64 {
    let node = &nodes[i];
    if node.skip - i as u32 > EXACT {
        let ball = |c: usize| (Vec3::from(all[c].center) - center).norm() + all[c].radius;
        let corner = |k: usize| (center[k] - node.lo[k]).max(node.hi[k] - center[k]);
        let balls = ball(i + 1).max(ball(nodes[i + 1].skip as usize));
        return balls.min(Vec3::new(corner(0), corner(1), corner(2)).norm());
    }
    let leaves = nodes[i..node.skip as usize].iter().filter(|leaf| leaf.is_leaf());
    let corners = leaves.flat_map(|leaf| mesh.corners(leaf.triangle as usize));
    corners.map(|p| (p - center).norm_squared()).fold(0.0, f64::max).sqrt()
}

fn leaf(mesh: &TriMesh, t: usize) -> Moments {
    let corners = mesh.corners(t);
    let center = (corners[0] + corners[1] + corners[2]) / 3.0;
    let normal = mesh.area_normal(t) / 2.0;
    // Over a triangle, int d d^T = A / 12 sum_corners d d^T about the centroid.
    let mut cubic = [0.0; 10];
    for corner in corners {
        let d = corner - center;
        add(&mut cubic, &times(&product(&normal, &d), &d), 1.0 / 24.0);
    }
    Moments { center: center.into(), normal: normal.into(), area: normal.norm(), cubic, ..Moments::zeroed() }
}

fn join(a: &Moments, b: &Moments) -> Moments {
    let area = a.area + b.area;
    let share = if area > 0.0 { b.area / area } else { 0.5 };
    let (ca, cb) = (Vec3::from(a.center), Vec3::from(b.center));
    let center = ca + (cb - ca) * share;
    let mut m = Moments { center: center.into(), area, ..Moments::zeroed() };
    for child in [a, b] {
        // About the new centre d becomes d + s.
        let s = Vec3::from(child.center) - center;
        let moved = product(&child.normal.into(), &s);
        add(&mut m.normal, &child.normal, 1.0);
        add(&mut m.quadratic, &child.quadratic, 1.0);
        add(&mut m.quadratic, &moved, 1.0);
        add(&mut m.cubic, &child.cubic, 1.0);
        add(&mut m.cubic, &times(&child.quadratic, &s), 1.0);
        add(&mut m.cubic, &times(&moved, &s), 0.5);
    }
    m
}

fn add<const N: usize>(to: &mut [f64; N], from: &[f64; N], factor: f64) {
    for k in 0..N {
        to[k] += factor * from[k];
    }
}

/// The quadratic form (a.x)(b.x).
fn product(a: &Vec3, b: &Vec3) -> [f64; 6] {
    [a.x * b.x, a.y * b.y, a.z * b.z, a.x * b.y + a.y * b.x, a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z]
}

/// The cubic form q(x)(s.x).
fn times(q: &[f64; 6], s: &Vec3) -> [f64; 10] {
    let [xx, yy, zz, xy, yz, zx] = *q;
    [
        xx * s.x,
        yy * s.y,
        zz * s.z,
        xx * s.y + xy * s.x,
        yy * s.z + yz * s.y,
        zz * s.x + zx * s.z,
        yy * s.x + xy * s.y,
        zz * s.y + yz * s.z,
        xx * s.z + zx * s.x,
        xy * s.z + yz * s.x + zx * s.y,
    ]
}

impl Moments {
    /// The cluster's share of the winding number around `q`, expanded.
    pub fn far(&self, q: &Vec3) -> f64 {
        let r = Vec3::from(self.center) - q;
        let inv2 = 1.0 / r.norm_squared();
        let inv3 = inv2 * inv2.sqrt();
        let (f, c) = (&self.quadratic, &self.cubic);
        let (xx, yy, zz) = (r.x * r.x, r.y * r.y, r.z * r.z);
        let quadratic =
            f[0] * xx + f[1] * yy + f[2] * zz + f[3] * r.x * r.y + f[4] * r.y * r.z + f[5] * r.z * r.x;
        let cubic = r.x * (c[0] * xx + c[5] * zz + c[6] * yy)
            + r.y * (c[1] * yy + c[3] * xx + c[7] * zz)
            + r.z * (c[2] * zz + c[4] * yy + c[8] * xx + c[9] * r.x * r.y);
        let half_laplacian = r.x * (3.0 * c[0] + c[5] + c[6])
            + r.y * (3.0 * c[1] + c[3] + c[7])
            + r.z * (3.0 * c[2] + c[4] + c[8]);
        let sum = Vec3::from(self.normal).dot(&r) + f[0] + f[1] + f[2] - 3.0 * quadratic * inv2
            + (15.0 * cubic * inv2 - 3.0 * half_laplacian) * inv2;
        sum * inv3 / (4.0 * PI)
    }

    /// Whether [`Moments::far`] may stand for the cluster at `q`.
    pub fn is_far(&self, q: &Vec3) -> bool {
        let reach = OPENING * self.radius;
        (Vec3::from(self.center) - q).norm_squared() > reach * reach
    }
}

/// The winding number around `q`.
pub(crate) fn number(mesh: &TriMesh, nodes: &[Node], moments: &[Moments], q: &Vec3) -> f64 {
    let mut sum = 0.0;
    let mut i = 0;
    while let Some(node) = nodes.get(i) {
        if moments[i].is_far(q) {
            sum += moments[i].far(q);
            i = node.skip as usize;
            continue;
        }
        if node.is_leaf() {
            sum += triangle::winding(q, &mesh.corners(node.triangle as usize));
        }
        i += 1;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Surface;
    use crate::geometry::surface::tests::{scatter, sphere};

    fn brute(mesh: &TriMesh, q: &Vec3) -> f64 {
        (0..mesh.triangles.len()).map(|t| triangle::winding(q, &mesh.corners(t))).sum()
    }

    fn largest_error(mesh: TriMesh) -> f64 {
        let surface = Surface::new(mesh);
        let errors = scatter(400).map(|p| {
            // Half of the points close to the surface, where clusters are opened.
            let on = surface.closest(&p);
            let q = if on.triangle.is_multiple_of(2) { on.point + (p - on.point) * 0.03 } else { p };
            (surface.winding_number(&q) - brute(surface.mesh(), &q)).abs()
        });
        errors.fold(0.0, f64::max)
    }

    #[test]
    fn the_expansion_is_of_third_order() {
        // A corner of the sphere, seen from ever farther away: its share falls with the second
        // power of the distance and the error of the expansion with the fifth.
        let mut mesh = sphere(8, 12);
        mesh.triangles.truncate(30);
        let surface = Surface::new(mesh);
        let direction = Vec3::new(0.5, 0.8, -0.3).normalize();
        let error = |distance: f64| {
            let q = Vec3::from(surface.moments()[0].center) + direction * distance;
            (surface.moments()[0].far(&q) - brute(surface.mesh(), &q)).abs()
        };
        let order = (error(20.0) / error(40.0)).log2();
        assert!((order - 5.0).abs() < 0.2, "{order}");
    }

    #[test]
    fn agrees_with_solid_angles_on_a_closed_surface() {
        assert!(largest_error(sphere(60, 90)) < 1e-3);
    }

    #[test]
    fn agrees_with_solid_angles_on_an_open_surface() {
        // A sleeve: the sphere without its caps, so that the number takes every value.
        let mut mesh = sphere(60, 90);
        let points = mesh.points.clone();
        mesh.triangles.retain(|t| t.iter().all(|&i| points[i as usize].y.abs() < 0.6));
        assert!(largest_error(mesh) < 1e-3);
    }

    #[test]
    fn inside_is_one_and_outside_is_zero() {
        let surface = Surface::new(sphere(30, 40));
        for p in scatter(300) {
            let w = surface.winding_number(&p);
            if p.norm() < 0.98 {
                assert!((w - 1.0).abs() < 1e-3, "{w}");
            } else if p.norm() > 1.0 {
                assert!(w.abs() < 1e-3, "{w}");
            }
        }
    }
}
