//! A collider: a surface that stands still within a step, with its outward pseudo-normals.
//!
//! The side of a point near a closed mesh is the sign of its offset from the closest point
//! against the angle-weighted pseudo-normal there [Baerentzen and Aanaes 2005]. An open
//! sheet (a finished lower garment) has sides only away from its borders: at hems and necks
//! contact is unsigned, so that nothing is pushed by a cap that is not there.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::tree::{BoxTree, bounds};
use crate::geometry::Surface;
use crate::model::{TriMesh, Vec3};

/// Winding number above which a point counts as inside of a solid.
pub(super) const SOLID_THRESHOLD: f64 = 0.5;
/// The same for a garment, which is open (paper section 5, Unified Collision SDFs).
const LAYER_THRESHOLD: f64 = 0.25;
/// Deepest start below a lower garment that is taken for a fault [m].
const LAYER_DEPTH: f64 = 0.03;

/// Cosine between cloth and skin from which on they face the same way.
pub(super) const FACING: f64 = 0.2;
/// How much farther than the closest point a way out may be that faces the same way.
const DETOUR: f64 = 2.0;
/// The same for shallow points [m].
const DETOUR_MIN: f64 = 5e-3;

/// How far a way out around hidden skin may be [m].
const AROUND: f64 = 0.15;
/// A triangle is looked at from this far above it [m].
const ABOVE: f64 = 1e-3;

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

/// Unit normals, zero where a triangle has none.
fn triangle_normals(mesh: &TriMesh) -> Vec<Vec3> {
    let unit = |n: Vec3| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    (0..mesh.triangles.len()).map(|t| unit(mesh.area_normal(t))).collect()
}

/// Where a point is, seen from a collider.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    /// Closest point [m].
    pub point: Vec3,
    /// The triangle that it lies on.
    pub triangle: u32,
    /// Outward pseudo-normal there.
    pub normal: Vec3,
    /// Distance, negative inside [m].
    pub signed: f64,
    /// Whether the closest point lies on an open border.
    pub border: bool,
}

/// Parts of a collider that lie inside of it, see [`Fixed::hidden`].
#[derive(Clone, Debug)]
pub struct Hidden {
    /// Triangles, as their centres are.
    pub triangles: Vec<bool>,
    /// Triangles with a corner or their centre inside.
    pub partly: Vec<bool>,
    /// Edges with no other triangle.
    pub edges: Vec<bool>,
    /// Points with no other triangle.
    pub points: Vec<bool>,
}

/// A collider with what contact asks of it.
pub struct Fixed<'a> {
    /// The surface.
    pub surface: Cow<'a, Surface>,
    /// Whether it encloses a volume (a body) or is a sheet (a garment).
    pub solid: bool,
    /// Edges; shared with colliders that differ in their points alone.
    pub edges: Arc<Edges>,
    /// Outward unit normals of the triangles.
    pub triangle_normals: Vec<Vec3>,
    /// Points that a triangle uses.
    pub used: Arc<Vec<bool>>,
    /// Broad phase over triangles, edges and points.
    pub triangle_tree: BoxTree,
    /// See [`Fixed::triangle_tree`].
    pub edge_tree: BoxTree,
    /// See [`Fixed::triangle_tree`].
    pub point_tree: BoxTree,
    hidden: OnceLock<Hidden>,
}

impl<'a> Fixed<'a> {
    /// Prepares a collider.
    pub fn new(surface: &'a Surface, solid: bool) -> Fixed<'a> {
        let mesh = surface.mesh();
        let edges = Edges::new(&mesh.triangles);
        let mut used = vec![false; mesh.points.len()];
        edges.ends.iter().flatten().for_each(|&p| used[p as usize] = true);
        let point = |p: u32| mesh.points[p as usize];
        Fixed {
            solid,
            triangle_normals: triangle_normals(mesh),
            used: Arc::new(used),
            triangle_tree: BoxTree::new(mesh.triangles.iter().map(|t| bounds(&t.map(point), 0.0))),
            edge_tree: BoxTree::new(edges.ends.iter().map(|e| bounds(&e.map(point), 0.0))),
            point_tree: BoxTree::new(mesh.points.iter().map(|p| (*p, *p))),
            edges: Arc::new(edges),
            surface: Cow::Borrowed(surface),
            hidden: OnceLock::new(),
        }
    }

    /// The collider with its points elsewhere; its trees are fitted and not built again.
    pub fn moved(&self, points: Vec<Vec3>) -> Fixed<'a> {
        let surface = self.surface.moved(points);
        let mesh = surface.mesh();
        let point = |p: u32| mesh.points[p as usize];
        Fixed {
            solid: self.solid,
            triangle_normals: triangle_normals(mesh),
            used: Arc::clone(&self.used),
            triangle_tree: self.triangle_tree.fitted(|t| bounds(&mesh.triangles[t as usize].map(point), 0.0)),
            edge_tree: self.edge_tree.fitted(|e| bounds(&self.edges.ends[e as usize].map(point), 0.0)),
            point_tree: self.point_tree.fitted(|p| (point(p), point(p))),
            edges: Arc::clone(&self.edges),
            surface: Cow::Owned(surface),
            hidden: OnceLock::new(),
        }
    }

