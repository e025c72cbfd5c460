//! A triangle mesh that answers questions.

use std::sync::{Arc, OnceLock};

use super::bvh::{self, Node};
use super::topology::Topology;
use super::triangle;
use super::winding::{self, Moments};
use crate::model::{TriMesh, Vec3};

/// A point of a surface closest to some other point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Position [m].
    pub point: Vec3,
    /// Triangle; `u32::MAX` if the surface has none.
    pub triangle: u32,
    /// Barycentric coordinates in the triangle, exactly 0 on edges and at vertices.
    pub barycentric: [f64; 3],
    /// Distance [m]; infinite if the surface has no triangle.
    pub distance: f64,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Triangle.
    pub triangle: u32,
    /// Barycentric coordinates in the triangle.
    pub barycentric: [f64; 3],
    /// Distance from the origin [m].
    pub distance: f64,
}

/// A mesh with its hierarchy. All else (winding-number moments, pseudo-normals, what is next to
/// what) is made when it is first asked for.
///
/// Surfaces need not be closed, clean or connected. Edge `k` of a triangle is the one
/// opposite to its corner `k`.
#[derive(Clone)]
pub struct Surface {
    mesh: TriMesh,
    nodes: Vec<Node>,
    /// Shared with surfaces that differ in the points alone.
    topology: Arc<OnceLock<Topology>>,
    /// Whether this was moved, to be asked a few questions before it is moved again: then single
    /// pseudo-normals are cheaper than all.
    moved: bool,
    moments: OnceLock<Vec<Moments>>,
    point_normals: OnceLock<Vec<Vec3>>,
    edge_normals: OnceLock<Vec<[Vec3; 3]>>,
}

impl std::fmt::Debug for Surface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (points, triangles) = (self.mesh.points.len(), self.mesh.triangles.len());
        f.debug_struct("Surface").field("points", &points).field("triangles", &triangles).finish()
    }
}

impl Surface {
    /// Builds the hierarchy.
    ///
    /// # Panics
    /// If a triangle names a point that is not there; meshes are checked where they are read.
    pub fn new(mesh: TriMesh) -> Surface {
        let nodes = bvh::build(&mesh);
        Surface::over(mesh, nodes, Arc::default(), false)
    }

    /// The surface with its points elsewhere. The hierarchy is refitted and not built again: it answers
    /// the same, a little slower where neighbours have moved apart.
    ///
    /// # Panics
    /// If there are not as many points.
    pub fn moved(&self, points: Vec<Vec3>) -> Surface {
        assert_eq!(points.len(), self.mesh.points.len(), "the same points");
        let mesh = TriMesh { points, triangles: self.mesh.triangles.clone() };
        let mut nodes = self.nodes.clone();
        bvh::refit(&mut nodes, &mesh);
        Surface::over(mesh, nodes, Arc::clone(&self.topology), true)
    }

    fn over(mesh: TriMesh, nodes: Vec<Node>, topology: Arc<OnceLock<Topology>>, moved: bool) -> Surface {
        let (moments, point_normals, edge_normals) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        Surface { mesh, nodes, topology, moved, moments, point_normals, edge_normals }
    }

    /// The mesh.
    pub fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// The hierarchy in depth-first order, see [`Node`].
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Winding-number moments of each node.
    pub fn moments(&self) -> &[Moments] {
        self.moments.get_or_init(|| winding::moments(&self.mesh, &self.nodes))
    }

    /// Pseudo-normals of the points: unit, angle-weighted.
    pub fn point_normals(&self) -> &[Vec3] {
        self.point_normals.get_or_init(|| self.mesh.point_normals())
    }

    /// Pseudo-normals of the edges of each triangle: unit sums of the adjacent faces' normals.
    pub fn edge_normals(&self) -> &[[Vec3; 3]] {
        self.edge_normals.get_or_init(|| {
            let topology = self.topology();
            let normals = |t| [0, 1, 2].map(|k| topology.edge_normal(&self.mesh, t, k));
            (0..self.mesh.triangles.len() as u32).map(normals).collect()
        })
    }

    /// Whether each point lies on an open edge.
    pub fn open_points(&self) -> &[bool] {
        &self.topology().open_points
    }

