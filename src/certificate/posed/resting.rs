//! Where each vertex of a garment is when garment and body are posed.

use rayon::prelude::*;

use super::PoseFigures;
use crate::certificate::strain::percentiles;
use crate::geometry::skinning::skin_points;
use crate::geometry::{Closest, Surface, triangle};
use crate::model::{Skin, TriMesh, Vec3};
use crate::pose::Pose;

/// A point with a larger winding number is inside the body.
const INSIDE: f64 = 0.5;
/// A point with a larger winding number is in two parts of the body at once.
const OVERLAP: f64 = 1.5;
/// How far above the skin it is asked whether the skin lies inside the body [m].
const ABOVE_SKIN: f64 = 5e-4;
/// Nearer to the surface than this no side is told [m].
const TOUCH: f64 = 1e-6;

/// A garment's mesh with what is known of it in the bind pose.
pub struct Resting<'a> {
    mesh: &'a TriMesh,
    /// Vertices outside of the body.
    pub vertices: Vec<Spot>,
    /// Faces that are outside with their corners, each by its centre.
    pub faces: Vec<Spot>,
    /// Edges with their lengths [m].
    edges: Vec<([u32; 2], f64)>,
}

/// A vertex, or the centre of a face, with its closest body point.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Which one.
    pub index: usize,
    /// Its closest body point in the bind pose.
    pub anchor: Anchor,
}

/// A point of the body's surface.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    /// Triangle of the outer skin.
    pub triangle: u32,
    /// Where in the triangle.
    pub barycentric: [f64; 3],
}

/// Where a spot is in a pose.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// Outside, and so is all that is nearer to it than `clear` [m]; the closest point of the skin, where
    /// that was looked for and is nearer than its own.
    Outside {
        /// See above.
        clear: f64,
        /// See above.
        on: Option<Closest>,
    },
    /// Inside; the closest point of the skin.
    Inside(Closest),
    /// Where the body overlaps itself.
    Overlap,
}

impl Place {
    /// Outside, and no more is known.
    pub const OUTSIDE: Place = Place::Outside { clear: 0.0, on: None };
}

