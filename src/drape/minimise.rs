//! The minimisation of a step's objective: Newton with a line search that never passes through.
//!
//! The matrix is a positive semi-definite stand-in for the Hessian; where it is factored, the
//! negative curvature that it leaves out is put back as far as it stays positive definite
//! ([`super::elastic::softening`]). Moves may be as long as the search direction asks:
//! continuous collision detection over the path says how far they may go ([`super::contact`]).

use super::Error;
use super::history::History;
use super::objective::{Here, Problem};
use super::simulation::{Simulation, StepInfo};
use crate::model::Vec3;
use crate::solve::cg::CgParams;
use crate::solve::host_cg::dot;

/// Decrease that a step must bring, as a share of what the slope promises [Armijo 1966].
const ARMIJO: f64 = 1e-4;
/// Shortest share of a Newton step that is tried.
const SHORTEST: f64 = 1e-7;
/// Share of what is free that a stubborn minimisation moves by where nothing brings the objective
/// down, and the shortest share that it tries before.
const NUDGE: f64 = 0.25;
const SHORTEST_STUBBORN: f64 = 0.05;
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

impl Simulation<'_> {
    /// Minimises from where the nodes are, or `guess` from there if the objective is lower where that
    /// leads freely; where the nodes would be, and what was achieved.
    pub(super) fn minimise(
        &mut self,
        problem: &Problem,
        guess: Option<&[Vec3]>,
        until: Until,
    ) -> Result<(Vec<Vec3>, StepInfo), Error> {
        let mut here = self.evaluate(self.x.clone(), problem);
        if let Some(guess) = guess {
            let share = self.free_share(&here, guess, 1.0);
            here = match self.go(&here, guess, share, problem, here.energy) {
                Some(there) => there,
                None => self.come_back(here, problem),
            };
        }
        let first = here.energy;
        let mut info = StepInfo::default();
        let mut history = History::default();
        loop {
            info.residual = self.residual(&here.gradient);
            info.converged = info.residual <= self.params.tolerance;
            if info.converged || info.approached || info.newton >= until.most {
                return Ok((here.x, info));
            }
            let Some(descent) = self.descent(&mut here, problem, &mut history, &mut info)? else {
                return Ok((here.x, info)); // no descent in f32: as good as it gets
            };
            let left = -0.5 * descent.slope;
            let Some(there) = self.search(&here, &descent, problem, until) else {
                return Ok((here.x, info));
            };
            info.approached = left < until.gain * (first - there.energy);
            if (until.remembers || info.newton > LONG) && info.residual < NEAR {
                history.push(&here.x, &there.x, &here.gradient, &there.gradient);
            } else {
                history.clear();
            }
            here = there;
            info.newton += 1;
        }
    }

    /// A direction of descent, no longer than contact allows, and the slope along it.
    fn descent(
        &mut self,
        here: &mut Here,
        problem: &Problem,
        history: &mut History,
        info: &mut StepInfo,
    ) -> Result<Option<Descent>, Error> {
        let mut direction = self.direction(here, problem, history, info)?;
        let mut slope = dot(&direction, &here.gradient);
        if slope >= 0.0 && !history.is_empty() {
            history.clear();
            direction = self.direction(here, problem, history, info)?;
            slope = dot(&direction, &here.gradient);
        }
        let length = direction.iter().map(Vec3::norm).fold(0.0, f64::max);
        if !length.is_finite() || slope >= 0.0 {
            return Ok(None);
        }
        let longest = self.contact.refresh(&here.points, length);
        if here.search != self.contact.searches() {
            here.contacts = self.contact.contacts(&here.points);
            here.search = self.contact.searches();
        }
        let most = longest / length;
        if most < 1.0 {
            direction.iter_mut().for_each(|d| *d *= most);
            slope *= most;
        }
        Ok(Some(Descent { direction, slope, most: most.max(1.0) }))
    }

    /// Solves for the Newton direction at `here`.
    fn direction(
        &mut self,
        here: &Here,
        problem: &Problem,
        history: &History,
        info: &mut StepInfo,
    ) -> Result<Vec<Vec3>, Error> {
        self.elastic.rebase_to(self.device, &here.measured)?;
        self.elastic.assemble_hessian(self.device, &self.rest)?;
        let stencils = [&here.contacts.stencils[..], &here.held[..], &problem.friction[..]].concat();
        let cg = CgParams { tolerance: self.params.cg_tolerance, max_iterations: self.params.max_cg };
        let (gradient, weights) = history.before(here.gradient.clone());
        let (direction, solved) = self.system.direction(
            self.device,
            (&self.elastic, &here.x, &here.vertices),
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
    fn search(&mut self, here: &Here, descent: &Descent, problem: &Problem, until: Until) -> Option<Here> {
        let free = self.free_share(here, &descent.direction, 1.0);
        let shortest = if until.stubborn { SHORTEST_STUBBORN } else { SHORTEST };
        let mut share = free;
        while share > shortest {
            let most = here.energy * (1.0 + ROUNDING) + ARMIJO * share * descent.slope;
            if let Some(there) = self.go(here, &descent.direction, share, problem, most) {
                let whole = share == 1.0 && !until.remembers;
                return Some(if whole { self.onward(here, descent, problem, there) } else { there });
            }
            share *= 0.5;
        }
        let nudge = NUDGE * free;
        until.stubborn.then(|| self.go(here, &descent.direction, nudge, problem, f64::INFINITY))?
    }

    /// Twice as far along the direction, again and again, while that brings the objective down
    /// nearly in proportion: there the matrix is several times too stiff.
    fn onward(&mut self, here: &Here, descent: &Descent, problem: &Problem, mut best: Here) -> Here {
        let mut share = 1.0;
        while here.energy - best.energy > STEADY * share * -descent.slope
            && 2.0 * share <= FARTHEST.min(descent.most)
        {
            let more = share * self.free_share(&best, &descent.direction, share);
            let Some(next) = self.go(&best, &descent.direction, more, problem, best.energy) else {
                return self.come_back(best, problem);
            };
            share += more;
            best = next;
        }
        best
    }

    /// The share of the direction's multiple that no clean pair forbids.
    fn free_share(&self, here: &Here, direction: &[Vec3], multiple: f64) -> f64 {
        let node = &self.contact.scene.sheet.node;
        let by_point: Vec<Vec3> = node.iter().map(|&n| direction[n as usize] * multiple).collect();
        self.contact.free_share(&here.points, &by_point, &here.contacts)
    }

    /// A share of `direction` from `here`, where nothing is in the way, if the objective there is
    /// at `most` so high [J].
    fn go(
        &mut self,
        here: &Here,
        direction: &[Vec3],
        share: f64,
        problem: &Problem,
        most: f64,
    ) -> Option<Here> {
        let next = here.x.iter().zip(direction).map(|(x, d)| x + d * share).collect();
        let placed = self.place(next, problem);
        if placed.energy > most {
            return None;
        }
        self.contact.keep_up(&placed.points);
        let found = self.touch(placed, problem);
        (found.energy <= most).then(|| self.linearise(found, problem))
    }
}
