//! Settings of the refit.

use serde::{Deserialize, Serialize};

use super::Error;

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
    /// Weight of the straightness of originally straight runs, which may turn as a whole
    /// (dimensionless).
    pub straight_weight: f64,
    /// Most that an originally straight run may deviate from its chord, over the chord's length.
    pub straight_bound: f64,
    /// Most that a corner of the outline may change its angle [degrees].
    pub corner_bound: f64,
    /// Whether panels that mirror one another stay mirror images, where the target makes their
    /// edges less than 5% different.
    pub mirror: bool,
    /// Pull of every vertex towards its original place (dimensionless): settles where each
    /// panel lies, nothing else.
    pub anchor_weight: f64,
    /// Change of relative length difference between sewn chains that is good enough.
    pub seam_tolerance: f64,
    /// Most steps that may be spent on lengths and bounds.
    pub seam_iterations: usize,
    /// Which inner vertices are smoothed by the Dirichlet energy afterwards.
    pub tidy: Tidy,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            fit: Fit::Keep,
            outline_weight: 0.03,
            straight_weight: 1.0,
            straight_bound: 0.0098,
            corner_bound: 2.99,
            mirror: true,
            anchor_weight: 1e-8,
            seam_tolerance: 1e-4,
            seam_iterations: 30,
            tidy: Tidy::Crumpled,
        }
    }
}

impl Params {
    pub(super) fn check(&self) -> Result<(), Error> {
        let rule = |holds: bool, name, value, rule| match holds {
            true => Ok(()),
            false => Err(Error::Setting { name, value, rule }),
        };
        let positive =
            |name, value: f64| rule(value.is_finite() && value > 0.0, name, value, "it must be positive");
        let not_negative = |name, value: f64| {
            rule(value.is_finite() && value >= 0.0, name, value, "it must not be negative")
        };
        positive("anchor_weight", self.anchor_weight)?;
        positive("straight_bound", self.straight_bound)?;
        positive("corner_bound", self.corner_bound)?;
        positive("seam_tolerance", self.seam_tolerance)?;
        not_negative("outline_weight", self.outline_weight)?;
        not_negative("straight_weight", self.straight_weight)
    }
}
