//! Following: garments on a body that moves.
//!
//! Every time step has two parts. First the solids go to where they are at its end, and the
//! cloth near them with them ([`carry`]), as far as continuous collision detection allows
//! ([`super::contact::carried`]); then the implicit step is taken against solids that stand
//! still, from the cloth's own velocities. Slip, and so friction, counts from the carried place:
//! it is slip against the skin. A garment of a lower layer has made its step before, and is a
//! solid that moves for those above it.
//!
//! A step is halved where a move touches or a minimisation does not converge. Where no halving
//! helps (skin closes on cloth, as in an armpit) the solids move all the same, and what is
//! tangled then is pushed out as a fit's start is; [`Info`] counts these steps.

pub mod carry;
#[cfg(test)]
mod tests;

use super::contact::fixed::Fixed;
use super::params::check;
use super::setup::simulation;
use super::simulation::Simulation;
use super::untangle::push_out;
use super::{Error, FRAME, Input, Params};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::{Garment, Vec3};
use carry::Carried;

/// Longest way of what is near cloth in a step [m]: it is carried along straight lines.
const LONGEST_MOVE: f64 = 0.02;
/// A step is halved at most this often.
const MOST_HALVINGS: u32 = 4;
/// Most parts of a frame's solids' motion in a step.
const MOST_STEPS: usize = 16;

/// What following achieved so far.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Info {
    /// Frames.
    pub frames: usize,
    /// Time steps.
    pub steps: usize,
    /// Steps whose minimisation did not reach its tolerance.
    pub unconverged_steps: usize,
    /// Steps in which the solids moved though cloth was in their way.
    pub blocked_steps: usize,
    /// Pushes made after such steps.
    pub push_steps: usize,
    /// Newton iterations.
    pub newton_iterations: usize,
    /// Edges through triangles at the end of the last frame: solids and lower layers, itself.
    pub crossings: [usize; 2],
}

/// Garments that follow solids, layer by layer.
pub struct Follower<'a> {
    params: &'a Params,
    layers: Vec<Simulation<'a>>,
    garments: Vec<&'a Garment>,
    /// The solids where they are.
    solids: Vec<Surface>,
    infos: Vec<Info>,
}

impl<'a> Follower<'a> {
    /// Garments in the order of their layers. All have the same solids, where they are at the
    /// start, and as layers the garments before them, seams welded.
    ///
    /// # Errors
    /// As [`super::run`].
    ///
    /// # Panics
    /// If a garment does not have the garments before it as layers.
    pub fn new(
        device: &'a Device,
        inputs: &'a [Input<'a>],
        params: &'a Params,
    ) -> Result<Follower<'a>, Error> {
        let mut follower = Follower {
            params,
            layers: Vec::new(),
            garments: inputs.iter().map(|i| i.garment).collect(),
            solids: inputs.first().map_or(Vec::new(), |i| i.colliders.iter().map(|s| (*s).clone()).collect()),
            infos: vec![Info::default(); inputs.len()],
        };
        for (g, input) in inputs.iter().enumerate() {
            assert_eq!(input.layers.len(), g, "layers are the garments before");
            check(input, params)?;
            follower.layers.push(simulation(device, input, params)?);
        }
        Ok(follower)
    }

    /// Advances by a frame of `seconds`, in which the points of every solid go to `to` along
    /// straight lines, shape `[solids][points]`.
    ///
    /// # Errors
    /// A device's failure.
    pub fn advance(&mut self, to: &[Vec<Vec3>], seconds: f64) -> Result<(), Error> {
        let start: Vec<Vec<Vec3>> = self.solids.iter().map(|s| s.mesh().points.clone()).collect();
        let solids: Vec<&Surface> = self.solids.iter().collect();
        let longest = self.layers.iter().map(|l| carry::longest(&solids, to, &l.x)).fold(0.0, f64::max);
        let least = (self.params.steps_per_frame as f64 * seconds / FRAME).ceil().max(1.0) as usize;
        let steps = ((longest / LONGEST_MOVE).ceil() as usize).clamp(least, least.max(MOST_STEPS));
        for i in 1..=steps {
            let t = i as f64 / steps as f64;
            let solids: Vec<Vec<Vec3>> = start.iter().zip(to).map(|(a, b)| between(a, b, t)).collect();
            self.step(solids, seconds / steps as f64)?;
        }
        self.solids.iter_mut().zip(to).for_each(|(solid, to)| *solid = solid.moved(to.clone()));
        for (layer, info) in self.layers.iter_mut().zip(&mut self.infos) {
            layer.reclassify();
            let tangles = layer.contact.tangles();
            info.crossings = [tangles.crossings, tangles.own.len()];
            info.frames += 1;
        }
        Ok(())
    }

    /// Vertices of every garment [m].
    pub fn points(&self) -> Vec<Vec<Vec3>> {
        self.layers.iter().map(|l| l.offsets.vertices(&l.x)).collect()
    }

    /// The account of every garment.
    pub fn infos(&self) -> &[Info] {
        &self.infos
    }

    /// A step of `h` seconds in which the solids go to `to`.
    fn step(&mut self, mut to: Vec<Vec<Vec3>>, h: f64) -> Result<(), Error> {
        // Every collider of the layer at hand, at the step's end: solids, then lower garments.
        for g in 0..self.layers.len() {
            let mover = Mover { damping: self.params.follow_damping, pushes: self.params.push_steps };
            mover.advance(&mut self.layers[g], &to, h, MOST_HALVINGS, &mut self.infos[g])?;
            let layer = &self.layers[g];
            to.push(self.garments[g].welded_mesh(&layer.offsets.vertices(&layer.x)).points);
        }
        Ok(())
    }
}

