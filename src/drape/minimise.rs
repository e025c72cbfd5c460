//! The minimisation of a step's objective: Newton with a line search that never passes through.
//!
//! The matrix is a positive semi-definite stand-in for the Hessian; where it is factored, the
//! negative curvature that it leaves out is put back as far as it stays positive definite
//! ([`super::elastic::softening`]). Moves may be as long as the search direction asks:
//! continuous collision detection over the path says how far they may go ([`super::contact`]).

use super::Error;
use super::contact::narrow::Contacts;
use super::contact::stencil::Stencil;
use super::history::History;
use super::simulation::{Simulation, StepInfo};
use crate::model::Vec3;
use crate::solve::cg::CgParams;
use crate::solve::host_cg::dot;

/// Decrease that a step must bring, as a share of what the slope promises [Armijo 1966].
const ARMIJO: f64 = 1e-4;
/// Shortest share of a Newton step that is tried.
const SHORTEST: f64 = 1e-7;
/// Share of what is free that a stubborn minimisation moves by where nothing brings the objective
/// down.
const NUDGE: f64 = 0.25;
/// Residual, in mean node weights, from which on the history is kept.
const NEAR: f64 = 1.0;
/// Share of what the slope promises that must come for a search to go on beyond a whole step; an
/// exact quadratic gives a half.
const STEADY: f64 = 0.75;
/// Longest multiple of a Newton step.
const FARTHEST: f64 = 16.0;
/// Iterations after which the history is kept in any case: a minimisation that long zigzags.
const LONG: usize = 60;
/// Energies closer than this share of themselves are equal up to rounding.
const ROUNDING: f64 = 1e-14;

/// What a step minimises over.
pub(super) struct Problem {
    pub start: Vec<Vec3>,
    pub target: Vec<Vec3>,
    pub inertia: f64,
    pub friction: Vec<Stencil>,
}

/// Where a minimisation ends besides its tolerance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Until {
    /// Most Newton iterations.
    pub most: usize,
    /// After the iteration that promises less than this share of the decrease so far (0: none).
    /// Half of the slope along a Newton direction is what is left to gain by its own model,
    /// however fine the mesh is.
    pub gain: f64,
    /// Whether near its end the history of its iterations takes part ([`History`]); in long
    /// minimisations it does in any case.
    pub remembers: bool,
    /// Whether moves are made that do not bring the objective down: springs of tangled pairs jump
    /// where a pair changes sides, and a push must get past that.
    pub stubborn: bool,
}

/// Where a line search goes.
struct Descent {
    /// [m]
    direction: Vec<Vec3>,
    /// Of the objective along the direction [J].
    slope: f64,
    /// The longest multiple of the direction that contact can follow.
    most: f64,
}

/// The objective and its gradient at one configuration.
pub(super) struct Here {
    vertices: Vec<Vec3>,
    points: Vec<Vec3>,
    moved: Vec<Vec3>,
    energy: f64,
    pub gradient: Vec<Vec3>,
    contacts: Contacts,
    held: Vec<Stencil>,
}

