//! Newton with the drape's line search, by three ways to solve for its direction.

use dressform::device::{Buffer, Device};
use dressform::drape::curvature::Curvature;
use dressform::drape::elastic::Elastic;
use dressform::model::Vec3;
use dressform::solve::block_cholesky::{Block, BlockFactor, BlockPattern};
use dressform::solve::cg::CgParams;
use dressform::solve::host_cg::{self, dot};
use dressform::solve::two_level::{BlockJacobi, TwoLevel};
use nalgebra::Matrix3;

use crate::problem::{Here, Problem, Step};
use crate::settling::{Minimiser, Until, Watch};

/// Decrease that a step must bring, as a share of what the slope promises [Armijo 1966].
const ARMIJO: f64 = 1e-4;
/// Shortest share of a Newton step that is tried.
const SHORTEST: f64 = 1e-7;
/// Share of what the slope promises that must come for a search to go on beyond a whole step.
const STEADY: f64 = 0.75;
/// Longest multiple of a Newton step.
const FARTHEST: f64 = 16.0;
/// Energies closer than this share of themselves are equal up to rounding.
const ROUNDING: f64 = 1e-14;
/// The drape's tolerance of a linear solve, and most iterations.
const LINEAR: CgParams = CgParams { tolerance: 0.1, max_iterations: 2000 };
/// Stiffness that holds a held node in the matrix [N/m].
const HOLD: f64 = 1e8;

/// Where a Newton direction comes from.
pub enum Solver {
    /// A Cholesky factor of the true Hessian, projected around where that is not positive definite.
    Factor(BlockFactor),
    /// Conjugate gradients with the projected Hessian's diagonal blocks.
    BlockJacobi,
    /// Conjugate gradients with two levels of the projected Hessian; of the true one if `truly`.
    TwoLevel { levels: Box<TwoLevel>, truly: bool },
}

pub struct Newton {
    device: Device,
    elastic: Elastic,
    still: Buffer<f32>,
    pattern: BlockPattern,
    curvature: Curvature,
    solver: Solver,
}

impl Newton {
    /// With a direction from [`Solver::Factor`].
    pub fn factored(problem: &Problem) -> Newton {
        let mut newton = Newton::block_jacobi(problem);
        newton.solver = Solver::Factor(BlockFactor::default());
        newton
    }

    /// With a direction from [`Solver::TwoLevel`].
    pub fn two_level(problem: &Problem, truly: bool) -> Newton {
        let mut newton = Newton::block_jacobi(problem);
        let levels = Box::new(TwoLevel::new(&newton.pattern, &problem.held));
        newton.solver = Solver::TwoLevel { levels, truly };
        newton
    }

    /// With a direction from [`Solver::BlockJacobi`].
    pub fn block_jacobi(problem: &Problem) -> Newton {
        let device = Device::cpu();
        let elastic = Elastic::new(&device, &problem.cloth).expect("fits");
        let hessian = elastic.hessian();
        let read = |buffer: &Buffer<u32>| device.read(buffer).expect("reads");
        let pattern = BlockPattern::new(&read(&hessian.row_start), &read(&hessian.columns)).expect("fits");
        let curvature = Curvature::new(&pattern, &elastic).expect("has room");
        let still = device.zeros("displacement", 3 * problem.cloth.node_count).expect("fits");
        Newton { still, elastic, pattern, curvature, solver: Solver::BlockJacobi, device }
    }

    /// The projected Hessian of a step's objective at `x`.
    fn projected(&mut self, problem: &Problem, step: &Step, x: &[Vec3]) -> Vec<Block> {
        self.elastic.rebase(&self.device, x).expect("finite");
        self.elastic.linearise(&self.device, &self.still).expect("runs");
        let blocks = self.device.read(&self.elastic.hessian().blocks).expect("reads");
        let mut blocks: Vec<Block> = blocks.iter().map(|b| b.map(f64::from)).collect();
        let hold = |i: usize| if problem.held[i] { HOLD } else { 0.0 };
        let masses = problem.cloth.masses.iter().enumerate();
        let diagonal: Vec<f64> = masses.map(|(i, m)| m * step.inertia + hold(i)).collect();
        self.pattern.add_to_diagonal(&mut blocks, &diagonal, 1.0);
        blocks
    }

    /// The diagonal blocks of the elastic energy's projected Hessian at `x`, of free nodes.
    pub fn diagonal(&mut self, problem: &Problem, x: &[Vec3]) -> Vec<Matrix3<f64>> {
        let blocks = self.projected(problem, &Step { from: x.to_vec(), inertia: 0.0 }, x);
        let slot = |i: u32| self.pattern.slot(i, i).expect("a diagonal");
        (0..x.len() as u32).map(|i| Matrix3::from_row_slice(&blocks[slot(i)])).collect()
    }