    /// What of a solid lies inside of it: where a body crosses itself, an arm pressed into its
    /// flank, its skin bounds nothing. Found, in parallel, when it is first asked for: never first
    /// from within a parallel loop, whose other workers would wait for one another.
    pub fn hidden(&self) -> &Hidden {
        self.hidden.get_or_init(|| {
            let mesh = self.mesh();
            let covered = |at: Vec3, normal: Vec3| {
                self.solid && self.surface.winding_number(&(at + normal * ABOVE)) > SOLID_THRESHOLD
            };
            let centre = |t: usize| mesh.corners(t).iter().sum::<Vec3>() / 3.0;
            let triangles: Vec<bool> = (0..mesh.triangles.len())
                .into_par_iter()
                .map(|t| covered(centre(t), self.triangle_normals[t]))
                .collect();
            let normals = self.surface.point_normals();
            let corners: Vec<bool> =
                mesh.points.par_iter().zip(normals).map(|(p, n)| covered(*p, *n)).collect();
            let partly = mesh.triangles.iter().zip(&triangles);
            let partly = partly.map(|(c, t)| *t || c.iter().any(|&p| corners[p as usize])).collect();
            let shown = |t: &u32| !triangles[*t as usize];
            let edges = self.edges.triangles.iter().map(|sides| !sides.iter().any(shown)).collect();
            let mut points = vec![true; mesh.points.len()];
            for (triangle, _) in mesh.triangles.iter().zip(&triangles).filter(|(_, hidden)| !**hidden) {
                triangle.iter().for_each(|&p| points[p as usize] = false);
            }
            Hidden { triangles, partly, edges, points }
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &TriMesh {
        self.surface.mesh()
    }

    /// Outward pseudo-normal of edge `e`.
    pub fn edge_normal(&self, e: u32) -> Vec3 {
        let t = self.edges.triangles[e as usize][0] as usize;
        let from = self.edges.of_triangle[t].iter().position(|&own| own == e).unwrap_or(0);
        // The surface counts edges by the corner opposite.
        self.surface.edge_normals()[t][(from + 2) % 3]
    }

    /// The closest point of the surface and the side that `x` is on.
    pub fn side(&self, x: &Vec3) -> Side {
        let closest = self.surface.closest(x);
        let (normal, border) = (self.surface.pseudo_normal(&closest), self.surface.is_boundary(&closest));
        let inside = (x - closest.point).dot(&normal) < 0.0;
        let signed = if inside { -closest.distance } else { closest.distance };
        Side { point: closest.point, triangle: closest.triangle, normal, signed, border }
    }

    /// Where `x` is to leave: the closest point or, with the cloth's outward `normal` there, the
    /// closest of those that face the same way. An armpit's cloth then goes to the armpit and not
    /// to the chest, and the two layers in a fold of the skin each to their own side of it. Skin
    /// inside of the body is no way out.
    pub fn way_out(&self, x: &Vec3, normal: Option<&Vec3>) -> Side {
        let side = self.side(x);
        let faces = |t: u32| normal.is_none_or(|n| self.triangle_normals[t as usize].dot(n) > FACING);
        let hidden = self.hidden();
        let shown = |t: u32| !hidden.partly[t as usize];
        let buried = !shown(side.triangle);
        if !buried && normal.is_none_or(|n| n.dot(&side.normal) >= FACING) {
            return side;
        }
        let reach = if buried { AROUND } else { DETOUR * side.signed.abs() + DETOUR_MIN };
        let facing = self.surface.closest_among(x, reach, |t| shown(t) && faces(t));
        let any = || if buried { self.surface.closest_among(x, reach, shown) } else { None };
        match facing.or_else(any) {
            Some(c) => Side {
                point: c.point,
                triangle: c.triangle,
                normal: self.triangle_normals[c.triangle as usize],
                signed: -c.distance,
                border: false,
            },
            None => side,
        }
    }

    /// Whether `x`, outside of the skin at `side`, is inside of the body all the same, since that
    /// skin is. Slower than [`Fixed::is_inside`], and worth asking only where something is inside.
    pub fn is_buried(&self, x: &Vec3, side: &Side) -> bool {
        side.signed >= 0.0
            && self.hidden().triangles[side.triangle as usize]
            && self.surface.winding_number(x) > SOLID_THRESHOLD
    }

    /// Whether `x`, seen at `side`, starts on the wrong side: inside by its pseudo-normal *and* by
    /// the winding number, and for a sheet neither past a border nor too deep to be meant.
    pub fn is_inside(&self, x: &Vec3, side: &Side) -> bool {
        if side.signed >= 0.0 || (!self.solid && (side.border || side.signed < -LAYER_DEPTH)) {
            return false;
        }
        let threshold = if self.solid { SOLID_THRESHOLD } else { LAYER_THRESHOLD };
        self.surface.winding_number(x) > threshold
    }
}
