//! One time step: implicit Euler as a minimisation, by projected Newton.
//!
//! With `y = x_n + h v_n + h^2 g` the step minimises
//! ```text
//! |x - y|_M^2 / (2 h^2) + elastic(x) + contact(x) + friction(x; lagged)
//! ```
//! The normal forces and tangent planes of friction are those at the start of the step. Every
//! iteration solves with the device's `f32` matrix (block-Jacobi conjugate gradients); the
//! gradient, the line search and the residual are `f64` on the host. Since the reference of
//! the device's displacements is rebased at every accepted iterate, rounding in the matrix
//! costs iterations and never accuracy.

use super::contact::narrow::Contacts;
use super::contact::stencil::{Kind, Stencil};
use super::contact::{Contact, pairs::Radii, pairs::Scene};
use super::elastic::Elastic;
use super::hold::ties::Hold;
use super::minimise::Until;
use super::objective::Problem;
use super::offsets::Offsets;
use super::press::Press;
use super::system::System;
use super::{Error, Params};
use crate::device::{Buffer, Device};
use crate::model::Vec3;

/// Newton iterations of a push.
const PUSH_ITERATIONS: usize = 8;
/// How many times stiffer in bending cloth is loosened: crumples the size of its triangles cross
/// themselves in an equilibrium without contact, longer folds do not.
const LOOSENED: f64 = 64.0;
/// Gain at which a relaxation ends, see [`Until::gain`]: time steps follow, so it is no result.
const RELAXED: f64 = 1e-3;
/// How many times more Newton iterations a quasi-static step may take: it moves farther.
const QUASI_STATIC: usize = 4;
/// Longest time for which [`Params::friction_speed`] gives a sticking distance [s]
const MOST_STICKING: f64 = 0.1;

/// What a step achieved.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepInfo {
    /// Newton iterations.
    pub newton: usize,
    /// Conjugate-gradient iterations.
    pub cg: usize,
    /// Largest unbalanced force on a node over the mean node weight.
    pub residual: f64,
    /// Whether the residual reached the tolerance.
    pub converged: bool,
    /// Whether it ended where little was left to gain, see [`Until::gain`].
    pub approached: bool,
}

/// A cloth in motion.
pub struct Simulation<'a> {
    pub(super) device: &'a Device,
    pub(super) params: &'a Params,
    pub(super) elastic: Elastic,
    pub(super) system: System,
    /// No displacement: every linearisation is about a rebased reference.
    pub(super) rest: Buffer<f32>,
    pub(super) contact: Contact<'a>,
    pub(super) offsets: Offsets,
    pub(super) hold: Hold,
    /// Node masses [kg].
    pub(super) masses: Vec<f64>,
    /// Friction coefficient of each node.
    pub(super) friction: Vec<f64>,
    /// Nodes that do not move.
    pub(super) pinned: Vec<bool>,
    /// How folds are pressed out as the cloth starts to settle.
    pub(super) press: Press,
    /// Acceleration of gravity [m/s^2].
    pub(super) gravity: Vec3,
    /// Node positions [m].
    pub x: Vec<Vec3>,
    /// Node velocities [m/s].
    pub v: Vec<Vec3>,
    /// Lagged friction of the last step.
    lagged: Vec<Stencil>,
    /// Displacements in the last step [m], and how long that was [s].
    moved: Vec<Vec3>,
    moved_in: f64,
    /// Forces of seam offsets on the rings that carry them, as of the last step [N].
    ring_forces: Vec<Vec3>,
}

/// All that a step changes, to come back to where it fails.
#[derive(Clone)]
pub(super) struct State {
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    lagged: Vec<Stencil>,
    moved: Vec<Vec3>,
    moved_in: f64,
    ring_forces: Vec<Vec3>,
}

/// The parts that a simulation is made of.
pub(super) struct Parts<'a> {
    pub scene: Scene<'a>,
    pub radii: Radii,
    pub elastic: Elastic,
    pub offsets: Offsets,
    pub hold: Hold,
    pub masses: Vec<f64>,
    pub friction: Vec<f64>,
    pub pinned: Vec<bool>,
    pub x: Vec<Vec3>,
    /// A contact pair's stiffness [N/m].
    pub stiffness: f64,
    pub press: Press,
}

