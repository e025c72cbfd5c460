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

mod resting;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::skinning::skin_points;
use crate::geometry::{OuterSkin, Surface};
use crate::model::{Character, Skin, TriMesh, Vec3};
use crate::pose::{Pose, PoseSet};
pub use resting::{Anchor, Place, Resting, Spot, place};

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
    /// Fraction of the faces outside in the bind pose whose centre is inside the body, counted likewise:
    /// skin that comes through between vertices.
    pub faces_inside: f64,
    /// Depth of the deepest of these centres [m].
    pub faces_depth_max_m: f64,
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
    let resting: Vec<Resting<'_>> = cloths.par_iter().map(|c| Resting::new(c.mesh, &body.surface)).collect();
    let mut figures = vec![Vec::new(); cloths.len()];
    for pose in poses {
        let skin = posed_body(character, body, pose);
        for ((resting, cloth), own) in resting.iter().zip(cloths).zip(&mut figures) {
            own.push(resting.judge(&skin, cloth.skin, pose));
        }
    }
    figures
}

/// The body's outer skin in a pose.
pub fn posed_body(character: &Character, body: &OuterSkin, pose: &Pose) -> Surface {
    body.surface.moved(posed_points(character, body, pose))
}

/// The points of the body's outer skin in a pose [m].
pub fn posed_points(character: &Character, body: &OuterSkin, pose: &Pose) -> Vec<Vec3> {
    let moved = skin_points(&character.body.points, &character.skin, &pose.matrices);
    body.point_of.iter().map(|&i| moved[i as usize]).collect()
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
    let wanted = |pose: &&Pose| params.poses.is_empty() || params.poses.contains(&pose.name);
    Ok(set.poses.iter().filter(wanted).cloned().collect())
}

#[cfg(test)]
mod tests;
