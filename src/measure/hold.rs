//! Which girths keep which ease.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Girth, Measured};

/// Settings of the ease by measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Names of the garments whose ease is held; empty: all.
    pub garments: Vec<String>,
    /// Girths whose ease is held, each where a garment covers it.
    pub hold: Hold,
}

/// The ease to hold, girth by girth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hold {
    /// Fullest girth of the chest below the armpits.
    pub bust: HeldGirth,
    /// Narrowest girth between hips and chest.
    pub waist: HeldGirth,
    /// Fullest girth about hip joints and seat.
    pub hip: HeldGirth,
    /// Each leg below the crotch.
    pub thigh: HeldGirth,
    /// Each upper arm.
    pub upper_arm: HeldGirth,
    /// The neck.
    pub neck: HeldGirth,
}

/// One held girth: one of three ways to say its ease, or none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HeldGirth {
    /// The ease itself [m]; negative is tighter than the body.
    pub absolute: Option<f64>,
    /// The ease over the target body's girth.
    pub relative: Option<f64>,
    /// The ease that the garment has on its source body.
    pub source: SourceEase,
}

/// How the source's ease is carried over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceEase {
    /// It is not held.
    #[default]
    Free,
    /// In metres.
    Absolute,
    /// Over the body's girth.
    Relative,
}

/// A setting that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("ease.hold.{girth}: {rule}")]
pub struct HoldError {
    /// The girth.
    pub girth: &'static str,
    /// What is wrong.
    pub rule: &'static str,
}

impl Hold {
    /// What is said about a girth.
    pub fn of(&self, girth: Girth) -> &HeldGirth {
        match girth {
            Girth::Bust => &self.bust,
            Girth::Waist => &self.waist,
            Girth::Hip => &self.hip,
            Girth::Thigh => &self.thigh,
            Girth::UpperArm => &self.upper_arm,
            Girth::Neck => &self.neck,
        }
    }

    /// Whether nothing is held.
    pub fn is_empty(&self) -> bool {
        Girth::ALL.iter().all(|&girth| *self.of(girth) == HeldGirth::default())
    }
}

impl HeldGirth {
    /// The ease wanted on the target [m], if any: the target's body girth and what was measured
    /// on the source are given.
    pub fn wanted(&self, body_m: f64, source: &Measured) -> Option<f64> {
        let of_source = match self.source {
            SourceEase::Free => None,
            SourceEase::Absolute => Some(source.ease_m),
            SourceEase::Relative => Some(source.ease_m / source.body_m * body_m),
        };
        self.absolute.or(self.relative.map(|part| part * body_m)).or(of_source)
    }
}

impl Params {
    /// Whether a garment of that name takes part.
    pub fn holds(&self, garment: &str) -> bool {
        !self.hold.is_empty()
            && (self.garments.is_empty() || self.garments.iter().any(|name| name == garment))
    }

    /// Refuses what says nothing or too much.
    ///
    /// # Errors
    /// [`HoldError`] names the girth.
    pub fn check(&self) -> Result<(), HoldError> {
        for girth in Girth::ALL {
            let held = self.hold.of(girth);
            let wrong = |rule| Err(HoldError { girth: girth.name(), rule });
            let ways = [held.absolute.is_some(), held.relative.is_some(), held.source != SourceEase::Free];
            if ways.iter().filter(|way| **way).count() > 1 {
                return wrong("only one of absolute, relative and source can hold it");
            }
            if held.absolute.into_iter().chain(held.relative).any(|value| !value.is_finite()) {
                return wrong("its ease must be a finite number");
            }
            if held.relative.is_some_and(|part| part <= -1.0) {
                return wrong("a relative ease must be more than -1: cloth has a length");
            }
        }
        Ok(())
    }
}
