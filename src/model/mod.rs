//! Plain data: what a character, a garment and an outfit are.
//!
//! Nothing here computes a stage of the pipeline. Garments are held *unwelded*: vertices of
//! panels that are sewn together are distinct, and seams tie them (see [`seam`]).

pub mod chain;
pub mod character;
pub mod fabric;
pub mod garment;
pub mod mesh;
pub mod seam;
pub mod tape;

pub use chain::{Chain, seam_mismatch};
pub use character::{BlendShape, Character, Collider, Skeleton, Skin};
pub use fabric::Fabric;
pub use garment::{AuthoredSeam, Garment, GarmentSource, Panel, Role, SourceError};
pub use mesh::TriMesh;
pub use seam::SeamGroups;
pub use tape::{ClothPoint, Tape};

use serde::{Deserialize, Serialize};

/// A point or vector in space [m].
pub type Vec3 = nalgebra::Vector3<f64>;
/// A point or vector in a panel [m]: x along the warp, y along the weft.
pub type Vec2 = nalgebra::Vector2<f64>;

/// One or more garments with the source bodies they were authored on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outfit {
    /// Garments in the order in which the stage lists them; `layer` sorts them for draping.
    pub garments: Vec<Garment>,
    /// Source bodies; [`Garment::body`] indexes them.
    pub bodies: Vec<Character>,
}
