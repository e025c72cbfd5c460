//! Girths of a body and of what it wears: where a tailor lays the tape.
//!
//! A girth is measured in a plane that comes from the skeleton and from the body's shape
//! ([`landmarks`]); the skeleton's joints are found by name, or else by hierarchy and position
//! ([`joints`]). On the body the tape spans hollows: its length is that of the convex hull of
//! the section, as a tape measure lies. On a garment it follows the cloth: its length is that of
//! the section's contour, taken in the flat pattern ([`section`]), so that the stretch of what
//! is worn does not count. Their difference is the *ease* ([`ease`]); what is tighter than the
//! body has a negative one.
//!
//! Heights are along +Y.

pub mod ease;
pub mod hold;
pub mod joints;
pub mod landmarks;
pub mod section;

#[cfg(test)]
mod tests;

pub use ease::{Ease, EaseEntry, Measured};
pub use hold::{Hold, HoldError, Params};
pub use landmarks::{Landmark, Landmarks};

use serde::{Deserialize, Serialize};

/// The girths of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Girth {
    /// Fullest girth of the chest below the armpits, arms left out.
    Bust,
    /// Narrowest girth between hips and chest.
    Waist,
    /// Fullest girth about hip joints and seat.
    Hip,
    /// A leg a quarter of its height below the crotch, where trousers have parted too.
    Thigh,
    /// An arm a quarter of the way from shoulder to wrist.
    UpperArm,
    /// Narrowest girth of the neck.
    Neck,
}

/// Which limb.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The character's left.
    Left,
    /// Its right.
    Right,
}

impl Girth {
    /// All girths.
    pub const ALL: [Girth; 6] =
        [Girth::Bust, Girth::Waist, Girth::Hip, Girth::Thigh, Girth::UpperArm, Girth::Neck];

    /// As the report and the settings name it.
    pub fn name(self) -> &'static str {
        match self {
            Girth::Bust => "bust",
            Girth::Waist => "waist",
            Girth::Hip => "hip",
            Girth::Thigh => "thigh",
            Girth::UpperArm => "upper_arm",
            Girth::Neck => "neck",
        }
    }
}
