//! What keeps an outfit from being fitted.

use thiserror::Error;

use crate::geometry::skinning::SkinningError;
use crate::{drape, measure, pattern, proxy, rig, transfer};

/// Why an outfit could not be fitted.
#[derive(Debug, Error)]
pub enum Error {
    /// Source and target bodies do not correspond vertex by vertex.
    #[error(
        "{target_path}: {what} of the body differ from those of the source body {source_path}: \
         {found} instead of {expected}{}", element.map(|e| format!(" (first at {e})")).unwrap_or_default()
    )]
    Topology {
        /// The source body's path.
        source_path: String,
        /// The target body's path.
        target_path: String,
        /// `vertices`, `triangles` or `triangle corners`.
        what: &'static str,
        /// As the target has it.
        found: usize,
        /// As the source has it.
        expected: usize,
        /// First element that differs.
        element: Option<usize>,
    },
    /// A garment names a source body that the outfit does not have.
    #[error("{garment}: source body {body} is not among the outfit's {count}")]
    NoBody {
        /// The garment's path.
        garment: String,
        /// The index named.
        body: usize,
        /// Source bodies there are.
        count: usize,
    },
    /// A frame of a motion has another number of points than the body.
    #[error("frame {frame} of the body's motion has {found} points, the body {expected}")]
    Motion {
        /// The frame.
        frame: usize,
        /// As the frame has it.
        found: usize,
        /// As the body has it.
        expected: usize,
    },
    /// The skeleton cannot be posed.
    #[error("the skeleton cannot be posed: {0}")]
    Skeleton(#[from] SkinningError),
    /// A setting names a pose that is not there.
    #[error("posed.poses: there is no pose '{0}'")]
    UnknownPose(String),
    /// A garment has no proxy.
    #[error(transparent)]
    Proxy(#[from] proxy::Error),
    /// The transfer failed.
    #[error("transfer: {0}")]
    Transfer(#[from] transfer::Error),
    /// The pattern refit failed.
    #[error("{garment}: pattern: {error}")]
    Pattern {
        /// The garment's path.
        garment: String,
        /// Why.
        error: pattern::Error,
    },
    /// A girth cannot be held as the settings say.
    #[error(transparent)]
    Hold(#[from] measure::HoldError),
    /// The draper failed.
    #[error("{garment}: drape: {error}")]
    Drape {
        /// The garment's path.
        garment: String,
        /// Why.
        error: drape::Error,
    },
    /// The rig failed.
    #[error("{garment}: rig: {error}")]
    Rig {
        /// The garment's path.
        garment: String,
        /// Why.
        error: rig::Error,
    },
}