impl<'a> Simulation<'a> {
    pub(super) fn new(device: &'a Device, params: &'a Params, mut parts: Parts<'a>) -> Result<Self, Error> {
        parts.offsets.turn(&parts.x);
        let points = parts.scene.sheet.points(&parts.offsets.vertices(&parts.x));
        let nodes = parts.x.len();
        Ok(Simulation {
            device,
            params,
            rest: device.zeros("displacement", 3 * nodes)?,
            system: System::new(device, &parts.masses, parts.elastic.diagonal_slots())?,
            elastic: parts.elastic,
            contact: Contact::new(parts.scene, parts.radii, parts.stiffness, &points),
            offsets: parts.offsets,
            hold: parts.hold,
            masses: parts.masses,
            friction: parts.friction,
            pinned: parts.pinned,
            press: parts.press,
            gravity: Vec3::new(0.0, -params.gravity, 0.0),
            x: parts.x,
            v: vec![Vec3::zeros(); nodes],
            lagged: Vec::new(),
            moved: vec![Vec3::zeros(); nodes],
            moved_in: f64::INFINITY,
            ring_forces: vec![Vec3::zeros(); nodes],
        })
    }

    /// The state before a step.
    pub(super) fn state(&self) -> State {
        State {
            x: self.x.clone(),
            v: self.v.clone(),
            lagged: self.lagged.clone(),
            moved: self.moved.clone(),
            moved_in: self.moved_in,
            ring_forces: self.ring_forces.clone(),
        }
    }

    /// Goes back to a state.
    pub(super) fn restore(&mut self, state: State) {
        let State { x, v, lagged, moved, moved_in, ring_forces } = state;
        (self.x, self.v, self.lagged) = (x, v, lagged);
        (self.moved, self.moved_in, self.ring_forces) = (moved, moved_in, ring_forces);
    }

    /// Contact points where the nodes are now.
    pub fn points(&self) -> Vec<Vec3> {
        self.contact_points(&self.x)
    }

    /// Contact points where the nodes are at `x`.
    pub(super) fn contact_points(&self, x: &[Vec3]) -> Vec<Vec3> {
        self.contact.scene.sheet.points(&self.offsets.vertices(x))
    }

    /// Mean weight of a node [N] (with standard gravity where there is none).
    pub fn node_weight(&self) -> f64 {
        let free: Vec<f64> =
            self.masses.iter().zip(&self.pinned).filter(|(_, p)| !**p).map(|(m, _)| *m).collect();
        let g = if self.params.gravity > 0.0 { self.params.gravity } else { 9.81 };
        g * free.iter().sum::<f64>() / free.len().max(1) as f64
    }

    /// Kinetic energy [J].
    pub fn kinetic_energy(&self) -> f64 {
        self.v.iter().zip(&self.masses).map(|(v, m)| 0.5 * m * v.norm_squared()).sum()
    }

    /// Largest net force on a node, gravity and friction included, over the mean node weight.
    pub fn net_force(&self) -> f64 {
        let still = Problem {
            start: self.x.iter().zip(&self.moved).map(|(x, m)| x - m).collect(),
            target: self.x.clone(),
            inertia: 0.0,
            friction: self.lagged.clone(),
        };
        let here = self.evaluate(self.x.clone(), &still);
        let net: Vec<Vec3> = (0..self.x.len()).map(|i| here.gradient[i] - self.outer_force(i)).collect();
        self.residual(&net)
    }

    /// Advances by `h` seconds; of the velocity reached, the share `damping` is taken away.
    ///
    /// Where the minimisation does not reach its tolerance the step is still made, and the
    /// result says so.
    pub(super) fn step(&mut self, h: f64, damping: f64) -> Result<StepInfo, Error> {
        let guess = self.creep(h);
        self.advance((&self.x.clone(), Some(&guess)), h, damping, self.to_tolerance())
    }