    /// Whether each edge of each triangle belongs to that triangle alone.
    pub fn open_edges(&self) -> &[[bool; 3]] {
        &self.topology().open_edges
    }

    /// Whether the surface has no border: every edge is passed as often one way as the other.
    /// Then the winding number is a whole number that changes only across triangles.
    pub fn is_closed(&self) -> bool {
        self.topology().closed
    }

    fn topology(&self) -> &Topology {
        self.topology.get_or_init(|| Topology::new(&self.mesh))
    }

    /// The closest point of the surface.
    pub fn closest(&self, p: &Vec3) -> Closest {
        self.closest_within(p, f64::MAX).unwrap_or(Closest {
            point: *p,
            triangle: u32::MAX,
            barycentric: [0.0; 3],
            distance: f64::INFINITY,
        })
    }

    /// The closest point of the surface; a triangle that is near it makes the search shorter.
    ///
    /// # Panics
    /// If the guess is no triangle of the surface.
    pub fn closest_from(&self, p: &Vec3, guess: Option<u32>) -> Closest {
        let Some(t) = guess.filter(|&t| t != u32::MAX) else {
            return self.closest(p);
        };
        let corners = self.mesh.corners(t as usize);
        let barycentric = triangle::closest(p, &corners);
        let point = triangle::at(&corners, &barycentric);
        let guessed = Closest { point, triangle: t, barycentric, distance: (point - p).norm() };
        self.closest_within(p, guessed.distance).unwrap_or(guessed)
    }

    /// The closest point of the surface, if it is nearer than `max_distance` [m].
    pub fn closest_within(&self, p: &Vec3, max_distance: f64) -> Option<Closest> {
        self.closest_among(p, max_distance, |_| true)
    }

    /// As [`Surface::closest_within`], among the triangles that `keep` says.
    pub fn closest_among(&self, p: &Vec3, max_distance: f64, keep: impl Fn(u32) -> bool) -> Option<Closest> {
        let on = |t: u32| {
            let corners = self.mesh.corners(t as usize);
            let barycentric = triangle::closest(p, &corners);
            let point = triangle::at(&corners, &barycentric);
            keep(t).then(|| ((point - p).norm_squared(), (point, barycentric)))
        };
        let bound = max_distance * max_distance;
        let found = bvh::find_best(&self.nodes, bound, |node| node.distance_squared(p), on);
        let (triangle, squared, (point, barycentric)) = found?;
        Some(Closest { point, triangle, barycentric, distance: squared.sqrt() })
    }

    /// The first triangle that the ray meets within `max` [m], from either side; `direction`
    /// may have any length but zero.
    pub fn ray(&self, origin: &Vec3, direction: &Vec3, max: f64) -> Option<Hit> {
        let unit = direction.try_normalize(0.0)?;
        let inverse = unit.map(|x| 1.0 / x);
        let meets = |t: u32| triangle::ray(origin, &unit, &self.mesh.corners(t as usize));
        let found = bvh::find_best(&self.nodes, max, |node| node.along_ray(origin, &inverse), meets);
        let (triangle, distance, barycentric) = found?;
        Some(Hit { triangle, barycentric, distance })
    }

    /// The winding number around `p`; its error stays below 1e-3 [Barill 2018].
    pub fn winding_number(&self, p: &Vec3) -> f64 {
        winding::number(&self.mesh, &self.nodes, self.moments(), p)
    }

    /// Calls `f` with every triangle whose box has a point in common with `[lo, hi]`.
    pub fn triangles_in_box(&self, lo: &Vec3, hi: &Vec3, f: &mut dyn FnMut(u32)) {
        let mut i = 0;
        while let Some(node) = self.nodes.get(i) {
            if !node.overlaps(lo, hi) {
                i = node.skip as usize;
                continue;
            }
            if node.is_leaf() {
                f(node.triangle);
            }
            i += 1;
        }
    }

    /// The pseudo-normal at a closest point: of its face, edge or vertex, whichever it is
    /// [Baerentzen 2005]. Its sign against `p - closest` tells the side. Zero where the faces
    /// around have no normal or cancel.
    pub fn pseudo_normal(&self, closest: &Closest) -> Vec3 {
        let t = closest.triangle as usize;
        match feature(&closest.barycentric) {
            Feature::Vertex(k) => self.point_normal(self.mesh.triangles[t][k]),
            Feature::Edge(k) => self.edge_normal(t, k),
            Feature::Face => self.mesh.area_normal(t).try_normalize(0.0).unwrap_or_else(Vec3::zeros),
        }
    }