impl<'a> Resting<'a> {
    /// A mesh, sewn vertices merged, on the body in the bind pose.
    pub fn new(mesh: &'a TriMesh, body: &Surface) -> Resting<'a> {
        let bind = |index: usize, p: &Vec3, guess: Option<u32>| {
            let on = body.closest_from(p, guess);
            let outward = body.pseudo_normal(&on).dot(&(p - on.point)) >= 0.0;
            let outside = outward || body.winding_number(p) <= INSIDE;
            let anchor = Anchor { triangle: on.triangle, barycentric: on.barycentric };
            outside.then_some(Spot { index, anchor })
        };
        let vertices: Vec<Option<Spot>> =
            mesh.points.par_iter().enumerate().map(|(v, p)| bind(v, p, None)).collect();
        let face = |t: usize| {
            let corners = mesh.triangles[t].map(|v| vertices[v as usize]);
            let guess = corners[0]?.anchor.triangle;
            corners
                .iter()
                .all(Option::is_some)
                .then(|| bind(t, &centre(mesh, &mesh.points, t), Some(guess)))?
        };
        let faces = (0..mesh.triangles.len()).into_par_iter().filter_map(face).collect();
        Resting { mesh, vertices: vertices.into_iter().flatten().collect(), faces, edges: edges(mesh) }
    }

    /// The centre of a face of the mesh at `points`.
    pub fn centre(&self, points: &[Vec3], face: usize) -> Vec3 {
        centre(self.mesh, points, face)
    }

    /// The corners of a face.
    pub fn corners(&self, face: usize) -> [usize; 3] {
        self.mesh.triangles[face].map(|v| v as usize)
    }

    /// Whether a face's centre is outside because a corner is that far from the body: `clear` says for
    /// each vertex within which distance all is outside, 0 or less if nothing is known [m].
    pub fn is_clear(&self, points: &[Vec3], clear: &[f64], face: usize) -> bool {
        let centre = self.centre(points, face);
        self.corners(face).iter().any(|&v| (centre - points[v]).norm() < clear[v])
    }

    /// The figures of one pose.
    pub(super) fn judge(&self, body: &Surface, skin: &Skin, pose: &Pose) -> PoseFigures {
        let points = skin_points(&self.mesh.points, skin, &pose.matrices);
        let of_vertex = |spot: &Spot| place(body, &points[spot.index], &spot.anchor);
        let vertices: Vec<Place> = self.vertices.par_iter().map(of_vertex).collect();
        let mut clear = vec![0.0; points.len()];
        for (spot, place) in self.vertices.iter().zip(&vertices) {
            clear[spot.index] = if let Place::Outside { clear, .. } = place { *clear } else { 0.0 };
        }
        let of_face = |spot: &Spot| match self.is_clear(&points, &clear, spot.index) {
            true => Place::OUTSIDE,
            false => place(body, &self.centre(&points, spot.index), &spot.anchor),
        };
        let faces: Vec<Place> = self.faces.par_iter().map(of_face).collect();
        let (of_vertices, of_faces) = (Tally::new(&vertices), Tally::new(&faces));
        let (edge_stretch, edge_stretch_max) = self.stretch(&points);
        PoseFigures {
            pose: pose.name.clone(),
            inside: of_vertices.inside as f64 / of_vertices.counted,
            depth_max_m: of_vertices.deepest,
            depth_mean_m: of_vertices.depth / of_vertices.counted,
            overlapped: of_vertices.overlapped as f64 / vertices.len().max(1) as f64,
            faces_inside: of_faces.inside as f64 / of_faces.counted,
            faces_depth_max_m: of_faces.deepest,
            edge_stretch,
            edge_stretch_max,
        }
    }

    /// Stretch of the edges at 1, 50 and 99 percent of all length, and its maximum.
    pub fn stretch(&self, points: &[Vec3]) -> ([f64; 3], f64) {
        let stretch = |([a, b], rest): &([u32; 2], f64)| {
            ((points[*a as usize] - points[*b as usize]).norm() / rest, *rest)
        };
        let mut values: Vec<(f64, f64)> = self.edges.iter().map(stretch).collect();
        let most = values.iter().map(|v| v.0).fold(0.0, f64::max);
        (percentiles(&mut values, [0.01, 0.5, 0.99]), most)
    }
}

/// Sums over places.
struct Tally {
    inside: usize,
    overlapped: usize,
    counted: f64,
    depth: f64,
    deepest: f64,
}

impl Tally {
    fn new(places: &[Place]) -> Tally {
        let mut tally = Tally { inside: 0, overlapped: 0, counted: 0.0, depth: 0.0, deepest: 0.0 };
        for place in places {
            match place {
                Place::Outside { .. } => {}
                Place::Overlap => tally.overlapped += 1,
                Place::Inside(on) => {
                    tally.inside += 1;
                    tally.depth += on.distance;
                    tally.deepest = tally.deepest.max(on.distance);
                }
            }
        }
        tally.counted = (places.len() - tally.overlapped).max(1) as f64;
        tally
    }
}

fn centre(mesh: &TriMesh, points: &[Vec3], face: usize) -> Vec3 {
    mesh.triangles[face].iter().map(|&v| points[v as usize]).sum::<Vec3>() / 3.0
}

/// Where a point at `p` is in a pose of the body; `anchor` is its own skin.
pub fn place(body: &Surface, p: &Vec3, anchor: &Anchor) -> Place {
    let corners = body.mesh().corners(anchor.triangle as usize);
    let skin = triangle::at(&corners, &anchor.barycentric);
    // The vertex's own skin bounds the search.
    let reach = (skin - p).norm() * (1.0 + 1e-9) + TOUCH;
    let Some(on) = body.closest_within(p, reach) else { return Place::OUTSIDE };
    if on.distance <= TOUCH || body.pseudo_normal(&on).dot(&(p - on.point)) >= 0.0 {
        return Place::Outside { clear: on.distance, on: Some(on) };
    }
    let winding = body.winding_number(p);
    if winding <= INSIDE {
        return Place::Outside { clear: on.distance, on: Some(on) };
    }
    let outward = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    let above = skin + outward.try_normalize(0.0).unwrap_or_else(Vec3::zeros) * ABOVE_SKIN;
    if winding > OVERLAP || body.winding_number(&above) > INSIDE {
        return Place::Overlap;
    }
    Place::Inside(on)
}

/// Every edge of a mesh once, with its length; those without length are left out.
fn edges(mesh: &TriMesh) -> Vec<([u32; 2], f64)> {
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let length = |[a, b]: [u32; 2]| (mesh.points[a as usize] - mesh.points[b as usize]).norm();
    edges.into_iter().map(|e| (e, length(e))).filter(|e| e.1 > 0.0).collect()
}