    /// As far in `h` seconds as in the last step: what creeps goes on to do so, and friction is zero
    /// where nothing has slipped yet.
    pub(super) fn creep(&self, h: f64) -> Vec<Vec3> {
        self.moved.iter().map(|m| m * (h / self.moved_in)).collect()
    }

    /// As [`Simulation::step`] for cloth that was at `before` at the step's start and that moving
    /// colliders have carried to where it is: its inertia counts from `before`, slip from here. The
    /// minimisation starts `guess` from here, as far as that is free, if the objective is lower there.
    pub(super) fn step_from(
        &mut self,
        before: &[Vec3],
        guess: &[Vec3],
        h: f64,
        damping: f64,
    ) -> Result<StepInfo, Error> {
        self.advance((before, Some(guess)), h, damping, self.to_tolerance())
    }

    /// A step of `h` seconds towards rest, in which all velocity is lost; see [`Until::gain`].
    pub(super) fn quasi_static(&mut self, h: f64, gain: f64) -> Result<StepInfo, Error> {
        let most = QUASI_STATIC * self.params.max_newton;
        self.advance((&self.x.clone(), None), h, 1.0, Until { most, gain, remembers: false, stubborn: false })
    }

    /// As [`Simulation::quasi_static`] for cloth that is `stiffer` times as stiff in bending, about the
    /// hinges' angles `about`; see [`super::press`].
    pub(super) fn pressed(
        &mut self,
        h: f64,
        gain: f64,
        stiffer: f64,
        about: &[f64],
    ) -> Result<StepInfo, Error> {
        self.elastic.press(self.device, stiffer, about)?;
        let step = self.quasi_static(h, gain);
        self.elastic.press(self.device, 1.0, about)?;
        step
    }

    /// Angles of the hinges in the cloth's shape without its shorter folds [rad].
    pub(super) fn unfolded(&self) -> Vec<f64> {
        self.elastic.angles(&self.offsets.vertices(&self.press.smoothed(&self.x)))
    }

    fn to_tolerance(&self) -> Until {
        Until { most: self.params.max_newton, gain: 0.0, remembers: true, stubborn: false }
    }

