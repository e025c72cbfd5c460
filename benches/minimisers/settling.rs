//! Quasi-static steps to rest, as the drape's settling phase takes them, and what they cost.

use dressform::drape::FRAME;
use dressform::model::Vec3;

use crate::clock::cpu_seconds;
use crate::problem::{Problem, Step};

/// Largest net forces on a node [mean node weights] whose times are taken; the least is rest.
pub const BARS: [f64; 3] = [1.0, 0.1, 0.05];
/// Longest step, and the shortest that is still shortened [s].
const STEPS: [f64; 2] = [1.0, 0.01];
/// A minimisation on the way to the longest step ends when what it has left to gain is less than
/// this share of what it has gained.
pub const APPROACH_GAIN: f64 = 2e-3;

/// Most iterations of a quasi-static step.
const MOST: usize = 480;

/// How a step's minimisation ends besides the [`Watch`].
#[derive(Clone, Copy)]
pub struct Until {
    /// When the largest unbalanced force on a node is below this many mean node weights.
    pub tolerance: f64,
    /// When no more than this share of what was gained is left to gain.
    pub gain: f64,
    /// After so many iterations.
    pub most: usize,
}

pub trait Minimiser {
    /// Minimises the objective of `step` from `x`; whether it came to one of its ends.
    fn minimise(
        &mut self,
        problem: &Problem,
        step: &Step,
        until: Until,
        x: &mut Vec<Vec3>,
        watch: &mut Watch,
    ) -> bool;
}

/// A run's account.
pub struct Watch {
    started: f64,
    aside: f64,
    limit: f64,
    /// CPU seconds until each of [`BARS`] was first met.
    pub reached: [Option<f64>; 3],
    /// Outer iterations: Newton's, or sweeps.
    pub iterations: usize,
    /// Iterations of the linear solver.
    pub linear: usize,
    /// The last net force seen.
    pub net: f64,
}

impl Watch {
    /// Starts now; over after `limit` CPU seconds.
    pub fn start(limit: f64) -> Watch {
        let (started, net) = (cpu_seconds(), f64::INFINITY);
        Watch { started, aside: 0.0, limit, reached: [None; 3], iterations: 0, linear: 0, net }
    }

    /// CPU seconds of the run so far.
    pub fn seconds(&self) -> f64 {
        cpu_seconds() - self.started - self.aside
    }

    /// Takes note of a net force.
    pub fn look(&mut self, net: f64) {
        self.net = net;
        let seconds = self.seconds();
        for (bar, reached) in BARS.iter().zip(&mut self.reached) {
            if net <= *bar {
                reached.get_or_insert(seconds);
            }
        }
    }

    /// Does what is no part of the run.
    pub fn aside<T>(&mut self, f: impl FnOnce() -> T) -> T {
        let before = cpu_seconds();
        let value = f();
        self.aside += cpu_seconds() - before;
        value
    }

    pub fn at_rest(&self) -> bool {
        self.reached[BARS.len() - 1].is_some()
    }

    /// Whether the run is to end; without a limit it never is.
    pub fn over(&self) -> bool {
        self.limit.is_finite() && (self.at_rest() || self.seconds() > self.limit)
    }
}

/// Steps that double from a frame to a second, each from rest, until the cloth is at rest. Those
/// before the longest only approach; one that fails is repeated with a quarter of the length.
pub fn settle(problem: &Problem, minimiser: &mut dyn Minimiser, watch: &mut Watch) -> Vec<Vec3> {
    let mut x = problem.garment.points.clone();
    let mut h = FRAME;
    while !watch.over() {
        let step = Step { from: x.clone(), inertia: 1.0 / (h * h) };
        let gain = if h < STEPS[0] { APPROACH_GAIN } else { 0.0 };
        let until = Until { tolerance: BARS[BARS.len() - 1], gain, most: MOST };
        if minimiser.minimise(problem, &step, until, &mut x, watch) || h <= STEPS[1] {
            h = (2.0 * h).min(STEPS[0]);
        } else if !watch.over() {
            x = step.from;
            h *= 0.25;
        }
    }
    x
}

/// Time steps of `h` [s] and so many iterations each, with velocities that drag takes away at the rate
/// `drag` [1/s].
pub fn fall(
    problem: &Problem,
    minimiser: &mut dyn Minimiser,
    (h, most, drag): (f64, usize, f64),
    watch: &mut Watch,
) -> Vec<Vec3> {
    let until = Until { tolerance: 0.0, gain: 0.0, most };
    let mut x = problem.garment.points.clone();
    let mut moved = vec![Vec3::zeros(); x.len()];
    while !watch.over() {
        let before = x.clone();
        let kept = 1.0 / (1.0 + drag * h);
        let from = x.iter().zip(&moved).map(|(x, moved)| x + moved * kept).collect();
        minimiser.minimise(problem, &Step { from, inertia: 1.0 / (h * h) }, until, &mut x, watch);
        moved = x.iter().zip(&before).map(|(x, before)| x - before).collect();
    }
    x
}
