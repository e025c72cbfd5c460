//! Drape: paper section 5, Progressive Draper.
//!
//! A garment is laid onto its body and onto the finished lower layers, which stand still.
//! Cloth is a membrane with bending over seam-welded *nodes* ([`cloth`], [`elastic`]); a
//! vertex that is sewn with an offset rides on its node ([`offsets`]). Time steps are
//! implicit ([`simulation`]), contact is [`contact`].
//!
//! # What we changed against the paper
//! - The paper pushes cloth along the gradient of a union SDF (winding number threshold 0.25,
//!   expanded by 0.2 cm). A grid cannot resolve gaps of 2 mm and its level set bulges over
//!   necks and hems like a cap; here distances come from triangles, the winding number only
//!   says which points start inside, and open borders have no sides.
//! - Impulses are replaced by potentials inside of the implicit step: a barrier for pairs on
//!   their right sides, with continuous collision detection, so that what is clean stays
//!   clean; springs through the surface for pairs that start tangled.
//! - Seam offsets turn with the cloth.
//! - Every step is solved to a tolerance in `f64`, and says whether it got there.
//!
//! # Phases
//! *Push out*: what starts on a wrong side is pushed through, at rest; no time passes.
//! *Untangle*: 6 frames of 1/24 s with 90% velocity damping per step, as in the paper.
//! *Settle*: quasi-static steps of growing length until the net force on every node is small,
//! or to a limit; those before the longest only approach.
//! *Repair*: if anything still crosses, further pushes, each round with a frame after it. What is
//! tangled does not settle.

pub mod cloth;
pub mod contact;
#[doc(hidden)] // for benches/minimisers.rs
pub mod curvature;
pub mod elastic;
mod factored;
pub mod follow;
mod history;
pub mod hold;
mod minimise;
mod objective;
mod offsets;
pub mod params;
mod phases;
mod press;
mod setup;
mod simulation;
mod system;
#[cfg(test)]
mod tests;
mod untangle;

use serde::{Deserialize, Serialize};
use thiserror::Error as ThisError;

use crate::device::{Device, DeviceError};
use crate::geometry::Surface;
use crate::model::{Garment, Vec2, Vec3};
pub use params::Params;

/// Seconds in a frame.
pub const FRAME: f64 = 1.0 / 24.0;
/// What is draped on what.
pub struct Input<'a> {
    /// The garment.
    pub garment: &'a Garment,
    /// Its vertices where they start [m], shape `[vertices, 3]`.
    pub points: &'a [Vec3],
    /// Its rest shape: vertices in their panels [m], shape `[vertices, 2]`.
    pub pattern: &'a [Vec2],
    /// Solids: the body's outer skin, shoes.
    pub colliders: &'a [&'a Surface],
    /// Finished lower garments, triangles facing outward.
    pub layers: &'a [&'a Surface],
    /// Vertices that stay where they start.
    pub pinned: &'a [u32],
    /// Bands that are held, see [`hold::find`].
    pub held: &'a [hold::Band],
}

impl<'a> Input<'a> {
    /// A garment alone, from where it is, with its own pattern.
    pub fn alone(garment: &'a Garment) -> Input<'a> {
        Input {
            garment,
            points: &garment.points,
            pattern: &garment.pattern,
            colliders: &[],
            layers: &[],
            pinned: &[],
            held: &[],
        }
    }
}

/// What the drape achieved; keys of the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Frames simulated.
    pub frames: usize,
    /// Time steps that were to be solved to the tolerance, those of the settling phase included.
    pub steps: usize,
    /// Steps of the settling phase.
    pub settle_steps: usize,
    /// How many times stiffer in bending than its own the cloth was as it started to settle.
    pub pressed: f64,
    /// Those of them that only approached rest and were not solved to the tolerance.
    pub approach_steps: usize,
    /// Steps whose minimisation did not reach its tolerance; like the two below of those since the
    /// last push, which made what was before it void.
    pub unconverged_steps: usize,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Conjugate-gradient iterations.
    pub cg_iterations: usize,
    /// Largest net force on a node over the mean node weight, at the end.
    pub residual: f64,
    /// Largest residual of a step's minimisation since the last push, in mean node weights.
    pub step_residual: f64,
    /// Kinetic energy at the end [J].
    pub kinetic_energy_j: f64,
    /// Whether every step since the last push reached its tolerance.
    pub converged: bool,
    /// Whether the residual is below the rest tolerance.
    pub at_rest: bool,
    /// Contacts at the end.
    pub contacts: usize,
    /// Vertices on a wrong side where the drape started.
    pub inside_before: usize,
    /// Edges through triangles where the drape started (colliders, then itself).
    pub crossings_before: [usize; 2],
    /// The same at the end.
    pub crossings: [usize; 2],
    /// Iterations that drew a deep start out of a solid.
    pub draws: usize,
    /// Times that the cloth was lifted over the folds of lower layers.
    pub lifts: usize,
    /// Times that cloth was carried out of slots too narrow for it.
    pub carries: usize,
    /// Pushes made, see [`Params::push_steps`].
    pub push_steps: usize,
}

