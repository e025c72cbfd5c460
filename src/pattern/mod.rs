//! Refits the sewing pattern to the garment on its new body (paper section 4.2).
//!
//! # Theory
//! Every triangle has a tangent frame that carries warp and weft from pattern to space. On
//! the target body the frame keeps its rotation and takes over the stretch that the source
//! had ([`Fit::Keep`]) or none ([`Fit::Loose`]); bound to the triangle ([`frame`]), it says
//! which 2D shape the triangle wants. The layout is the least-squares answer to all
//! triangles ([`energy`]) and to the shape of the outline ([`outline`]) among the layouts that
//! obey ([`bounded`]) what is demanded ([`demand`]): equal lengths of what is sewn together,
//! straight runs that stay straight, corners that keep their angle, girths. Then inner vertices
//! are tidied up and no triangle stays turned over ([`tidy`], [`untangle`]).
//!
//! # What differs from the paper
//! - No ADMM: with the outline's scale factors as unknowns the energy is quadratic, so one
//!   sparse Cholesky finds its minimum. A test runs the paper's ADMM (with the sign of its
//!   dual update corrected) to the same answer.
//! - Weights are dimensionless over a reference length, the pattern's area over the length of
//!   its border: the result does not depend on the unit or on the mesh.
//! - Sewn chains ([`crate::model::Chain`]) keep equal lengths (or the ease that the original
//!   had) by constraints; the outline's weight then only has to look after shape, and strain
//!   need not pay for lengths.
//! - What an outline may not lose is bounded and not weighed: a weight that straightens the
//!   worst edge by force costs strain everywhere.
//! - The tidy-up is kept to crumpled places: everywhere, it costs more strain than all the
//!   rest of the refit (see [`tidy`]).
//! - Where demands fall on few triangles, these count more in a further solve ([`spread`]).
//! - Triangles that flip are counted and repaired.

pub mod bounded;
pub mod demand;
pub mod energy;
pub mod frame;
pub mod girth;
mod info;
mod mirror;
pub mod outline;
mod params;
pub mod runs;
pub mod shape;
mod spread;
pub mod tidy;
pub mod untangle;

#[cfg(test)]
mod tests;

pub use girth::Holding;
pub use info::{Error, Info, Repair};
pub use params::{Fit, Params, Tidy};
pub use shape::Shape;

use nalgebra::Matrix2;

use crate::model::{Chain, Garment, Tape, Vec2, Vec3, chain};
use crate::solve::cholesky::SparseCholesky;
use bounded::{Bounded, Outcome, Stop};
use demand::Demands;
use energy::Weights;
use frame::Binding;
use outline::Outline;
use runs::Runs;

/// Excess over a bound of shape that is good enough: a tenth of a millimetre on a metre.
const SHAPE_TOLERANCE: f64 = 1e-4;
/// A step that moves no coordinate farther has converged [m].
const STEP_TOLERANCE: f64 = 1e-5;

/// A tape over the cloth and the length that it must have in the refitted pattern [m].
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The tape.
    pub tape: Tape,
    /// Its length [m].
    pub length: f64,
}

/// Girths that the refit must give, beside what the carried shape asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Girths {
    /// Tapes of given length.
    pub tapes: Vec<Wanted>,
    /// How much wider than the carried shape each triangle is to be: a symmetric map in warp
    /// and weft axes, shape `[triangles]`; empty: as carried.
    pub widening: Vec<Matrix2<f64>>,
}

/// Refits `garment`'s pattern to its vertices at `target_points` [m], shape `[vertices, 3]`.
///
/// Returns panel coordinates [m], shape `[vertices, 2]`.
///
/// # Errors
/// See [`Error`].
pub fn run(garment: &Garment, target_points: &[Vec3], params: &Params) -> Result<(Vec<Vec2>, Info), Error> {
    run_with_girths(garment, target_points, params, &Girths::default())
}

/// [`run`] with girths to be met.
///
/// # Errors
/// See [`Error`].
pub fn run_with_girths(
    garment: &Garment,
    target_points: &[Vec3],
    params: &Params,
    girths: &Girths,
) -> Result<(Vec<Vec2>, Info), Error> {
    check(garment, target_points, params)?;
    let bindings = frame::bind(garment, target_points, params.fit, &girths.widening)?;
    let area: f64 = bindings.iter().map(|b| b.area).sum();
    let n = garment.points.len();
    let problem = Problem::new(garment, params, girths);
    let solved = problem.factored(&bindings)?;
    let demands = problem.demands(&energy::positions(&solved.free, n));
    let bent = problem.bend(&solved, &demands)?;
    let (mut unknowns, outcome) = problem.spread(target_points, &bindings, &solved.free, bent, &demands)?;

    let crumpled: Vec<u32> = (0..bindings.len()).filter(|&t| bindings[t].clamped).map(|t| t as u32).collect();
    let layout = energy::positions(&unknowns, n);
    let mut pattern = tidy::tidy(garment, &problem.border, &crumpled, layout, params.tidy)?;
    let repaired = tidy::repair(garment, &problem.border, &mut pattern)?;

    for (v, p) in pattern.iter().enumerate() {
        (unknowns[v], unknowns[n + v]) = (p.x, p.y);
    }
    let change = frame::strain_change(garment, &pattern, target_points, [0.5, 0.99])?;
    let info = Info {
        iterations: outcome.iterations,
        residual: solved.residual,
        converged: problem.obeys(&outcome),
        length_residual: outcome.excess.length,
        shape_residual: outcome.excess.shape,
        step_residual_m: outcome.step,
        bounds_held: outcome.active,
        energy: solved.form.value(&unknowns) / area,
        energy_free: solved.form.value(&solved.free) / area,
        strain_change_p50: change[0],
        strain_change_p99: change[1],
        seam_mismatch_max: chain::chains_mismatch(&problem.chains, &garment.pattern, &pattern),
        chains: problem.chains.len(),
        flipped_triangles: tidy::flipped(garment, &pattern).len(),
        crumpled_triangles: crumpled.len(),
        shape: Shape::new(garment, &problem.runs, &pattern),
        area_ratio: pattern_area(garment, &pattern) / pattern_area(garment, &garment.pattern),
        repaired,
    };
    Ok((pattern, info))
}

