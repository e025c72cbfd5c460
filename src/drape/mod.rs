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
//! *Settle* (off by default): until the net force on every node is small, or to a limit.
//! *Repair*: if anything still crosses, further pushes, each round with a frame after it.

pub mod cloth;
pub mod contact;
pub mod elastic;
pub mod follow;
pub mod hold;
mod offsets;
mod simulation;
mod system;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use thiserror::Error as ThisError;

use crate::device::{Device, DeviceError};
use crate::geometry::Surface;
use crate::model::{Garment, Vec2, Vec3};
use contact::fixed::Fixed;
use contact::pairs::{Radii, Scene};
use contact::sheet::Sheet;
use offsets::Offsets;
use simulation::{Parts, Simulation, StepInfo};

/// Seconds in a frame.
pub const FRAME: f64 = 1.0 / 24.0;
/// Most rounds of pushes and a frame after the phases.
const REPAIR_ROUNDS: usize = 3;
/// A step is halved at most this often before it is taken as it is.
const MOST_HALVINGS: u32 = 2;

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
    /// Most frames of the settling phase.
    pub settle_frames: usize,
    /// Share of the velocity that each settling step takes away.
    pub settle_damping: f64,
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
            settle: false,
            settle_frames: 96,
            settle_damping: 0.05,
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

/// What the drape achieved; keys of the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Frames simulated.
    pub frames: usize,
    /// Time steps.
    pub steps: usize,
    /// Steps whose minimisation did not reach its tolerance.
    pub unconverged_steps: usize,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Conjugate-gradient iterations.
    pub cg_iterations: usize,
    /// Largest net force on a node over the mean node weight, at the end.
    pub residual: f64,
    /// Largest residual of a step's minimisation, in mean node weights.
    pub step_residual: f64,
    /// Kinetic energy at the end [J].
    pub kinetic_energy_j: f64,
    /// Whether every step reached its tolerance.
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
    run_with_progress(device, input, params, &mut |_, _| {})
}

/// As [`run`]; `progress` is called after every step with the share done and what is being
/// done.
///
/// # Errors
/// As [`run`].
pub fn run_with_progress(
    device: &Device,
    input: &Input<'_>,
    params: &Params,
    progress: &mut dyn FnMut(f64, &str),
) -> Result<Output, Error> {
    check(input, params)?;
    let mut simulation = simulation(device, input, params)?;
    let mut info = Info { converged: true, ..Info::default() };
    let tangles = simulation.contact.tangles();
    info.inside_before = tangles.inside_count();
    info.crossings_before = [tangles.crossings, tangles.own.len()];
    let h = FRAME / params.steps_per_frame as f64;
    push_out(&mut simulation, h, params.push_steps, &mut info)?;
    let steps = params.frames * params.steps_per_frame;
    for i in 0..steps {
        advance(&mut simulation, h, params.damping, &mut info, MOST_HALVINGS)?;
        progress((i + 1) as f64 / (steps + 1) as f64, "untangle");
    }
    info.frames = params.frames;
    for i in 0..if params.settle { params.settle_frames } else { 0 } {
        if simulation.net_force() <= params.rest_tolerance {
            break;
        }
        for _ in 0..params.steps_per_frame {
            advance(&mut simulation, h, params.settle_damping, &mut info, MOST_HALVINGS)?;
        }
        info.frames += 1;
        progress((i + 1) as f64 / (params.settle_frames + 1) as f64, "settle");
    }
    for _ in 0..REPAIR_ROUNDS {
        if push_out(&mut simulation, h, params.push_steps, &mut info)? {
            break;
        }
        // Pushes leave the cloth out of balance: a frame in between.
        for _ in 0..params.steps_per_frame {
            advance(&mut simulation, h, params.damping, &mut info, MOST_HALVINGS)?;
        }
        info.frames += 1;
    }
    let tangles = simulation.contact.tangles();
    info.crossings = [tangles.crossings, tangles.own.len()];
    info.kinetic_energy_j = simulation.kinetic_energy();
    info.residual = simulation.net_force();
    info.at_rest = info.residual <= params.rest_tolerance;
    info.contacts = simulation.contact.contacts(&simulation.points()).stencils.len();
    progress(1.0, "done");
    Ok(Output {
        points: simulation.offsets.vertices(&simulation.x),
        rest_offsets: simulation.offsets.vectors().to_vec(),
        held: simulation.hold.report(&simulation.x),
        info,
    })
}

