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
use super::offsets::Offsets;
use super::system::System;
use super::{Error, Params};
use crate::device::{Buffer, Device};
use crate::model::Vec3;
use crate::solve::cg::CgParams;

/// Decrease that a step must bring, as a share of what the slope promises [Armijo 1966].
const ARMIJO: f64 = 1e-4;
/// Shortest share of a Newton step that is tried.
const SHORTEST: f64 = 1e-7;
/// Newton iterations of a push.
const PUSH_ITERATIONS: usize = 8;
/// Share of what is free that a stubborn problem moves by where nothing brings the objective down.
const NUDGE: f64 = 0.25;
/// How many times more Newton iterations a quasi-static step may take: it moves farther.
const QUASI_STATIC: usize = 4;
/// Iterations that the quasi-Newton history remembers.
const MEMORY: usize = 5;
/// Residual, in mean node weights, from which on the history is kept.
const NEAR: f64 = 1.0;
/// Longest time for which [`Params::friction_speed`] gives a sticking distance [s]
const MOST_STICKING: f64 = 0.1;
/// Energies closer than this share of themselves are equal up to rounding.
const ROUNDING: f64 = 1e-14;

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
}

/// A cloth in motion.
pub struct Simulation<'a> {
    pub(super) device: &'a Device,
    pub(super) params: &'a Params,
    pub(super) elastic: Elastic,
    pub(super) system: System,
    /// No displacement: every linearisation is about a rebased reference.
    rest: Buffer<f32>,
    pub(super) contact: Contact<'a>,
    pub(super) offsets: Offsets,
    pub(super) hold: Hold,
    /// Node masses [kg].
    pub(super) masses: Vec<f64>,
    /// Friction coefficient of each node.
    pub(super) friction: Vec<f64>,
    /// Nodes that do not move.
    pub(super) pinned: Vec<bool>,
    /// Acceleration of gravity [m/s^2].
    pub(super) gravity: Vec3,
    /// Node positions [m].
    pub x: Vec<Vec3>,
    /// Node velocities [m/s].
    pub v: Vec<Vec3>,
    /// Lagged friction of the last step.
    lagged: Vec<Stencil>,
    /// Displacements in the last step [m].
    moved: Vec<Vec3>,
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
    ring_forces: Vec<Vec3>,
}

/// What a step minimises over.
struct Problem {
    start: Vec<Vec3>,
    target: Vec<Vec3>,
    inertia: f64,
    friction: Vec<Stencil>,
    /// Whether moves are made that do not bring the objective down: springs of tangled pairs jump
    /// where a pair changes sides, and a push must get past that.
    stubborn: bool,
}

/// The objective and its gradient at one configuration.
struct Here {
    vertices: Vec<Vec3>,
    points: Vec<Vec3>,
    moved: Vec<Vec3>,
    energy: f64,
    gradient: Vec<Vec3>,
    contacts: Contacts,
    held: Vec<Stencil>,
}

/// Changes of position and gradient in a step's last iterations, for the two loops of L-BFGS
/// [Nocedal and Wright 2006, alg. 7.4] around the Newton solve [Liu et al. 2017].
///
/// The projected matrix lacks the curvature that buckled cloth loses, which leaves Newton
/// with a slow linear tail; the history puts it back.
#[derive(Default)]
struct History {
    pairs: std::collections::VecDeque<(Vec<Vec3>, Vec<Vec3>, f64)>,
}

fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn add(a: &mut [Vec3], b: &[Vec3], factor: f64) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b * factor);
}

impl History {
    fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    fn clear(&mut self) {
        self.pairs.clear();
    }

    /// Remembers a step, if the curvature along it is positive.
    fn push(&mut self, x0: &[Vec3], x1: &[Vec3], g0: &[Vec3], g1: &[Vec3]) {
        let difference = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>();
        let (s, y) = (difference(x1, x0), difference(g1, g0));
        let curvature = dot(&s, &y);
        if curvature > 1e-10 * dot(&s, &s).sqrt() * dot(&y, &y).sqrt() {
            self.pairs.push_back((s, y, curvature));
            if self.pairs.len() > MEMORY {
                self.pairs.pop_front();
            }
        } else {
            self.clear();
        }
    }

    /// The gradient to solve with, and the weights that [`History::after`] needs.
    fn before(&self, mut gradient: Vec<Vec3>) -> (Vec<Vec3>, Vec<f64>) {
        let mut weights = vec![0.0; self.pairs.len()];
        for (i, (s, y, curvature)) in self.pairs.iter().enumerate().rev() {
            weights[i] = dot(s, &gradient) / curvature;
            add(&mut gradient, y, -weights[i]);
        }
        (gradient, weights)
    }