/// A refit before anything is solved.
struct Problem<'a> {
    garment: &'a Garment,
    params: &'a Params,
    girths: &'a Girths,
    runs: Runs,
    outline: Outline,
    chains: Vec<Chain>,
    border: Vec<bool>,
}

/// An energy with its factor and its unconstrained minimum.
struct Factored {
    form: energy::Quadratic,
    factor: SparseCholesky,
    free: Vec<f64>,
    /// Norm of the gradient at the minimum over that of the right side.
    residual: f64,
}

impl<'a> Problem<'a> {
    fn new(garment: &'a Garment, params: &'a Params, girths: &'a Girths) -> Self {
        let runs = Runs::new(garment);
        let outline = Outline::new(garment, &runs);
        let (chains, border) = (garment.chains(), tidy::border(garment));
        Problem { garment, params, girths, runs, outline, chains, border }
    }

    fn factored(&self, bindings: &[Binding]) -> Result<Factored, Error> {
        let weights = Weights {
            outline: self.params.outline_weight,
            straight: self.params.straight_weight,
            anchor: self.params.anchor_weight,
        };
        let form = energy::assemble(self.garment, bindings, &self.outline, weights);
        let factor = SparseCholesky::new(form.right.len(), &form.matrix)?;
        let mut free = form.right.clone();
        factor.solve(&mut free);
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let residual = norm(&form.gradient(&free)) / norm(&form.right);
        Ok(Factored { form, factor, free, residual })
    }

    /// What the layout must obey; `free` is the one that obeys nothing.
    fn demands(&self, free: &[Vec2]) -> Demands<'_> {
        let demands = Demands {
            original: &self.garment.pattern,
            chains: &self.chains,
            tapes: &self.girths.tapes,
            runs: &self.runs,
            mirrored: if self.params.mirror { self.runs.mirrored.clone() } else { Vec::new() },
            corner: self.params.corner_bound.to_radians(),
            straight: self.params.straight_bound,
        };
        demands.without_lopsided(free)
    }

    fn stop(&self) -> Stop {
        Stop {
            iterations: self.params.seam_iterations,
            length: self.params.seam_tolerance,
            shape: SHAPE_TOLERANCE,
            step: STEP_TOLERANCE,
        }
    }

    fn obeys(&self, outcome: &Outcome) -> bool {
        let stop = self.stop();
        outcome.excess.length <= stop.length && outcome.excess.shape <= stop.shape
    }

    fn bend(&self, energy: &Factored, demands: &Demands<'_>) -> Result<(Vec<f64>, Outcome), Error> {
        let spoken = spoken(&self.border, &self.girths.tapes);
        Bounded::new(&energy.factor, &energy.free, &spoken).solve(demands, self.stop())
    }
}

/// [`run`], and once more where a girth is held: the refit as carried says how far off it is.
///
/// # Errors
/// See [`Error`].
pub fn run_holding(
    garment: &Garment,
    target_points: &[Vec3],
    params: &Params,
    holding: Option<&Holding<'_>>,
) -> Result<(Vec<Vec2>, Info), Error> {
    let carried = run(garment, target_points, params)?;
    let girths = holding.map(|h| h.girths(garment, target_points, &carried.0)).unwrap_or_default();
    if girths.tapes.is_empty() {
        Ok(carried)
    } else {
        run_with_girths(garment, target_points, params, &girths)
    }
}

/// The vertices that demands speak about: the border, and what tapes cross.
fn spoken(border: &[bool], tapes: &[Wanted]) -> Vec<bool> {
    let mut spoken = border.to_vec();
    for point in tapes.iter().flat_map(|wanted| wanted.tape.segments.iter().flatten()) {
        spoken[point.a as usize] = true;
        spoken[point.b as usize] = true;
    }
    spoken
}

fn check(garment: &Garment, target: &[Vec3], params: &Params) -> Result<(), Error> {
    let name = || garment.path.clone();
    if target.len() != garment.points.len() {
        return Err(Error::Length { garment: name(), found: target.len(), expected: garment.points.len() });
    }
    if let Some(element) = target.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { garment: name(), element });
    }
    for (t, tri) in garment.triangles.iter().enumerate() {
        let [a, b, c] = tri.map(|v| target[v as usize]);
        if (b - a).cross(&(c - a)).norm() == 0.0 {
            return Err(Error::Degenerate { garment: name(), element: t, space: "3D on the target" });
        }
    }
    params.check()
}

/// Area of all triangles in `pattern` [m^2].
pub fn pattern_area(garment: &Garment, pattern: &[Vec2]) -> f64 {
    (0..garment.triangles.len())
        .map(|t| {
            let [a, b, c] = garment.pattern_corners(pattern, t);
            0.5 * (b - a).perp(&(c - a)).abs()
        })
        .sum()
}
