//! Refits the sewing pattern to the garment on its new body (paper section 4.2).
//!
//! # Theory
//! Every triangle has a tangent frame that carries warp and weft from pattern to space. On
//! the target body the frame keeps its rotation and takes over the stretch that the source
//! had ([`Fit::Keep`]) or none ([`Fit::Loose`]); bound to the triangle ([`frame`]), it says
//! which 2D shape the triangle wants. The layout is the least-squares answer to all
//! triangles ([`energy`]), to the shape of the outline ([`outline`]) and to equal lengths of
//! what is sewn together ([`seam`]). Then inner vertices are tidied up and no triangle stays
//! turned over ([`tidy`], [`untangle`]).
//!
//! # What differs from the paper
//! - No ADMM: with the outline's scale factors as unknowns the energy is quadratic, so one
//!   sparse Cholesky finds its minimum. A test runs the paper's ADMM (with the sign of its
//!   dual update corrected) to the same answer.
//! - Weights are dimensionless over a reference length, the pattern's area over the length of
//!   its border: the result does not depend on the unit or on the mesh.
//! - Sewn chains ([`crate::model::Chain`]) keep equal lengths (or the ease that the original
//!   had) by constraints; the outline's weight then only has to look after shape, and strain
//!   need not pay for lengths.
//! - The tidy-up is kept to crumpled places: everywhere, it costs more strain than all the
//!   rest of the refit (see [`tidy`]).
//! - Triangles that flip are counted and repaired.

pub mod energy;
pub mod frame;
pub mod outline;
pub mod seam;
pub mod tidy;
pub mod untangle;

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::model::{Garment, Vec2, Vec3};
use crate::solve::cholesky::{CholeskyError, SparseCholesky};
use energy::Weights;
use outline::Outline;

/// How the garment is to fit the new body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// As tight or loose as on the source: the source's stretch is kept.
    #[default]
    Keep,
    /// Without stretch on the carried shape.
    Loose,
}

/// Which inner vertices the Dirichlet energy tidies up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tidy {
    /// Those near triangles that the transfer crumpled or the layout turned over.
    #[default]
    Crumpled,
    /// All of them, as in the paper: smoother, but far more strain.
    All,
    /// None.
    Never,
}

/// Settings of the pattern refit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Fit of the garment.
    pub fit: Fit,
    /// Weight of the outline's shape against the cloth's strain (dimensionless).
    pub outline_weight: f64,
    /// Pull of every vertex towards its original place (dimensionless): settles where each
    /// panel lies, nothing else.
    pub anchor_weight: f64,
    /// Change of relative length difference between sewn chains that is good enough.
    pub seam_tolerance: f64,
    /// Most solves that may be spent on it.
    pub seam_iterations: usize,
    /// Which inner vertices are smoothed by the Dirichlet energy afterwards.
    pub tidy: Tidy,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            fit: Fit::Keep,
            outline_weight: 0.1,
            anchor_weight: 1e-8,
            seam_tolerance: 1e-4,
            seam_iterations: 20,
            tidy: Tidy::Crumpled,
        }
    }
}

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
    /// Solves with updated chain directions.
    pub iterations: usize,
    /// Norm of the energy's gradient, without the constraints' part, over that of its right side:
    /// how well the linear solve did before constraints.
    pub residual: f64,
    /// Whether the chains' lengths reached `seam_tolerance`.
    pub converged: bool,
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
    #[error("the lengths of {chains} sewn chains contradict one another")]
    Constraint { chains: usize },
}

/// Refits `garment`'s pattern to its vertices at `target_points` [m], shape `[vertices, 3]`.
///
/// Returns panel coordinates [m], shape `[vertices, 2]`.
///
/// # Errors
/// See [`Error`].
pub fn run(garment: &Garment, target_points: &[Vec3], params: &Params) -> Result<(Vec<Vec2>, Info), Error> {
    check(garment, target_points, params)?;
    let bindings = frame::bind(garment, target_points, params.fit)?;
    let outline = Outline::new(garment);
    let weights = Weights { outline: params.outline_weight, anchor: params.anchor_weight };
    let form = energy::assemble(garment, &bindings, &outline, weights);
    let factor = SparseCholesky::new(form.right.len(), &form.matrix)?;
    let mut free = form.right.clone();
    factor.solve(&mut free);
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let residual = norm(&form.gradient(&free)) / norm(&form.right);

    let chains = garment.chains();
    let constrained =
        seam::Constrained { factor: &factor, free: &free, chains: &chains, original: &garment.pattern };
    let (mut unknowns, outcome) = constrained.solve(params.seam_iterations, params.seam_tolerance)?;

    let n = garment.points.len();
    let border = tidy::border(garment);
    let crumpled: Vec<u32> = (0..bindings.len()).filter(|&t| bindings[t].clamped).map(|t| t as u32).collect();
    let layout = energy::positions(&unknowns, n);
    let mut pattern = tidy::tidy(garment, &border, &crumpled, layout, params.tidy)?;
    let repaired = tidy::repair(garment, &border, &mut pattern)?;

    for (v, p) in pattern.iter().enumerate() {
        (unknowns[v], unknowns[n + v]) = (p.x, p.y);
    }
    let area: f64 = bindings.iter().map(|b| b.area).sum();
    let change = frame::strain_change(garment, &pattern, target_points, &[0.5, 0.99])?;
    let info = Info {
        iterations: outcome.iterations,
        residual,
        converged: outcome.mismatch <= params.seam_tolerance,
        energy: form.value(&unknowns) / area,
        energy_free: form.value(&free) / area,
        strain_change_p50: change[0],
        strain_change_p99: change[1],
        seam_mismatch_max: crate::model::chain::chains_mismatch(&chains, &garment.pattern, &pattern),
        chains: chains.len(),
        flipped_triangles: tidy::flipped(garment, &pattern).len(),
        crumpled_triangles: crumpled.len(),
        area_ratio: pattern_area(garment, &pattern) / pattern_area(garment, &garment.pattern),
        repaired,
    };
    Ok((pattern, info))
}

fn check(garment: &Garment, target: &[Vec3], params: &Params) -> Result<(), Error> {
    let name = || garment.path.clone();
    if target.len() != garment.points.len() {
        return Err(Error::Length { garment: name(), found: target.len(), expected: garment.points.len() });
    }
    if let Some(element) = target.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { garment: name(), element });
    }
    for (t, tri) in garment.triangles.iter().enumerate() {
        let [a, b, c] = tri.map(|v| target[v as usize]);
        if (b - a).cross(&(c - a)).norm() == 0.0 {
            return Err(Error::Degenerate { garment: name(), element: t, space: "3D on the target" });
        }
    }
    let positive = |value: f64| value.is_finite() && value > 0.0;
    if !positive(params.anchor_weight) {
        let rule = "it must be positive";
        return Err(Error::Setting { name: "anchor_weight", value: params.anchor_weight, rule });
    }
    if !params.outline_weight.is_finite() || params.outline_weight < 0.0 {
        let rule = "it must not be negative";
        return Err(Error::Setting { name: "outline_weight", value: params.outline_weight, rule });
    }
    Ok(())
}

/// Area of all triangles in `pattern` [m^2].
pub fn pattern_area(garment: &Garment, pattern: &[Vec2]) -> f64 {
    (0..garment.triangles.len())
        .map(|t| {
            let [a, b, c] = garment.pattern_corners(pattern, t);
            0.5 * (b - a).perp(&(c - a)).abs()
        })
        .sum()
}
