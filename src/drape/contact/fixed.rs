//! A collider: a surface that does not move, with its outward pseudo-normals.
//!
//! The side of a point near a closed mesh is the sign of its offset from the closest point
//! against the angle-weighted pseudo-normal there [Baerentzen and Aanaes 2005]. An open
//! sheet (a finished lower garment) has sides only away from its borders: at hems and necks
//! contact is unsigned, so that nothing is pushed by a cap that is not there.

use std::collections::HashMap;

use super::tree::{BoxTree, bounds};
use crate::geometry::Surface;
use crate::model::{TriMesh, Vec3};

/// Winding number above which a point counts as inside of a solid.
const SOLID_THRESHOLD: f64 = 0.5;
/// The same for a garment, which is open (paper section 5, Unified Collision SDFs).
const LAYER_THRESHOLD: f64 = 0.25;
/// Deepest start below a lower garment that is taken for a fault [m].
const LAYER_DEPTH: f64 = 0.03;
/// A barycentric coordinate below this puts a closest point on the border of its triangle.
const ON_BORDER: f64 = 1e-9;

/// Edges of a mesh with the triangles at their sides.
#[derive(Clone, Debug, Default)]
pub struct Edges {
    /// Ends, the smaller index first, in order of first appearance.
    pub ends: Vec<[u32; 2]>,
    /// Triangles at each edge's sides (more than two where it is not manifold).
    pub triangles: Vec<Vec<u32>>,
    /// Edges of each triangle; edge `k` runs from corner `k` to corner `k + 1`.
    pub of_triangle: Vec<[u32; 3]>,
}

impl Edges {
    /// The edges of some triangles.
    pub fn new(triangles: &[[u32; 3]]) -> Edges {
        let mut edges = Edges::default();
        let mut index = HashMap::new();
        for (t, tri) in triangles.iter().enumerate() {
            edges.of_triangle.push(std::array::from_fn(|k| {
                let (a, b) = (tri[k], tri[(k + 1) % 3]);
                let e = *index.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    edges.ends.push([a.min(b), a.max(b)]);
                    edges.triangles.push(Vec::new());
                    edges.ends.len() as u32 - 1
                });
                edges.triangles[e as usize].push(t as u32);
                e
            }));
        }
        edges
    }
}

/// Where a point is, seen from a collider.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Closest point [m].
    pub point: Vec3,
    /// Outward pseudo-normal there.
    pub normal: Vec3,
    /// Distance, negative inside [m].
    pub signed: f64,
    /// Whether the closest point lies on an open border.
    pub border: bool,
}

/// A collider with what contact asks of it.
pub struct Fixed<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// Whether it encloses a volume (a body) or is a sheet (a garment).
    pub solid: bool,
    /// Edges.
    pub edges: Edges,
    /// Outward unit normals per point, edge and triangle.
    pub point_normals: Vec<Vec3>,
    /// See [`Fixed::point_normals`].
    pub edge_normals: Vec<Vec3>,
    /// See [`Fixed::point_normals`].
    pub triangle_normals: Vec<Vec3>,
    /// Points on an open border.
    pub border: Vec<bool>,
    /// Points that a triangle uses.
    pub used: Vec<bool>,
    /// Broad phase over triangles, edges and points.
    pub triangle_tree: BoxTree,
    /// See [`Fixed::triangle_tree`].
    pub edge_tree: BoxTree,
    /// See [`Fixed::triangle_tree`].
    pub point_tree: BoxTree,
}

impl<'a> Fixed<'a> {
    /// Prepares a collider.
    pub fn new(surface: &'a Surface, solid: bool) -> Fixed<'a> {
        let mesh = surface.mesh();
        let edges = Edges::new(&mesh.triangles);
        let unit = |n: Vec3| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        let triangle_normals: Vec<Vec3> =
            (0..mesh.triangles.len()).map(|t| unit(mesh.area_normal(t))).collect();
        let edge_normals = edges
            .triangles
            .iter()
            .map(|around| unit(around.iter().map(|&t| triangle_normals[t as usize]).sum()))
            .collect();
        let (mut border, mut used) = (vec![false; mesh.points.len()], vec![false; mesh.points.len()]);
        for (ends, around) in edges.ends.iter().zip(&edges.triangles) {
            for &p in ends {
                border[p as usize] |= around.len() == 1;
                used[p as usize] = true;
            }
        }
        let point = |p: u32| mesh.points[p as usize];
        Fixed {
            surface,
            solid,
            point_normals: mesh.point_normals(),
            edge_normals,
            triangle_normals,
            border,
            used,
            triangle_tree: BoxTree::new(mesh.triangles.iter().map(|t| bounds(&t.map(point), 0.0))),
            edge_tree: BoxTree::new(edges.ends.iter().map(|e| bounds(&e.map(point), 0.0))),
            point_tree: BoxTree::new(mesh.points.iter().map(|p| (*p, *p))),
            edges,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &TriMesh {
        self.surface.mesh()
    }

    /// The closest point of the surface and the side that `x` is on.
    pub fn side(&self, x: &Vec3) -> Side {
        let closest = self.surface.closest(x);
        let t = closest.triangle as usize;
        let tri = self.mesh().triangles[t];
        let off: Vec<usize> = (0..3).filter(|&k| closest.barycentric[k] < ON_BORDER).collect();
        let (normal, border) = match off[..] {
            [] => (self.triangle_normals[t], false),
            [k] => {
                let e = self.edges.of_triangle[t][(k + 1) % 3] as usize;
                (self.edge_normals[e], self.edges.triangles[e].len() == 1)
            }
            _ => {
                let k = (0..3).find(|k| !off.contains(k)).unwrap_or(0);
                let p = tri[k] as usize;
                (self.point_normals[p], self.border[p])
            }
        };
        let inside = (x - closest.point).dot(&normal) < 0.0;
        let signed = if inside { -closest.distance } else { closest.distance };
        Side { point: closest.point, normal, signed, border }
    }

    /// Whether `x` starts on the wrong side: inside by its pseudo-normal *and* by the winding
    /// number, and for a sheet neither past a border nor too deep to be meant.
    pub fn is_inside(&self, x: &Vec3) -> bool {
        let side = self.side(x);
        if side.signed >= 0.0 || (!self.solid && (side.border || side.signed < -LAYER_DEPTH)) {
            return false;
        }
        let threshold = if self.solid { SOLID_THRESHOLD } else { LAYER_THRESHOLD };
        self.surface.winding_number(x) > threshold
    }
}
