//! What the refit says about itself, and why it may refuse.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::shape::Shape;
use crate::solve::cholesky::CholeskyError;

/// What had to be done against flipped triangles, from least to most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Repair {
    /// Nothing.
    #[default]
    None,
    /// Positive weights in the tidy-up.
    ClampedWeights,
    /// Foldover-free relaxation inside the outline.
    Inside,
    /// Foldover-free relaxation of a piece of the outline; lengths there are no longer exact.
    Outline,
    /// A blend with the original pattern, scaled.
    Blend,
}

/// What the refit did and achieved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Steps of the iteration over lengths and bounds.
    pub iterations: usize,
    /// Norm of the energy's gradient, without the constraints' part, over that of its right side:
    /// how well the linear solve did before constraints.
    pub residual: f64,
    /// Whether lengths and bounds of shape were reached within their tolerances.
    pub converged: bool,
    /// Largest relative error of a demanded length when the iteration ended: chains, mirrored
    /// runs, girths.
    pub length_residual: f64,
    /// Largest excess over a bound of shape when it ended (relative deviation, or radians).
    pub shape_residual: f64,
    /// Largest move of a coordinate in its last step [m].
    pub step_residual_m: f64,
    /// Bounds of shape that hold the result.
    pub bounds_held: usize,
    /// Energy of the result over the pattern's area (half the mean square strain to the
    /// wanted frames, plus the outline's part).
    pub energy: f64,
    /// The same at the unconstrained minimum, before the tidy-up.
    pub energy_free: f64,
    /// Median by area of the change of stretch against the source.
    pub strain_change_p50: f64,
    /// 99th percentile of it.
    pub strain_change_p99: f64,
    /// Largest change of relative length difference between sewn chains.
    pub seam_mismatch_max: f64,
    /// Number of sewn chains.
    pub chains: usize,
    /// Triangles that are turned over in the result.
    pub flipped_triangles: usize,
    /// Target triangles so crumpled that their frames were not followed to the letter.
    pub crumpled_triangles: usize,
    /// What became of outline and grain.
    #[serde(flatten)]
    pub shape: Shape,
    /// Area of the refitted pattern over the original's.
    pub area_ratio: f64,
    /// What was done against flipped triangles.
    pub repaired: Repair,
}

/// Why a pattern cannot be refitted.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "each message names its fields")]
pub enum Error {
    /// A vertex array does not fit the garment.
    #[error("{garment}: {found} target points, {expected} expected")]
    Length { garment: String, found: usize, expected: usize },
    /// A target position is not finite.
    #[error("{garment}: target point {element} is not a finite number")]
    NotFinite { garment: String, element: usize },
    /// A triangle has no tangent frame.
    #[error("{garment}: triangle {element} has no area in {space}")]
    Degenerate { garment: String, element: usize, space: &'static str },
    /// A setting makes no sense.
    #[error("pattern.{name} is {value}, but {rule}")]
    Setting { name: &'static str, value: f64, rule: &'static str },
    /// The energy's matrix could not be factored.
    #[error(transparent)]
    Solve(#[from] CholeskyError),
    /// The lengths of sewn chains could not be made equal.
    #[error("{chains} lengths and bounds contradict one another")]
    Constraint { chains: usize },
}
