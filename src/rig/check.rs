//! What the rig refuses.

use thiserror::Error;

use super::Sewn;
use crate::geometry::OuterSkin;
use crate::model::Character;
use crate::solve::cholesky::CholeskyError;

/// Why a garment could not be rigged.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// The points do not belong to the garment.
    #[error("{found} points given, the garment has {expected} vertices")]
    Length { found: usize, expected: usize },
    /// A triangle of the cloth names a vertex that is not there.
    #[error("triangle {element}: vertex {index}, but there are only {count}")]
    Index { element: usize, index: u32, count: usize },
    /// There is no cloth.
    #[error("the garment has no triangles")]
    NoCloth,
    /// A position is not a finite number.
    #[error("point {element} of the {what} is not finite")]
    NotFinite { what: &'static str, element: usize },
    /// The body has no triangles.
    #[error("{body}: the body has no triangles")]
    NoBody { body: String },
    /// The body has no weights, or not as many as it needs.
    #[error("{body}: {found} skin weights for {points} points with {influences} influences each")]
    NoSkin { body: String, found: usize, points: usize, influences: usize },
    /// A weight names a joint that is not there.
    #[error("{body}: point {element} hangs on joint {joint}, but the skeleton has only {count}")]
    Joint { body: String, element: usize, joint: u32, count: usize },
    /// Weights that are negative or not finite, or all zero.
    #[error("{body}: the weights of point {element} are not finite and positive")]
    Weights { body: String, element: usize },
    /// A setting is out of its range.
    #[error("the setting '{name}' must be {allowed}, not {value}")]
    Setting { name: &'static str, allowed: &'static str, value: f64 },
    /// The extension's linear system could not be solved.
    #[error("weights over the cloth: {0}")]
    Solve(#[from] CholeskyError),
}

/// A sewn mesh whose arrays fit together.
pub(super) fn cloth(sewn: &Sewn<'_>) -> Result<(), Error> {
    let (count, expected) = (sewn.points.len(), sewn.groups.node_of_vertex.len());
    if count != expected {
        return Err(Error::Length { found: count, expected });
    }
    if sewn.triangles.is_empty() {
        return Err(Error::NoCloth);
    }
    if let Some(element) = sewn.points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { what: "garment", element });
    }
    for (element, tri) in sewn.triangles.iter().enumerate() {
        if let Some(&index) = tri.iter().find(|&&v| v as usize >= count) {
            return Err(Error::Index { element, index, count });
        }
    }
    Ok(())
}

/// A body with an outer skin and weights for all its points.
pub(super) fn body(character: &Character, skin_of: &OuterSkin) -> Result<(), Error> {
    let (skin, points) = (&character.skin, character.body.points.len());
    let path = || character.path.clone();
    let (influences, found, expected) = (skin.influences, skin.joint_weights.len(), points * skin.influences);
    if expected == 0 || found != expected || skin.joint_indices.len() != expected {
        return Err(Error::NoSkin { body: path(), found, points, influences });
    }
    if skin_of.surface.mesh().triangles.is_empty() {
        return Err(Error::NoBody { body: path() });
    }
    if let Some(element) = character.body.points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { what: "body", element });
    }
    let count = character.skeleton.joints.len();
    if let Some(i) = skin.joint_indices.iter().position(|&j| j as usize >= count) {
        let joint = skin.joint_indices[i];
        return Err(Error::Joint { body: path(), element: i / influences, joint, count });
    }
    let good = |weights: &[f64]| {
        weights.iter().all(|w| w.is_finite() && *w >= 0.0) && weights.iter().sum::<f64>() > 0.0
    };
    match skin.joint_weights.chunks(influences).position(|weights| !good(weights)) {
        Some(element) => Err(Error::Weights { body: path(), element }),
        None => Ok(()),
    }
}