/// Pushes what is tangled to its right side, at rest after every push; returns whether there
/// was nothing to push from the start.
///
/// A push is a step's minimisation with the springs of tangled pairs in it, which is cut short:
/// its springs come and go as pairs change sides, so it has no minimum worth finding. Time
/// steps start where nothing is tangled, and converge.
fn push_out(simulation: &mut Simulation<'_>, h: f64, most: usize, info: &mut Info) -> Result<bool, Error> {
    simulation.reclassify();
    for done in 0..most {
        if simulation.contact.tangles().is_clean() {
            return Ok(done == 0);
        }
        let step = simulation.push(h)?;
        count(info, &step);
        info.push_steps += 1;
        simulation.reclassify();
    }
    Ok(most == 0)
}

/// One step; where it does not converge, two of half the length instead.
fn advance(
    simulation: &mut Simulation<'_>,
    h: f64,
    damping: f64,
    info: &mut Info,
    halvings: u32,
) -> Result<(), Error> {
    let (x, v) = (simulation.x.clone(), simulation.v.clone());
    let step = simulation.step(h, damping)?;
    count(info, &step);
    if !step.converged && halvings > 0 {
        (simulation.x, simulation.v) = (x, v);
        // Two halves that together take as much velocity away.
        let half = 1.0 - (1.0 - damping).sqrt();
        for _ in 0..2 {
            advance(simulation, 0.5 * h, half, info, halvings - 1)?;
        }
        return Ok(());
    }
    info.steps += 1;
    info.unconverged_steps += usize::from(!step.converged);
    info.converged &= step.converged;
    info.step_residual = info.step_residual.max(step.residual);
    Ok(())
}

fn count(info: &mut Info, step: &StepInfo) {
    info.newton_iterations += step.newton;
    info.cg_iterations += step.cg;
}

fn simulation<'a>(
    device: &'a Device,
    input: &'a Input<'a>,
    params: &'a Params,
) -> Result<Simulation<'a>, Error> {
    let garment = input.garment;
    let cloth = cloth::Cloth::new(garment, input.pattern, &params.cloth)?;
    let nodes = cloth.node_count;
    let mut masses = cloth.masses.clone();
    let mut is_pinned = vec![false; nodes];
    let friction = node_friction(&cloth);
    let area = cloth.areas.iter().sum::<f64>() / nodes.max(1) as f64;
    for &v in input.pinned {
        let p = garment.groups.node_of_vertex[v as usize] as usize;
        is_pinned[p] = true;
        masses[p] = PINNED_MASS;
    }
    let solids = input.colliders.iter().map(|s| Fixed::new(s, true));
    let colliders: Vec<Fixed<'a>> = solids.chain(input.layers.iter().map(|s| Fixed::new(s, false))).collect();
    let radius = |c: &Fixed<'_>| if c.solid { params.body_distance } else { params.layer_distance };
    let radii = Radii { collider: colliders.iter().map(radius).collect(), own: params.self_distance };
    let parts = Parts {
        scene: Scene { sheet: Sheet::new(garment), colliders },
        radii,
        elastic: elastic::Elastic::new(device, &cloth)?,
        offsets: Offsets::new(garment, input.points, input.pattern),
        hold: hold::ties::Hold::new(
            garment,
            input.points,
            input.pattern,
            input.held,
            input.colliders,
            params.body_distance,
            &params.hold,
        ),
        masses,
        friction,
        pinned: is_pinned,
        x: garment.groups.node_points(input.points),
        stiffness: params.contact_stiffness * area,
    };
    Simulation::new(device, params, parts)
}

/// Mass that holds a pinned node against any force [kg].
const PINNED_MASS: f64 = 1e4;

/// Friction coefficient of each node: its triangles' fabrics, weighted by area.
fn node_friction(cloth: &cloth::Cloth) -> Vec<f64> {
    let (mut sum, mut area) = (vec![0.0; cloth.node_count], vec![0.0; cloth.node_count]);
    for t in 0..cloth.triangles.len() {
        for n in cloth.nodes(t) {
            sum[n as usize] += cloth.areas[t] * cloth.fabric(t).friction;
            area[n as usize] += cloth.areas[t];
        }
    }
    sum.iter().zip(&area).map(|(s, a)| if *a > 0.0 { s / a } else { 0.0 }).collect()
}

fn check(input: &Input<'_>, params: &Params) -> Result<(), Error> {
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
    for (name, value) in [("damping", params.damping), ("settle_damping", params.settle_damping)] {
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