    /// The direction from the solve's.
    fn after(&self, mut direction: Vec<Vec3>, weights: &[f64]) -> Vec<Vec3> {
        for ((s, y, curvature), w) in self.pairs.iter().zip(weights) {
            let b = dot(y, &direction) / curvature;
            add(&mut direction, s, -(w + b));
        }
        direction
    }
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
            gravity: Vec3::new(0.0, -params.gravity, 0.0),
            x: parts.x,
            v: vec![Vec3::zeros(); nodes],
            lagged: Vec::new(),
            moved: vec![Vec3::zeros(); nodes],
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
            ring_forces: self.ring_forces.clone(),
        }
    }

    /// Goes back to a state.
    pub(super) fn restore(&mut self, state: State) {
        let State { x, v, lagged, moved, ring_forces } = state;
        (self.x, self.v, self.lagged) = (x, v, lagged);
        (self.moved, self.ring_forces) = (moved, ring_forces);
    }

    /// Contact points where the nodes are now.
    pub fn points(&self) -> Vec<Vec3> {
        self.contact.scene.sheet.points(&self.offsets.vertices(&self.x))
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
            stubborn: false,
        };
        let here = self.evaluate(&self.x, &still);
        let net: Vec<Vec3> = (0..self.x.len()).map(|i| here.gradient[i] - self.outer_force(i)).collect();
        self.residual(&net)
    }

    /// Advances by `h` seconds; of the velocity reached, the share `damping` is taken away.
    ///
    /// Where the minimisation does not reach its tolerance the step is still made, and the
    /// result says so.
    pub(super) fn step(&mut self, h: f64, damping: f64) -> Result<StepInfo, Error> {
        self.advance(&self.x.clone(), h, damping, 0.0)
    }

    /// As [`Simulation::step`] for cloth that was at `before` at the step's start and that moving
    /// colliders have carried to where it is: its inertia counts from `before`, slip from here.
    pub(super) fn step_from(&mut self, before: &[Vec3], h: f64, damping: f64) -> Result<StepInfo, Error> {
        self.advance(before, h, damping, 0.0)
    }

    /// A step of `h` seconds towards rest, in which all velocity is lost; the minimisation may
    /// also end where the residual has fallen to the share `relative` of what it starts with.
    pub(super) fn quasi_static(&mut self, h: f64, relative: f64) -> Result<StepInfo, Error> {
        self.advance(&self.x.clone(), h, 1.0, relative)
    }

    fn advance(&mut self, before: &[Vec3], h: f64, damping: f64, relative: f64) -> Result<StepInfo, Error> {
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
        let problem =
            Problem { start: self.x.clone(), target, inertia: 1.0 / (h * h), friction, stubborn: false };
        let most = if damping < 1.0 { self.params.max_newton } else { QUASI_STATIC * self.params.max_newton };
        let (x, info) = self.minimise(&problem, most, relative)?;
        self.moved = x.iter().zip(&self.x).map(|(x, s)| x - s).collect();
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
        self.at_rest(h, PUSH_ITERATIONS, true)
    }

    /// An iteration towards the aims of points inside of solids, nothing else in the way.
    pub(super) fn draw(&mut self, h: f64) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.let_through(&self.points());
        self.at_rest(h, 1, false)
    }

    /// Over the folds of lower layers that the cloth passes through; `None` where there are none.
    pub(super) fn lift(&mut self, h: f64) -> Result<Option<StepInfo>, Error> {
        self.offsets.turn(&self.x);
        if !self.contact.lift(&self.points()) {
            return Ok(None);
        }
        self.at_rest(h, self.params.max_newton, false).map(Some)
    }

    /// The equilibrium without gravity and friction, from rest.
    pub(super) fn relax(&mut self, h: f64) -> Result<StepInfo, Error> {
        self.offsets.turn(&self.x);
        self.contact.refresh(&self.points(), f64::INFINITY);
        self.at_rest(h, self.params.max_newton, false)
    }

    /// Minimises from rest, in at most so many iterations; leaves the cloth at rest.
    fn at_rest(&mut self, h: f64, most: usize, stubborn: bool) -> Result<StepInfo, Error> {
        let (start, target) = (self.x.clone(), self.x.clone());
        let problem = Problem { start, target, inertia: 1.0 / (h * h), friction: Vec::new(), stubborn };
        let (x, info) = self.minimise(&problem, most, 0.0)?;
        self.x = x;
        self.v.iter_mut().for_each(|v| *v = Vec3::zeros());
        Ok(info)
    }

    fn minimise(
        &mut self,
        problem: &Problem,
        most: usize,
        relative: f64,
    ) -> Result<(Vec<Vec3>, StepInfo), Error> {
        let mut x = self.x.clone();
        let mut here = self.evaluate(&x, problem);
        let tolerance = self.params.tolerance.max(relative * self.residual(&here.gradient));
        let mut info = StepInfo::default();
        let mut history = History::default();
        loop {
            info.residual = self.residual(&here.gradient);
            info.converged = info.residual <= tolerance;
            if info.converged || info.newton >= most {
                return Ok((x, info));
            }
            let mut direction = self.direction(&here, problem, &history, &mut info)?;
            let mut slope = dot(&direction, &here.gradient);
            if slope >= 0.0 && !history.is_empty() {
                history.clear();
                direction = self.direction(&here, problem, &history, &mut info)?;
                slope = dot(&direction, &here.gradient);
            }
            let length = direction.iter().map(Vec3::norm).fold(0.0, f64::max);
            if !length.is_finite() || slope >= 0.0 {
                return Ok((x, info)); // no descent in f32: as good as it gets
            }
            let (searched, longest) = self.contact.refresh(&here.points, length);
            if searched {
                here.contacts = self.contact.contacts(&here.points);
            }
            if length > longest {
                direction.iter_mut().for_each(|d| *d *= longest / length);
                slope *= longest / length;
            }
            let Some((next, there)) = self.search(&x, &here, &direction, slope, problem) else {
                return Ok((x, info));
            };
            if info.residual < NEAR {
                history.push(&x, &next, &here.gradient, &there.gradient);
            } else {
                history.clear();
            }
            (x, here) = (next, there);
            info.newton += 1;
        }
    }

    /// Solves for the Newton direction at `here`.
    fn direction(
        &mut self,
        here: &Here,
        problem: &Problem,
        history: &History,
        info: &mut StepInfo,
    ) -> Result<Vec<Vec3>, Error> {
        self.elastic.rebase(self.device, &here.vertices)?;
        self.elastic.linearise(self.device, &self.rest)?;
        let stencils = [&here.contacts.stencils[..], &here.held[..], &problem.friction[..]].concat();
        let cg = CgParams { tolerance: self.params.cg_tolerance, max_iterations: self.params.max_cg };
        let (gradient, weights) = history.before(here.gradient.clone());
        let (direction, solved) = self.system.direction(
            self.device,
            self.elastic.hessian(),
            &stencils,
            &here.moved,
            problem.inertia,
            &gradient,
            &cg,
        )?;
        info.cg += solved.iterations;
        Ok(history.after(direction, &weights))
    }

    /// Backtracks along `direction` until the objective falls; a stubborn problem moves anyway.
    fn search(
        &self,
        x: &[Vec3],
        here: &Here,
        direction: &[Vec3],
        slope: f64,
        problem: &Problem,
    ) -> Option<(Vec<Vec3>, Here)> {
        let sheet = &self.contact.scene.sheet;
        let by_point: Vec<Vec3> = sheet.node.iter().map(|&n| direction[n as usize]).collect();
        let free = self.contact.free_share(&here.points, &by_point, &here.contacts);
        let mut share = free;
        while share > SHORTEST {
            let next: Vec<Vec3> = x.iter().zip(direction).map(|(x, d)| x + d * share).collect();
            let there = self.evaluate(&next, problem);
            let allowed = ROUNDING * (here.energy.abs() + there.energy.abs());
            if there.energy <= here.energy + ARMIJO * share * slope + allowed {
                return Some((next, there));
            }
            share *= 0.5;
        }
        if !problem.stubborn {
            return None;
        }
        let next: Vec<Vec3> = x.iter().zip(direction).map(|(x, d)| x + d * (NUDGE * free)).collect();
        let there = self.evaluate(&next, problem);
        Some((next, there))
    }

    fn evaluate(&self, x: &[Vec3], problem: &Problem) -> Here {
        let vertices = self.offsets.vertices(x);
        let points = self.contact.scene.sheet.points(&vertices);
        let moved: Vec<Vec3> = x.iter().zip(&problem.start).map(|(x, s)| x - s).collect();
        let (mut energy, mut gradient) = self.elastic.judge(&vertices);
        for i in 0..x.len() {
            let m = self.masses[i] * problem.inertia;
            let d = x[i] - problem.target[i];
            energy += 0.5 * m * d.norm_squared();
            gradient[i] += d * m;
        }
        let contacts = self.contact.contacts(&points);
        let held = self.hold.stencils(x);
        for stencil in contacts.stencils.iter().chain(&held).chain(&problem.friction) {
            let (e, f) = stencil.evaluate(&moved);
            energy += e;
            for k in 0..4 {
                gradient[stencil.nodes[k] as usize] += f * stencil.weights[k];
            }
        }
        Here { vertices, points, moved, energy, gradient, contacts, held }
    }

    /// Largest force on a free node over the mean node weight.
    fn residual(&self, gradient: &[Vec3]) -> f64 {
        let free = gradient.iter().zip(&self.pinned).filter(|(_, pinned)| !**pinned);
        let worst = free.map(|(g, _)| g.norm()).fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
        worst / self.node_weight()
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