impl Simulation<'_> {
    /// Minimises from where the nodes are, or `guess` from there if the objective is lower where that
    /// leads freely; where the nodes would be, and what was achieved.
    pub(super) fn minimise(
        &mut self,
        problem: &Problem,
        guess: Option<&[Vec3]>,
        until: Until,
    ) -> Result<(Vec<Vec3>, StepInfo), Error> {
        let mut x = self.x.clone();
        let mut here = self.evaluate(&x, problem);
        if let Some(guess) = guess {
            let found = self.go(&x, guess, self.free_share(&here, guess, 1.0), problem);
            // Pairs may have been searched anew there.
            let better = found.1.energy < here.energy;
            (x, here) = if better { found } else { self.go(&x, guess, 0.0, problem) };
        }
        let first = here.energy;
        let mut info = StepInfo::default();
        let mut history = History::default();
        loop {
            info.residual = self.residual(&here.gradient);
            info.converged = info.residual <= self.params.tolerance;
            if info.converged || info.approached || info.newton >= until.most {
                return Ok((x, info));
            }
            let Some(descent) = self.descent(&x, &mut here, problem, &mut history, &mut info)? else {
                return Ok((x, info)); // no descent in f32: as good as it gets
            };
            let left = -0.5 * descent.slope;
            let Some((next, there)) = self.search(&x, &here, &descent, problem, until) else {
                return Ok((x, info));
            };
            info.approached = left < until.gain * (first - there.energy);
            if (until.remembers || info.newton > LONG) && info.residual < NEAR {
                history.push(&x, &next, &here.gradient, &there.gradient);
            } else {
                history.clear();
            }
            (x, here) = (next, there);
            info.newton += 1;
        }
    }

    /// A direction of descent, no longer than contact allows, and the slope along it.
    fn descent(
        &mut self,
        x: &[Vec3],
        here: &mut Here,
        problem: &Problem,
        history: &mut History,
        info: &mut StepInfo,
    ) -> Result<Option<Descent>, Error> {
        let mut direction = self.direction(x, here, problem, history, info)?;
        let mut slope = dot(&direction, &here.gradient);
        if slope >= 0.0 && !history.is_empty() {
            history.clear();
            direction = self.direction(x, here, problem, history, info)?;
            slope = dot(&direction, &here.gradient);
        }
        let length = direction.iter().map(Vec3::norm).fold(0.0, f64::max);
        if !length.is_finite() || slope >= 0.0 {
            return Ok(None);
        }
        let (searched, longest) = self.contact.refresh(&here.points, length);
        if searched {
            here.contacts = self.contact.contacts(&here.points);
        }
        let most = longest / length;
        if most < 1.0 {
            direction.iter_mut().for_each(|d| *d *= most);
            slope *= most;
        }
        Ok(Some(Descent { direction, slope, most: most.max(1.0) }))
    }

    /// Solves for the Newton direction at `here`, where the nodes are at `x`.
    fn direction(
        &mut self,
        x: &[Vec3],
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
            (&self.elastic, x, &here.vertices),
            &stencils,
            &here.moved,
            problem.inertia,
            &gradient,
            &cg,
        )?;
        info.cg += solved.iterations;
        Ok(history.after(direction, &weights))
    }

    /// Backtracks until the objective falls by enough for the slope, or goes on while it falls
    /// faster than a matrix as stiff as ours says.
    fn search(
        &mut self,
        x: &[Vec3],
        here: &Here,
        descent: &Descent,
        problem: &Problem,
        until: Until,
    ) -> Option<(Vec<Vec3>, Here)> {
        let free = self.free_share(here, &descent.direction, 1.0);
        let mut share = free;
        while share > SHORTEST {
            let (next, there) = self.go(x, &descent.direction, share, problem);
            let allowed = ROUNDING * (here.energy.abs() + there.energy.abs());
            if there.energy <= here.energy + ARMIJO * share * descent.slope + allowed {
                let found = (next, there);
                return Some(if share == 1.0 && !until.remembers {
                    self.onward(here, descent, problem, found)
                } else {
                    found
                });
            }
            share *= 0.5;
        }
        until.stubborn.then(|| self.go(x, &descent.direction, NUDGE * free, problem))
    }

    /// Twice as far along the direction, again and again, while that brings the objective down
    /// nearly in proportion: there the matrix is several times too stiff.
    fn onward(
        &mut self,
        here: &Here,
        descent: &Descent,
        problem: &Problem,
        mut best: (Vec<Vec3>, Here),
    ) -> (Vec<Vec3>, Here) {
        let mut share = 1.0;
        let mut gain = here.energy - best.1.energy;
        while gain > STEADY * share * -descent.slope && 2.0 * share <= FARTHEST.min(descent.most) {
            let more = share * self.free_share(&best.1, &descent.direction, share);
            let next = self.go(&best.0, &descent.direction, more, problem);
            if here.energy - next.1.energy <= gain {
                // Pairs may have been searched anew there.
                return self.go(&best.0, &descent.direction, 0.0, problem);
            }
            share += more;
            (gain, best) = (here.energy - next.1.energy, next);
        }
        best
    }

    /// The share of the direction's multiple that no clean pair forbids.
    fn free_share(&self, here: &Here, direction: &[Vec3], multiple: f64) -> f64 {
        let node = &self.contact.scene.sheet.node;
        let by_point: Vec<Vec3> = node.iter().map(|&n| direction[n as usize] * multiple).collect();
        self.contact.free_share(&here.points, &by_point, &here.contacts)
    }

    /// A share of `direction` from `x`, where nothing is in the way.
    fn go(&mut self, x: &[Vec3], direction: &[Vec3], share: f64, problem: &Problem) -> (Vec<Vec3>, Here) {
        let next: Vec<Vec3> = x.iter().zip(direction).map(|(x, d)| x + d * share).collect();
        self.contact.keep_up(&self.contact_points(&next));
        let there = self.evaluate(&next, problem);
        (next, there)
    }

    pub(super) fn evaluate(&self, x: &[Vec3], problem: &Problem) -> Here {
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
    pub(super) fn residual(&self, gradient: &[Vec3]) -> f64 {
        let free = gradient.iter().zip(&self.pinned).filter(|(_, pinned)| !**pinned);
        let worst = free.map(|(g, _)| g.norm()).fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
        worst / self.node_weight()
    }
}
