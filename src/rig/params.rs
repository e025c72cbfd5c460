//! Settings of the rig.

use serde::{Deserialize, Serialize};

use super::Error;

/// Settings of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Most influences for a vertex. Without it 4, or 8 where 4 would move a vertex of the garment
    /// by more than `influence_error`.
    pub influences: Option<usize>,
    /// Displacement by leaving out influences that is worth 8 of them: when every joint in turn is
    /// turned by 45 degrees about any axis, the root of the summed mean squares [m].
    pub influence_error: f64,
    /// Farthest body point that a cloth point can be matched to [m].
    pub distance: f64,
    /// Largest angle between the normals of cloth and body at a match [degrees].
    pub cone: f64,
    /// Rounds of averaging the cloth's normals with their neighbours'.
    pub smoothing: usize,
    /// Length along the cloth over which weights are evened out, where it lies `gap` from the
    /// skin; with the power 3/2 of the distance elsewhere [m].
    pub reach: f64,
    /// Distance from the skin that `reach` is meant for [m].
    pub gap: f64,
    /// Largest change of the weights along an edge, as the sum of absolute differences (2 at most):
    /// where more is left, the ends are averaged with their neighbours.
    pub jump: f64,
    /// Rounds of refining weights against the poses of the posed check; 0 leaves it out.
    pub refine: usize,
    /// Joints whose weight goes to their nearest kept ancestor. A pattern must match whole words of
    /// a joint's name, whatever the case; `*` and `?` stand for letters; `NAME/*` means all joints
    /// below. A garment of which they hold more than a quarter is made for them and keeps them.
    pub ignore: Vec<String>,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            influences: None,
            influence_error: 1e-3,
            distance: 0.08,
            cone: 45.0,
            smoothing: 2,
            reach: 0.05,
            gap: 0.016,
            jump: 0.6,
            refine: 5,
            ignore: IGNORED.map(str::to_owned).to_vec(),
        }
    }
}

/// Fingers, toes and the face, whatever the rig calls them.
const IGNORED: [&str; 9] =
    ["hand/*", "wrist/*", "foot/*", "ankle/*", "head/*", "finger", "thumb", "toe", "eye"];

impl Params {
    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub(super) fn check(&self) -> Result<(), Error> {
        let setting = |name, allowed, value| Err(Error::Setting { name, allowed, value });
        if self.influences == Some(0) {
            return setting("influences", "at least 1", 0.0);
        }
        if !(self.cone > 0.0 && self.cone <= 180.0) {
            return setting("cone", "between 0 and 180", self.cone);
        }
        if !(self.gap > 0.0 && self.gap.is_finite()) {
            return setting("gap", "positive", self.gap);
        }
        let lengths = [
            ("distance", self.distance),
            ("reach", self.reach),
            ("jump", self.jump),
            ("influence_error", self.influence_error),
        ];
        match lengths.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            Some((name, value)) => setting(name, "finite and not negative", value),
            None => Ok(()),
        }
    }
}