fn between(a: &[Vec3], b: &[Vec3], t: f64) -> Vec<Vec3> {
    a.iter().zip(b).map(|(a, b)| a + (b - a) * t).collect()
}

/// How one garment's steps are made.
struct Mover {
    damping: f64,
    pushes: usize,
}

impl Mover {
    /// A step of `h` seconds in which the garment's colliders go to `to`.
    fn advance(
        &self,
        simulation: &mut Simulation<'_>,
        to: &[Vec<Vec3>],
        h: f64,
        halvings: u32,
        info: &mut Info,
    ) -> Result<(), Error> {
        let (x, v) = (simulation.x.clone(), simulation.v.clone());
        let Carry { clean, guess, before } = carry_to(simulation, to, h);
        if clean || halvings == 0 {
            if !clean {
                info.blocked_steps += 1;
                let mut pushed = super::Info::default();
                push_out(simulation, h, self.pushes, &mut pushed)?;
                info.push_steps += pushed.push_steps;
                simulation.v.clone_from(&v);
            }
            let step = simulation.step_from(&x, &guess, h, self.damping)?;
            info.newton_iterations += step.newton;
            if step.converged || halvings == 0 {
                info.steps += 1;
                info.unconverged_steps += usize::from(!step.converged);
                return Ok(());
            }
        }
        // Back to the step's start, and two of half the length.
        (simulation.x, simulation.v) = (x, v);
        let here: Vec<Vec<Vec3>> = before.iter().map(|c| c.mesh().points.clone()).collect();
        restore(simulation, before);
        for t in [0.5, 1.0] {
            let part: Vec<Vec<Vec3>> = here.iter().zip(to).map(|(a, b)| between(a, b, t)).collect();
            self.advance(simulation, &part, 0.5 * h, halvings - 1, info)?;
        }
        Ok(())
    }
}

fn colliders<'s>(simulation: &'s Simulation<'_>) -> Vec<&'s Surface> {
    simulation.contact.scene.colliders.iter().map(|c| &*c.surface).collect()
}

/// What moving the colliders left.
struct Carry<'a> {
    /// Whether nothing touched.
    clean: bool,
    /// Where inertia would take the cloth that the colliders do not carry, from where it is [m].
    guess: Vec<Vec3>,
    /// The colliders where they were.
    before: Vec<Fixed<'a>>,
}

/// Moves the colliders to `to`, in `h` seconds, and the cloth near them along.
fn carry_to<'a>(simulation: &mut Simulation<'a>, to: &[Vec<Vec3>], h: f64) -> Carry<'a> {
    let moved: Vec<Fixed<'_>> =
        simulation.contact.scene.colliders.iter().zip(to).map(|(c, p)| c.moved(p.clone())).collect();
    let after: Vec<&Surface> = moved.iter().map(|c| &*c.surface).collect();
    let before = colliders(simulation);
    let moves: Vec<Vec<Vec3>> = before
        .iter()
        .zip(to)
        .map(|(a, b)| b.iter().zip(&a.mesh().points).map(|(b, a)| b - a).collect())
        .collect();
    let mut carried = carry::carried(&before, &after, &simulation.x);
    let pinned = Carried { by: Vec3::zeros(), share: 1.0 };
    carried.iter_mut().zip(&simulation.pinned).filter(|(_, p)| **p).for_each(|(c, _)| *c = pinned);
    simulation.offsets.turn(&simulation.x.clone());
    let points = simulation.points();
    let by_point: Vec<Vec3> =
        simulation.contact.scene.sheet.node.iter().map(|&n| carried[n as usize].by).collect();
    let share = simulation.contact.carried_share(&points, &by_point, &moves);
    let clean = share >= 1.0;
    simulation.hold.follow(&after);
    simulation.x.iter_mut().zip(&carried).for_each(|(x, c)| *x += c.by * share);
    let guess = simulation.v.iter().zip(&carried).map(|(v, c)| v * (h * (1.0 - c.share))).collect();
    let points = simulation.points();
    let before = simulation.contact.replace_colliders(moved, &points, clean);
    Carry { clean, guess, before }
}

/// Puts the colliders back to where they were `before`, and where the cloth is clean as it was.
fn restore<'a>(simulation: &mut Simulation<'a>, before: Vec<Fixed<'a>>) {
    simulation.hold.follow(&before.iter().map(|c| &*c.surface).collect::<Vec<_>>());
    let x = simulation.points();
    simulation.contact.replace_colliders(before, &x, false);
}