    /// The direction `-H^-1 gradient` [m] and the linear solver's iterations.
    fn direction(&mut self, problem: &Problem, step: &Step, x: &[Vec3], here: &Here) -> (Vec<Vec3>, usize) {
        let mut blocks = self.projected(problem, step, x);
        let pattern = &self.pattern;
        let right: Vec<Vec3> = here.gradient.iter().map(|g| -g).collect();
        let (mut direction, iterations) = match &mut self.solver {
            Solver::Factor(factor) => {
                if !self.curvature.put_back(pattern, &mut blocks, &self.elastic, x, factor) {
                    factor_shifted(pattern, &mut blocks, &problem.cloth.masses, step.inertia, factor);
                }
                (pattern.solve(factor, &right), 1)
            }
            Solver::BlockJacobi => {
                let inverse = BlockJacobi::new(pattern, &blocks).expect("positive definite");
                solve(pattern, &blocks, &mut |r| inverse.apply(r), &right)
            }
            Solver::TwoLevel { levels, truly } => {
                levels.set(pattern, &blocks, x).expect("positive definite");
                if *truly {
                    self.curvature.put_back_all(&mut blocks, &self.elastic, x);
                }
                solve(pattern, &blocks, &mut |r| levels.apply(r), &right)
            }
        };
        direction.iter_mut().zip(&problem.held).filter(|(_, held)| **held).for_each(|(d, _)| d.fill(0.0));
        (direction, iterations)
    }
}

/// The solution and the iterations.
fn solve(
    pattern: &BlockPattern,
    blocks: &[Block],
    precondition: &mut dyn FnMut(&[Vec3]) -> Vec<Vec3>,
    right: &[Vec3],
) -> (Vec<Vec3>, usize) {
    let apply = |x: &[Vec3]| {
        let mut y = vec![Vec3::zeros(); x.len()];
        pattern.add_product(blocks, x, &mut y);
        y
    };
    let (x, info) = host_cg::solve(&apply, precondition, right, &LINEAR);
    (x, info.iterations)
}

/// Factors a matrix that is positive semi-definite but for rounding.
fn factor_shifted(
    pattern: &BlockPattern,
    blocks: &mut [Block],
    masses: &[f64],
    inertia: f64,
    factor: &mut BlockFactor,
) {
    let mut more: Vec<f64> = masses.iter().map(|m| 9.0 * m * inertia).collect();
    while pattern.factor(blocks, factor).is_err() {
        pattern.add_to_diagonal(blocks, &more, 1.0);
        more.iter_mut().for_each(|m| *m *= 10.0);
    }
}

/// Backtracks until the objective falls by enough, or doubles the step while it falls nearly in
/// proportion.
fn search(
    problem: &Problem,
    step: &Step,
    (x, here): (&[Vec3], &Here),
    direction: &[Vec3],
    slope: f64,
) -> Option<(Vec<Vec3>, Here)> {
    let go = |share: f64| {
        let next: Vec<Vec3> = x.iter().zip(direction).map(|(x, d)| x + d * share).collect();
        let there = problem.evaluate(&next, step);
        (next, there)
    };
    let mut share = 1.0;
    let mut best = loop {
        let found = go(share);
        let allowed = ROUNDING * (here.energy.abs() + found.1.energy.abs());
        if found.1.energy <= here.energy + ARMIJO * share * slope + allowed {
            break found;
        }
        share *= 0.5;
        if share < SHORTEST {
            return None;
        }
    };
    while (1.0..FARTHEST).contains(&share) && here.energy - best.1.energy > STEADY * share * -slope {
        let farther = go(2.0 * share);
        if farther.1.energy >= best.1.energy {
            break;
        }
        (share, best) = (2.0 * share, farther);
    }
    Some(best)
}

impl Minimiser for Newton {
    fn minimise(
        &mut self,
        problem: &Problem,
        step: &Step,
        until: Until,
        x: &mut Vec<Vec3>,
        watch: &mut Watch,
    ) -> bool {
        let mut here = problem.evaluate(x, step);
        let first = here.energy;
        for _ in 0..until.most {
            watch.look(here.net);
            if watch.over() || problem.residual(&here.gradient) <= until.tolerance {
                return true;
            }
            let (direction, iterations) = self.direction(problem, step, x, &here);
            let slope = dot(&direction, &here.gradient);
            let found = if slope < 0.0 { search(problem, step, (x, &here), &direction, slope) } else { None };
            let Some((next, there)) = found else { return false };
            (*x, here) = (next, there);
            watch.iterations += 1;
            watch.linear += iterations;
            // Half of the slope is what was left to gain by Newton's model.
            if -0.5 * slope < until.gain * (first - here.energy) {
                watch.look(here.net);
                return true;
            }
        }
        false
    }
}
