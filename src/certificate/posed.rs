//! How a garment follows its body: both skinned together through a set of poses.
//!
//! Weights are judged by what they do. In each pose of [`crate::pose`] body and garment move by
//! linear blend skinning, nothing is simulated, and we ask
//! - which vertices that lie **outside of the body in the bind pose** are inside now, and how deep.
//!   The side comes from the closest point's pseudo-normal [Baerentzen 2005], and what seems inside
//!   must also be inside by winding number;
//! - how much the garment's edges were **stretched**, against the bind pose.
//!
//! Where the posed body overlaps itself (armpits, groins, the hollow of a knee) no weights could
//! keep cloth outside. There a vertex is not counted as inside if it is in more than one part of the
//! body at once, if its own skin, the closest body point in the bind pose, lies inside the body, or if
//! the part of the body that it is nearest to has it outside.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::strain::percentiles;
use crate::geometry::skinning::skin_points;
use crate::geometry::{OuterSkin, Surface, triangle};
use crate::model::{Character, Skin, TriMesh, Vec3};
use crate::pose::{Pose, PoseSet};

/// A point with a larger winding number is inside the body.
const INSIDE: f64 = 0.5;
/// A point with a larger winding number is in two parts of the body at once.
const OVERLAP: f64 = 1.5;
/// How far above the skin it is asked whether the skin lies inside the body [m].
const ABOVE_SKIN: f64 = 5e-4;
/// Nearer to the surface than this no side is told [m].
const TOUCH: f64 = 1e-6;

/// Settings of the posed check.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Whether garments are posed with their body and judged.
    pub enabled: bool,
    /// Names of the poses; empty: all that the skeleton allows.
    pub poses: Vec<String>,
}

impl Default for Params {
    fn default() -> Self {
        Params { enabled: true, poses: Vec::new() }
    }
}

/// A garment in its bind pose.
#[derive(Clone, Copy, Debug)]
pub struct Cloth<'a> {
    /// Its mesh, sewn vertices merged.
    pub mesh: &'a TriMesh,
    /// Weights of the mesh's points.
    pub skin: &'a Skin,
}

/// The figures of a garment in one pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseFigures {
    /// Name of the pose.
    pub pose: String,
    /// Fraction of the vertices counted that are inside the body. Counted are those outside in the bind
    /// pose, apart from `overlapped`.
    pub inside: f64,
    /// Depth of the deepest of them [m].
    pub depth_max_m: f64,
    /// Depth averaged over all vertices counted, zero for those outside [m].
    pub depth_mean_m: f64,
    /// Fraction of the vertices outside in the bind pose that are inside where the posed body overlaps
    /// itself, by one of the first two tests of the module's head.
    pub overlapped: f64,
    /// Length of edges over their length in the bind pose, at 1, 50 and 99 percent of all length.
    pub edge_stretch: [f64; 3],
    /// Largest stretch of an edge.
    pub edge_stretch_max: f64,
}

/// Measures garments in every pose; for each garment, the figures in the order of the poses.
///
/// `body` is the outer skin of the character's body.
///
/// # Panics
/// If a skin does not have influences for every point of its mesh, or names a joint without a matrix.
pub fn measure(
    character: &Character,
    body: &OuterSkin,
    cloths: &[Cloth<'_>],
    poses: &[Pose],
) -> Vec<Vec<PoseFigures>> {
    let resting: Vec<Resting<'_>> = cloths.par_iter().map(|c| Resting::new(*c, &body.surface)).collect();
    let mut figures = vec![Vec::new(); cloths.len()];
    for pose in poses {
        let moved = skin_points(&character.body.points, &character.skin, &pose.matrices);
        let skin = body.surface.moved(body.point_of.iter().map(|&i| moved[i as usize]).collect());
        for (garment, own) in resting.iter().zip(&mut figures) {
            own.push(garment.judge(&skin, pose));
        }
    }
    figures
}

/// The chosen poses of a set.
///
/// # Errors
/// A name that is no pose's.
pub fn chosen(set: &PoseSet, params: &Params) -> Result<Vec<Pose>, String> {
    let known = |name: &String| crate::pose::stances().iter().any(|s| s.name == name);
    if let Some(unknown) = params.poses.iter().find(|name| !known(name)) {
        return Err(unknown.clone());
    }
    let wanted = |pose: &&Pose| params.poses.is_empty() || params.poses.iter().any(|n| n == pose.name);
    Ok(set.poses.iter().filter(wanted).cloned().collect())
}

/// A garment with what is known of it in the bind pose.
struct Resting<'a> {
    cloth: Cloth<'a>,
    /// Vertices outside of the body, each with its closest body point.
    outside: Vec<(usize, Anchor)>,
    /// Edges with their lengths [m].
    edges: Vec<([u32; 2], f64)>,
}