    fn advance(
        &mut self,
        (before, guess): (&[Vec3], Option<&[Vec3]>),
        h: f64,
        damping: f64,
        until: Until,
    ) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        let points = self.points();
        if !self.contact.tangles().is_clean() {
            self.contact.classify(&points);
        }
        self.contact.refresh(&points, f64::INFINITY);
        let contacts = self.contact.contacts(&points);
        let target = (0..self.x.len())
            .map(|i| {
                if self.pinned[i] {
                    self.x[i]
                } else {
                    before[i] + self.v[i] * h + self.outer_force(i) * (h * h / self.masses[i])
                }
            })
            .collect();
        let friction = self.lag_friction(&contacts, h);
        let problem = Problem { start: self.x.clone(), target, inertia: 1.0 / (h * h), friction };
        let (x, info) = self.minimise(&problem, guess, until)?;
        self.moved = x.iter().zip(&self.x).map(|(x, s)| x - s).collect();
        self.moved_in = h;
        self.v = x.iter().zip(before).map(|(x, b)| (x - b) * ((1.0 - damping) / h)).collect();
        self.x = x;
        self.lagged = problem.friction;
        self.lag_torque();
        Ok(info)
    }

    /// Force on node `i` that does not depend on where the cloth is [N]: its weight, and what
    /// seam offsets do to their rings.
    fn outer_force(&self, i: usize) -> Vec3 {
        self.gravity * self.masses[i] + self.ring_forces[i]
    }

    /// Hands the torque on seam offsets to their rings, from the forces at the step's end.
    /// The mean of two steps, so that a light ring does not swing about the answer. Friction
    /// on offset vertices has its force on the node, and no torque.
    fn lag_torque(&mut self) {
        if self.offsets.offset_vertices().next().is_none() {
            return;
        }
        let vertices = self.offsets.vertices(&self.x);
        let mut force: Vec<Vec3> = self.elastic.judge_by_vertex(&vertices).iter().map(|g| -g).collect();
        let mut offset = vec![false; vertices.len()];
        self.offsets.offset_vertices().for_each(|v| offset[v] = true);
        let sheet = &self.contact.scene.sheet;
        let wanted: Vec<bool> = sheet.vertex.iter().map(|&v| offset[v as usize]).collect();
        for (point, f) in self.contact.forces_on(&self.points(), &wanted) {
            force[sheet.vertex[point as usize] as usize] += f;
        }
        self.ring_forces.iter_mut().for_each(|f| *f *= 0.5);
        force.iter_mut().for_each(|f| *f *= 0.5);
        self.offsets.ring_forces(&self.x, &force, &mut self.ring_forces);
    }

    /// Finds what is tangled where the cloth is now.
    pub(super) fn reclassify(&mut self) {
        let points = self.points();
        self.contact.classify(&points);
    }

    /// A few Newton iterations of a step from rest; leaves the cloth at rest.
    pub(super) fn push(&mut self, h: f64) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.refresh(&self.points(), f64::INFINITY);
        self.at_rest(h, Until { most: PUSH_ITERATIONS, stubborn: true, ..self.to_tolerance() })
    }

    /// Towards the equilibrium of stiffer cloth, about its shape without short folds, with nothing in
    /// the way within `rings` of edges of tangles.
    pub(super) fn loosen(&mut self, h: f64, rings: usize) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.loosen(&self.points(), rings);
        let about = self.unfolded();
        self.elastic.press(self.device, LOOSENED, &about)?;
        let step = self.at_rest(h, self.to_relaxed());
        self.elastic.press(self.device, 1.0, &about)?;
        step
    }

    /// An iteration towards the aims of points inside of solids, nothing else in the way.
    pub(super) fn draw(&mut self, h: f64) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.let_through(&self.points());
        self.at_rest(h, Until { most: 1, ..self.to_tolerance() })
    }

    /// Over the folds of lower layers that the cloth passes through; `None` where there are none.
    pub(super) fn lift(&mut self, h: f64) -> Result<Option<StepInfo>, Error> {
        self.offsets.turn(&self.x);
        if !self.contact.lift(&self.points()) {
            return Ok(None);
        }
        self.at_rest(h, self.to_relaxed()).map(Some)
    }

    /// Out of slots that are too narrow for the cloth; `None` where nothing is caught in one.
    pub(super) fn carry_out(&mut self, h: f64) -> Result<Option<StepInfo>, Error> {
        self.offsets.turn(&self.x);
        if !self.contact.carry_out(&self.points()) {
            return Ok(None);
        }
        self.at_rest(h, self.to_relaxed()).map(Some)
    }

    /// Towards the equilibrium without gravity and friction, from rest.
    pub(super) fn relax(&mut self, h: f64) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.refresh(&self.points(), f64::INFINITY);
        self.at_rest(h, self.to_relaxed())
    }

    /// Where a minimisation ends whose result others start from.
    fn to_relaxed(&self) -> Until {
        Until { gain: RELAXED, remembers: false, ..self.to_tolerance() }
    }

    /// Minimises from rest; leaves the cloth at rest.
    fn at_rest(&mut self, h: f64, until: Until) -> Result<StepInfo, Error> {
        let (start, target) = (self.x.clone(), self.x.clone());
        let problem = Problem { start, target, inertia: 1.0 / (h * h), friction: Vec::new() };
        let (x, info) = self.minimise(&problem, None, until)?;
        self.x = x;
        self.v.iter_mut().for_each(|v| *v = Vec3::zeros());
        Ok(info)
    }

    /// Friction stencils from the contacts at the start of a step.
    fn lag_friction(&self, contacts: &Contacts, h: f64) -> Vec<Stencil> {
        let lag = |s: &Stencil| {
            let force = s.normal_force();
            let mu = self.friction[s.nodes[0] as usize];
            (force * mu > 0.0).then_some(Stencil {
                kind: Kind::Friction,
                gap: 0.0,
                radius: self.params.friction_speed * h.min(MOST_STICKING),
                stiffness: mu * force,
                ..*s
            })
        };
        contacts.stencils.iter().filter_map(lag).collect()
    }
}