    /// The pseudo-normal of a point, see [`Surface::point_normals`].
    pub fn point_normal(&self, point: u32) -> Vec3 {
        match self.point_normals.get() {
            None if self.moved => self.topology().point_normal(&self.mesh, point),
            _ => self.point_normals()[point as usize],
        }
    }

    fn edge_normal(&self, t: usize, k: usize) -> Vec3 {
        match self.edge_normals.get() {
            None if self.moved => self.topology().edge_normal(&self.mesh, t as u32, k as u32),
            _ => self.edge_normals()[t][k],
        }
    }

    /// Whether a closest point lies on an open edge of the surface.
    pub fn is_boundary(&self, closest: &Closest) -> bool {
        let t = closest.triangle as usize;
        match feature(&closest.barycentric) {
            Feature::Vertex(k) => self.open_points()[self.mesh.triangles[t][k] as usize],
            Feature::Edge(k) => self.open_edges()[t][k],
            Feature::Face => false,
        }
    }
}

enum Feature {
    Vertex(usize),
    Edge(usize),
    Face,
}

fn feature(barycentric: &[f64; 3]) -> Feature {
    let zero = barycentric.map(|b| b == 0.0);
    for k in 0..3 {
        if zero[(k + 1) % 3] && zero[(k + 2) % 3] {
            return Feature::Vertex(k);
        }
    }
    zero.iter().position(|&z| z).map_or(Feature::Face, Feature::Edge)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A unit sphere of `rings` by `sectors`, closed, seen from outside.
    pub(crate) fn sphere(rings: usize, sectors: usize) -> TriMesh {
        let mut points = vec![Vec3::y()];
        for i in 1..rings {
            let polar = std::f64::consts::PI * i as f64 / rings as f64;
            for j in 0..sectors {
                let turn = std::f64::consts::TAU * j as f64 / sectors as f64;
                points.push(Vec3::new(polar.sin() * turn.sin(), polar.cos(), polar.sin() * turn.cos()));
            }
        }
        points.push(-Vec3::y());
        let at = |i: usize, j: usize| match i {
            0 => 0,
            i if i == rings => points.len() as u32 - 1,
            i => (1 + (i - 1) * sectors + j % sectors) as u32,
        };
        let mut triangles = Vec::new();
        for i in 0..rings {
            for j in 0..sectors {
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                if i + 1 < rings {
                    triangles.push([a, b, c]);
                }
                if i > 0 {
                    triangles.push([a, c, d]);
                }
            }
        }
        TriMesh { points, triangles }
    }

    /// Points spread over a ball of radius 1.6, the same in every run.
    pub(crate) fn scatter(n: usize) -> impl Iterator<Item = Vec3> {
        (0..n).map(|i| {
            let t = i as f64 + 0.5;
            let direction = Vec3::new((t * 2.399).cos(), (t * 0.618).sin(), (t * 1.733).sin());
            direction.normalize() * 1.6 * ((t * 0.754877).fract()).cbrt()
        })
    }

    #[test]
    fn closest_point_agrees_with_trying_every_triangle() {
        let surface = Surface::new(sphere(14, 19));
        for p in scatter(300) {
            let found = surface.closest(&p);
            let brute = (0..surface.mesh().triangles.len())
                .map(|t| {
                    let corners = surface.mesh().corners(t);
                    (triangle::at(&corners, &triangle::closest(&p, &corners)) - p).norm()
                })
                .fold(f64::MAX, f64::min);
            assert_eq!(found.distance, brute);
            assert!(surface.closest_within(&p, brute * 0.999).is_none());
            assert!(surface.closest_within(&p, brute * 1.001 + 1e-9).is_some());
        }
    }

    #[test]
    fn the_sign_against_the_pseudo_normal_tells_the_side() {
        let surface = Surface::new(sphere(10, 13));
        for p in scatter(500) {
            let on = surface.closest(&p);
            let out = (p - on.point).dot(&surface.pseudo_normal(&on)) > 0.0;
            assert_eq!(out, surface.winding_number(&p) < 0.5, "{p:?} {on:?}");
        }
    }

    #[test]
    fn a_moved_surface_answers_as_a_new_one() {
        let mesh = sphere(14, 19);
        let wave = |p: &Vec3| Vec3::new(p.x + 0.3 * (4.0 * p.y).sin(), -0.7 * p.y, p.z * (1.2 + p.x));
        let points: Vec<Vec3> = mesh.points.iter().map(wave).collect();
        let moved = Surface::new(mesh.clone()).moved(points.clone());
        let new = Surface::new(TriMesh { points, triangles: mesh.triangles });
        for p in scatter(300) {
            let (a, b) = (moved.closest(&p), new.closest(&p));
            assert_eq!(a.distance, b.distance);
            assert!((moved.winding_number(&p) - new.winding_number(&p)).abs() < 2e-3);
            let hits = [&moved, &new].map(|s| s.ray(&p, &-p, 4.0).map(|hit| hit.distance));
            assert_eq!(hits[0], hits[1]);
            assert!((moved.pseudo_normal(&a) - new.pseudo_normal(&a)).norm() < 1e-12);
        }
    }

    #[test]
    fn vertices_and_edges_have_their_own_normals_and_boundaries() {
        // A roof of two squares folded by a right angle, open all around.
        let points = vec![
            Vec3::new(0.0, 0.0, 0.0),
            Vec3::new(1.0, 0.0, 0.0),
            Vec3::new(1.0, 0.0, 1.0),
            Vec3::new(0.0, 1.0, 0.0),
        ];
        let surface = Surface::new(TriMesh { points, triangles: vec![[0, 2, 1], [0, 1, 3]] });
        let on = surface.closest(&Vec3::new(0.5, -0.1, -0.1));
        assert!((on.point - Vec3::new(0.5, 0.0, 0.0)).norm() < 1e-15);
        assert!(!surface.is_boundary(&on));
        let expected = Vec3::new(0.0, 1.0, 1.0).normalize();
        assert!((surface.pseudo_normal(&on) - expected).norm() < 1e-12);
        let rim = surface.closest(&Vec3::new(1.3, 0.2, 0.5));
        assert!(surface.is_boundary(&rim));
        assert!(surface.is_boundary(&surface.closest(&Vec3::new(-1.0, 3.0, 0.0))));
    }

    #[test]
    fn rays_meet_the_near_side_first() {
        let surface = Surface::new(sphere(40, 60));
        let origin = Vec3::new(0.1, 0.2, -3.0);
        let hit = surface.ray(&origin, &Vec3::new(0.0, 0.0, 2.0), 10.0).expect("aims at the ball");
        let at = triangle::at(&surface.mesh().corners(hit.triangle as usize), &hit.barycentric);
        assert!((at - (origin + Vec3::z() * hit.distance)).norm() < 1e-12);
        assert!((hit.distance - (3.0 - (1.0f64 - 0.05).sqrt())).abs() < 0.01);
        assert!(surface.ray(&origin, &Vec3::z(), 1.5).is_none());
        assert!(surface.ray(&origin, &-Vec3::z(), 10.0).is_none());
    }

    #[test]
    fn box_query_reports_every_overlapping_triangle_once() {
        let surface = Surface::new(sphere(12, 15));
        let (lo, hi) = (Vec3::new(-0.2, -0.3, 0.1), Vec3::new(0.9, 0.7, 1.5));
        let mut found = Vec::new();
        surface.triangles_in_box(&lo, &hi, &mut |t| found.push(t));
        found.sort_unstable();
        let expected: Vec<u32> = (0..surface.mesh().triangles.len() as u32)
            .filter(|&t| {
                let [a, b, c] = surface.mesh().corners(t as usize);
                let (tlo, thi) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
                (0..3).all(|k| tlo[k] <= hi[k] && lo[k] <= thi[k])
            })
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn an_empty_surface_is_infinitely_far() {
        let surface = Surface::new(TriMesh::default());
        assert_eq!(surface.closest(&Vec3::zeros()).distance, f64::INFINITY);
        assert_eq!(surface.winding_number(&Vec3::zeros()), 0.0);
        assert!(surface.ray(&Vec3::zeros(), &Vec3::x(), 1.0).is_none());
    }
}