/// A point of the body's surface.
struct Anchor {
    triangle: u32,
    barycentric: [f64; 3],
}

/// Where a vertex is in a pose.
#[derive(Clone, Copy)]
enum Place {
    Outside,
    /// Inside, this deep [m].
    Inside(f64),
    /// Where the body overlaps itself.
    Overlap,
}

impl<'a> Resting<'a> {
    fn new(cloth: Cloth<'a>, body: &Surface) -> Resting<'a> {
        let outside = cloth.mesh.points.par_iter().enumerate().filter_map(|(v, p)| {
            let on = body.closest(p);
            let anchor = Anchor { triangle: on.triangle, barycentric: on.barycentric };
            (body.winding_number(p) <= INSIDE).then_some((v, anchor))
        });
        Resting { cloth, outside: outside.collect(), edges: edges(cloth.mesh) }
    }

    fn judge(&self, body: &Surface, pose: &Pose) -> PoseFigures {
        let points = skin_points(&self.cloth.mesh.points, self.cloth.skin, &pose.matrices);
        let places: Vec<Place> =
            self.outside.par_iter().map(|(v, anchor)| place(body, &points[*v], anchor)).collect();
        let depths = places.iter().filter_map(|p| match p {
            Place::Inside(depth) => Some(*depth),
            _ => None,
        });
        let (inside, sum, deepest) =
            depths.fold((0usize, 0.0, 0.0), |(n, sum, max), d| (n + 1, sum + d, f64::max(max, d)));
        let overlapped = places.iter().filter(|p| matches!(p, Place::Overlap)).count();
        let counted = (places.len() - overlapped).max(1) as f64;
        let (edge_stretch, edge_stretch_max) = self.stretch(&points);
        PoseFigures {
            pose: pose.name.to_owned(),
            inside: inside as f64 / counted,
            depth_max_m: deepest,
            depth_mean_m: sum / counted,
            overlapped: overlapped as f64 / places.len().max(1) as f64,
            edge_stretch,
            edge_stretch_max,
        }
    }

    /// Percentiles of the edges' stretch and its maximum.
    fn stretch(&self, points: &[Vec3]) -> ([f64; 3], f64) {
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
    Place::Inside(on.distance)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::skinning::Mat4;
    use crate::geometry::surface::tests::sphere;

    /// Balls of radius 1 at `centers`, each on a joint of its own.
    fn balls(centers: &[Vec3]) -> Character {
        let mut character =
            Character { skin: Skin { influences: 1, ..Skin::default() }, ..Character::default() };
        for (joint, center) in centers.iter().enumerate() {
            let ball = sphere(30, 40);
            let first = character.body.points.len() as u32;
            character.skin.joint_indices.extend(vec![joint as u32; ball.points.len()]);
            character.skin.joint_weights.extend(vec![1.0; ball.points.len()]);
            character.body.points.extend(ball.points.iter().map(|p| p + center));
            character.body.triangles.extend(ball.triangles.iter().map(|t| t.map(|i| i + first)));
        }
        character
    }

    /// A ball of cloth around the origin that follows one joint.
    fn shell(radius: f64, joint: u32) -> (TriMesh, Skin) {
        let mut mesh = sphere(24, 32);
        mesh.points.iter_mut().for_each(|p| *p *= radius);
        let count = mesh.points.len();
        let skin = Skin { influences: 1, joint_indices: vec![joint; count], joint_weights: vec![1.0; count] };
        (mesh, skin)
    }

    fn moved(by: Vec3) -> Mat4 {
        Mat4::new_translation(&by)
    }

    fn figures(character: &Character, cloth: &(TriMesh, Skin), matrices: Vec<Mat4>) -> PoseFigures {
        let body = OuterSkin {
            surface: Surface::new(character.body.clone()),
            point_of: (0..character.body.points.len() as u32).collect(),
        };
        let pose = Pose { name: "made", matrices };
        let cloths = [Cloth { mesh: &cloth.0, skin: &cloth.1 }];
        measure(character, &body, &cloths, &[pose]).remove(0).remove(0)
    }

    #[test]
    fn what_follows_its_body_stays_outside_and_is_not_stretched() {
        let character = balls(&[Vec3::zeros()]);
        let turn = Mat4::from_euler_angles(0.4, -1.0, 2.0) * moved(Vec3::new(3.0, 0.0, 1.0));
        let found = figures(&character, &shell(1.05, 0), vec![turn]);
        assert_eq!((found.inside, found.depth_max_m, found.overlapped), (0.0, 0.0, 0.0));
        assert!(found.edge_stretch.iter().all(|s| (s - 1.0).abs() < 1e-12));
    }

    #[test]
    fn a_body_that_moves_alone_goes_through_its_cloth() {
        // The ball goes 0.3 to +X; the cloth at radius 1.05 stays.
        let character = balls(&[Vec3::zeros()]);
        let mut cloth = shell(1.05, 1);
        let found = figures(&character, &cloth, vec![moved(Vec3::new(0.3, 0.0, 0.0)), Mat4::identity()]);
        let depth = |p: &Vec3| 1.0 - (p - Vec3::new(0.3, 0.0, 0.0)).norm();
        let inside = cloth.0.points.iter().filter(|p| depth(p) > 0.01).count() as f64;
        let share = inside / cloth.0.points.len() as f64;
        assert!((found.inside - share).abs() < 0.02, "{} {share}", found.inside);
        assert!((found.depth_max_m - 0.25).abs() < 0.01, "{}", found.depth_max_m);
        let mean =
            cloth.0.points.iter().map(|p| depth(p).max(0.0)).sum::<f64>() / cloth.0.points.len() as f64;
        assert!((found.depth_mean_m - mean).abs() < 0.005);
        // What was inside before is not counted.
        cloth.0.points.iter_mut().for_each(|p| *p *= 0.9);
        let found = figures(&character, &cloth, vec![moved(Vec3::new(0.3, 0.0, 0.0)), Mat4::identity()]);
        assert_eq!(found.inside, 0.0);
    }

    #[test]
    fn where_the_body_overlaps_itself_is_not_counted() {
        // Two balls 2.5 apart come to 1.6 apart: the caps between overlap, and so does the cloth there.
        let character = balls(&[Vec3::zeros(), Vec3::new(2.5, 0.0, 0.0)]);
        let together = vec![Mat4::identity(), moved(Vec3::new(-0.9, 0.0, 0.0))];
        let found = figures(&character, &shell(1.05, 0), together);
        assert!(found.overlapped > 0.0);
        // What is left lies in the ring between the balls, no deeper than its height above the skin,
        // though the cloth reaches 0.45 deep into the other ball.
        assert!(found.inside < 0.05 && found.depth_max_m < 0.05, "{found:?}");
    }

    #[test]
    fn stretch_is_that_of_the_edges() {
        let character = balls(&[Vec3::zeros()]);
        let points = vec![Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 0.0), Vec3::new(2.0, 0.0, 1.0)];
        let mesh = TriMesh { points, triangles: vec![[0, 1, 2]] };
        let skin = Skin { influences: 1, joint_indices: vec![0, 1, 0], joint_weights: vec![1.0; 3] };
        let found = figures(&character, &(mesh, skin), vec![Mat4::identity(), moved(Vec3::y())]);
        assert_eq!(found.edge_stretch_max, 2.0);
        assert_eq!(found.edge_stretch[0], 1.0);
    }

    #[test]
    fn poses_are_chosen_by_name() {
        let set = PoseSet::default();
        let params = |name: &str| Params { enabled: true, poses: vec![name.to_owned()] };
        assert!(chosen(&set, &params("sit")).unwrap().is_empty());
        assert_eq!(chosen(&set, &params("fly")).unwrap_err(), "fly");
    }
}
