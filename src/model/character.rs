//! A character: body, skeleton, skin weights and further colliders.

use serde::{Deserialize, Serialize};

use super::{TriMesh, Vec3};

/// Joints in the order in which skin weights index them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Skeleton {
    /// Joint paths, as USD names them (`root/spine/...`).
    pub joints: Vec<String>,
    /// Parent of each joint, -1 for a root.
    pub parents: Vec<i32>,
    /// World transform of each joint in the bind pose, row-major 4x4 with translation in the
    /// last column [m].
    pub world_from_joint: Vec<[[f64; 4]; 4]>,
}

impl Skeleton {
    /// Where each joint is in the bind pose [m].
    pub fn positions(&self) -> Vec<Vec3> {
        self.world_from_joint.iter().map(|m| Vec3::new(m[0][3], m[1][3], m[2][3])).collect()
    }

    /// The parent of a joint; `None` for a root and for a number that is no joint's.
    pub fn parent(&self, joint: usize) -> Option<usize> {
        let parent = usize::try_from(*self.parents.get(joint)?).ok()?;
        (parent < self.joints.len()).then_some(parent)
    }
}

/// Linear-blend skin weights, a fixed number of influences for each point.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Skin {
    /// Influences for each point.
    pub influences: usize,
    /// Joint indices, shape `[n * influences]`.
    pub joint_indices: Vec<u32>,
    /// Weights, shape `[n * influences]`; each point's sum to 1.
    pub joint_weights: Vec<f64>,
}

/// A further mesh that cloth must not pass: shoes, hair, props.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Collider {
    /// The mesh's path in its stage.
    pub path: String,
    /// World-space surface.
    pub mesh: TriMesh,
}

/// Offsets that a weight adds to points of a mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BlendShape {
    /// Name.
    pub name: String,
    /// Points that it moves.
    pub points: Vec<u32>,
    /// World offsets at full weight [m], shape `[points, 3]`.
    pub offsets: Vec<Vec3>,
}

/// A body mesh with its skeleton, in its bind pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Character {
    /// Name for messages.
    pub name: String,
    /// Path of the body mesh in its stage.
    pub path: String,
    /// Body surface, with whatever inner parts (eyes, teeth) its maker left in it.
    pub body: TriMesh,
    /// Skeleton.
    pub skeleton: Skeleton,
    /// Skin weights of the body's points.
    pub skin: Skin,
    /// Further colliders.
    pub colliders: Vec<Collider>,
    /// Blend shapes of the body, where they were asked for.
    #[serde(default)]
    pub blend_shapes: Vec<BlendShape>,
}
