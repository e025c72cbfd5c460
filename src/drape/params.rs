//! Settings of the drape, and what they and the input must keep to.

use serde::{Deserialize, Serialize};

use super::{Error, Input, cloth, hold};

/// Settings of the drape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Frames of the untangling phase (1/24 s each).
    pub frames: usize,
    /// Time steps in a frame.
    pub steps_per_frame: usize,
    /// Share of the velocity that each untangling step takes away.
    pub damping: f64,
    /// Whether a settling phase follows.
    pub settle: bool,
    /// Most steps of the settling phase.
    pub settle_steps: usize,
    /// How many times stiffer in bending than its own the cloth starts to settle where the transfer
    /// has changed it; folds it squeezed or spread are pressed out so. 1 leaves them.
    pub press: f64,
    /// Share of the velocity that each step behind a moving body takes away.
    pub follow_damping: f64,
    /// At rest when the largest net force on a node is below this many mean node weights.
    pub rest_tolerance: f64,
    /// A step has converged when the largest unbalanced force on a node is below this many
    /// mean node weights.
    pub tolerance: f64,
    /// Most Newton iterations in a step.
    pub max_newton: usize,
    /// Relative residual of the linear solves.
    pub cg_tolerance: f64,
    /// Most conjugate-gradient iterations in a solve.
    pub max_cg: usize,
    /// Distance at which bodies and other solids resist [m] (paper: eps_sdf, 0.2 cm).
    pub body_distance: f64,
    /// Distance at which finished lower garments resist [m].
    pub layer_distance: f64,
    /// Distance at which parts of the garment resist each other [m].
    pub self_distance: f64,
    /// Contact stiffness for each unit of cloth area [N/m^3] (paper: 2,500,000).
    pub contact_stiffness: f64,
    /// Sliding speed up to which friction only sticks [m/s].
    pub friction_speed: f64,
    /// Gravity along -Y [m/s^2].
    pub gravity: f64,
    /// Most pushes that untangle a start (and, if anything crosses after the phases, an end).
    pub push_steps: usize,
    /// Rest shape of the cloth.
    pub cloth: cloth::Options,
    /// Bands that are held.
    pub hold: hold::Params,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            frames: 6,
            steps_per_frame: 4,
            damping: 0.9,
            settle: true,
            settle_steps: 60,
            press: 64.0,
            follow_damping: 0.05,
            rest_tolerance: 0.1,
            tolerance: 5e-2,
            max_newton: 120,
            cg_tolerance: 0.1,
            max_cg: 2000,
            body_distance: 2e-3,
            layer_distance: 2e-3,
            self_distance: 2e-3,
            contact_stiffness: 2.5e6,
            friction_speed: 1e-3,
            gravity: 9.81,
            push_steps: 24,
            cloth: cloth::Options::default(),
            hold: hold::Params::default(),
        }
    }
}

/// Refuses input that does not fit together and settings out of range.
pub(super) fn check(input: &Input<'_>, params: &Params) -> Result<(), Error> {
    let garment = || input.garment.name.clone();
    let expected = input.garment.points.len();
    for (what, found) in [("starting points", input.points.len()), ("the pattern", input.pattern.len())] {
        if found != expected {
            return Err(Error::Length { garment: garment(), what, found, expected });
        }
    }
    if let Some(&vertex) = input.pinned.iter().find(|&&v| v as usize >= expected) {
        return Err(Error::Pinned { garment: garment(), vertex, vertices: expected });
    }
    if let Some(vertex) = input.points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { garment: garment(), vertex });
    }
    let positive = [
        ("steps_per_frame", params.steps_per_frame as f64),
        ("tolerance", params.tolerance),
        ("cg_tolerance", params.cg_tolerance),
        ("body_distance", params.body_distance),
        ("layer_distance", params.layer_distance),
        ("self_distance", params.self_distance),
        ("contact_stiffness", params.contact_stiffness),
        ("friction_speed", params.friction_speed),
    ];
    for (name, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Setting { name, value, rule: "finite and above 0" });
        }
    }
    if !(params.press.is_finite() && params.press >= 1.0) {
        return Err(Error::Setting { name: "press", value: params.press, rule: "finite and at least 1" });
    }
    for (name, value) in [("damping", params.damping), ("follow_damping", params.follow_damping)] {
        if !(0.0..=1.0).contains(&value) {
            return Err(Error::Setting { name, value, rule: "between 0 and 1" });
        }
    }
    for (name, value) in params.hold.numbers().into_iter().chain([("gravity", params.gravity)]) {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::Setting { name, value, rule: "finite and not negative" });
        }
    }
    Ok(())
}