/// The draped garment.
#[derive(Clone, Debug)]
pub struct Output {
    /// Vertices [m], shape `[vertices, 3]`.
    pub points: Vec<Vec3>,
    /// Rest offset of each vertex from its node, as re-measured after the transfer and turned
    /// with the cloth [m], shape `[vertices, 3]`.
    pub rest_offsets: Vec<Vec3>,
    /// What was achieved.
    pub info: Info,
    /// What held the bands, and how hard.
    pub held: Vec<hold::Held>,
}

/// Why a garment could not be draped.
#[derive(Debug, ThisError)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// The arrays do not fit the garment.
    #[error("{garment}: {what} has {found} elements, {expected} expected")]
    Length { garment: String, what: &'static str, found: usize, expected: usize },
    /// A coordinate is not finite.
    #[error("{garment}: vertex {vertex} does not start at a finite place")]
    NotFinite { garment: String, vertex: usize },
    /// A pinned vertex that is not there.
    #[error("{garment}: vertex {vertex} is to be pinned, but there are {vertices}")]
    Pinned { garment: String, vertex: u32, vertices: usize },
    /// A setting is out of its range.
    #[error("drape setting {name} is {value}; it must be {rule}")]
    Setting { name: &'static str, value: f64, rule: &'static str },
    /// The cloth's data.
    #[error(transparent)]
    Cloth(#[from] cloth::Error),
    /// The cloth's forces.
    #[error(transparent)]
    Elastic(#[from] elastic::Error),
    /// The device.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Drapes a garment.
///
/// # Errors
/// Input that does not fit together, a setting out of range, or a device's failure. A step
/// that does not converge is no error: [`Info`] says it.
pub fn run(device: &Device, input: &Input<'_>, params: &Params) -> Result<Output, Error> {
    run_with_progress(device, input, params, &mut |_| {})
}

/// A look at a drape while it runs.
pub struct Moment<'a> {
    /// How much is done, 0 to 1.
    pub share: f64,
    /// What is being done: `untangle`, `settle`, `done`.
    pub phase: &'static str,
    simulation: &'a simulation::Simulation<'a>,
}

impl Moment<'_> {
    /// Where the vertices are [m], shape `[vertices, 3]`.
    pub fn points(&self) -> Vec<Vec3> {
        self.simulation.offsets.vertices(&self.simulation.x)
    }
}

/// As [`run`]; `progress` is called after every step.
///
/// # Errors
/// As [`run`].
pub fn run_with_progress(
    device: &Device,
    input: &Input<'_>,
    params: &Params,
    progress: &mut dyn FnMut(&Moment<'_>),
) -> Result<Output, Error> {
    params::check(input, params)?;
    let mut simulation = setup::simulation(device, input, params)?;
    let info = phases::run(&mut simulation, params, progress)?;
    Ok(Output {
        points: simulation.offsets.vertices(&simulation.x),
        rest_offsets: simulation.offsets.vectors().to_vec(),
        held: simulation.hold.report(&simulation.x),
        info,
    })
}
