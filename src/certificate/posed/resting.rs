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
    /// Vertices outside of the body, each with its closest body point.
    outside: Vec<(usize, Anchor)>,
    /// Edges with their lengths [m].
    edges: Vec<([u32; 2], f64)>,
}

/// A point of the body's surface.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    /// Triangle of the outer skin.
    pub triangle: u32,
    /// Where in the triangle.
    pub barycentric: [f64; 3],
}

/// A vertex that is inside the posed body, and counts.
#[derive(Clone, Copy, Debug)]
pub struct Sunk {
    /// The vertex.
    pub vertex: usize,
    /// Its closest body point in the bind pose.
    pub anchor: Anchor,
    /// How deep it is [m].
    pub depth: f64,
    /// The closest point of the posed skin [m].
    pub skin: Vec3,
}

/// Where a vertex is in a pose.
#[derive(Clone, Copy)]
enum Place {
    Outside,
    /// Inside; the closest point of the skin.
    Inside(Closest),
    /// Where the body overlaps itself.
    Overlap,
}

impl<'a> Resting<'a> {
    /// A mesh, sewn vertices merged, on the body in the bind pose.
    pub fn new(mesh: &'a TriMesh, body: &Surface) -> Resting<'a> {
        let outside = mesh.points.par_iter().enumerate().filter_map(|(v, p)| {
            let on = body.closest(p);
            let anchor = Anchor { triangle: on.triangle, barycentric: on.barycentric };
            (body.winding_number(p) <= INSIDE).then_some((v, anchor))
        });
        Resting { mesh, outside: outside.collect(), edges: edges(mesh) }
    }

    /// Vertices that are inside the posed body, of those outside in the bind pose and not where the
    /// body overlaps itself; `points` are the mesh's in that pose.
    pub fn sunk(&self, body: &Surface, points: &[Vec3]) -> Vec<Sunk> {
        let sunk = self.outside.par_iter().filter_map(|&(vertex, anchor)| {
            match place(body, &points[vertex], &anchor) {
                Place::Inside(on) => Some(Sunk { vertex, anchor, depth: on.distance, skin: on.point }),
                _ => None,
            }
        });
        sunk.collect()
    }

    /// The figures of one pose.
    pub(super) fn judge(&self, body: &Surface, skin: &Skin, pose: &Pose) -> PoseFigures {
        let points = skin_points(&self.mesh.points, skin, &pose.matrices);
        let places: Vec<Place> =
            self.outside.par_iter().map(|(v, anchor)| place(body, &points[*v], anchor)).collect();
        let depths = places.iter().filter_map(|p| match p {
            Place::Inside(on) => Some(on.distance),
            _ => None,
        });
        let (inside, sum, deepest) =
            depths.fold((0usize, 0.0, 0.0), |(n, sum, max), d| (n + 1, sum + d, f64::max(max, d)));
        let overlapped = places.iter().filter(|p| matches!(p, Place::Overlap)).count();
        let counted = (places.len() - overlapped).max(1) as f64;
        let (edge_stretch, edge_stretch_max) = self.stretch(&points);
        PoseFigures {
            pose: pose.name.clone(),
            inside: inside as f64 / counted,
            depth_max_m: deepest,
            depth_mean_m: sum / counted,
            overlapped: overlapped as f64 / places.len().max(1) as f64,
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

fn place(body: &Surface, p: &Vec3, anchor: &Anchor) -> Place {
    let corners = body.mesh().corners(anchor.triangle as usize);
    let skin = triangle::at(&corners, &anchor.barycentric);
    // The vertex's own skin bounds the search.
    let reach = (skin - p).norm() * (1.0 + 1e-9) + TOUCH;
    let Some(on) = body.closest_within(p, reach) else { return Place::Outside };
    if on.distance <= TOUCH || body.pseudo_normal(&on).dot(&(p - on.point)) >= 0.0 {
        return Place::Outside;
    }
    let winding = body.winding_number(p);
    if winding <= INSIDE {
        return Place::Outside;
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
