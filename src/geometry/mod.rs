//! Questions about surfaces that several stages ask: closest point, inside or outside,
//! which triangles cross.
//!
//! - [`Surface`]: a triangle mesh with a bounding volume hierarchy ([`bvh`]), which closest points,
//!   rays, winding numbers, box queries and the device's twins go through.
//! - [`topology`]: which triangles meet at an edge and around a point.
//! - [`winding`]: hierarchical winding numbers [Barill 2018], which tell inside from outside
//!   also for surfaces with holes [Jacobson 2013].
//! - [`patch`]: closest points and crossings for many points close together.
//! - [`bulk`]: winding numbers and closest points of many queries at once, on a device.
//! - [`intersect`]: exact triangle-triangle tests.
//! - [`sdf`]: the narrow-band signed distance of paper section 5.1.
//! - [`skin`]: the part of a body that something outside can touch.
//! - [`split`]: a mesh with its long edges split.
//! - [`skinning`]: where a pose takes what hangs on a skeleton.
//!
//! Everything but [`bulk`] is `f64`, and all is deterministic: results do not depend on the
//! number of threads.

pub mod bulk;
pub mod bvh;
pub mod intersect;
pub mod patch;
pub mod sdf;
pub mod skin;
pub mod skinning;
pub mod split;
pub mod surface;
pub mod topology;
pub mod triangle;
pub mod winding;

pub use bvh::Node;
pub use patch::Patch;
pub use skin::{OuterSkin, buried, outer_skin, submesh};
pub use split::Split;
pub use surface::{Closest, Hit, Surface};
pub use winding::Moments;
