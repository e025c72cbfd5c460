//! The minimum of the energy under its demands.
//!
//! With the energy's matrix `A` factored once, unconstrained minimum `u_0` and rows `C` with
//! intervals, the minimum is `u = u_0 - A^-1 C^T mu` with multipliers from the small dense
//! matrix `K = C A^-1 C^T`: those of equations are free, those of bounds push inwards only
//! (primal-dual active set [Hintermueller, Ito, Kunisch 2003]). Lengths and angles are not
//! linear, so the rows are taken again at the new layout and the step repeated. Their slopes
//! change little after the first steps: the responses `A^-1 c` are then kept, and only values
//! are renewed, which still ends exactly on the demands.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::demand::{Demands, Excess, Key, Row};
use super::energy::positions;
use crate::solve::cholesky::SparseCholesky;

/// Compliance of the demands over the diagonal of their matrix: far below the tolerance on
/// lengths, far above rounding, so that demands that say the same twice are fine.
const COMPLIANCE: f64 = 1e-10;
/// Steps in which slopes are taken anew.
const FRESH: usize = 2;
/// Changes of the active set in one step.
const CHANGES: usize = 50;
/// Responses solved for at a time.
const BATCH: usize = 32;

/// What the iteration did.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Steps.
    pub iterations: usize,
    /// By how much the result misses its demands.
    pub excess: Excess,
    /// Largest move of a coordinate in the last step [m].
    pub step: f64,
    /// Bounds that hold the result.
    pub active: usize,
}

/// When the iteration ends.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Most steps.
    pub iterations: usize,
    /// Relative error of lengths that is good enough.
    pub length: f64,
    /// Excess over a bound that is good enough.
    pub shape: f64,
    /// Move of a coordinate that is small enough [m].
    pub step: f64,
}

/// A slope with its response, on the unknowns that demands speak about.
struct Slope {
    coefficients: Vec<(usize, f64)>,
    response: Vec<f64>,
}

/// The energy's minimum, ready to be bent to demands.
pub struct Bounded<'a> {
    factor: &'a SparseCholesky,
    free: &'a [f64],
    /// Number of vertices: the first unknowns are their coordinates.
    vertices: usize,
    /// Place of an unknown among those that demands speak about, or `usize::MAX`.
    slot: Vec<usize>,
    /// Number of such unknowns.
    slots: usize,
    slopes: BTreeMap<Key, Slope>,
}

impl<'a> Bounded<'a> {
    /// From the factored matrix and the unconstrained minimum `free`; `spoken` marks the
    /// vertices that demands may speak about.
    pub fn new(factor: &'a SparseCholesky, free: &'a [f64], spoken: &[bool]) -> Self {
        let mut slots = 0;
        let slot = spoken.iter().chain(spoken).map(|spoken| {
            slots += usize::from(*spoken);
            if *spoken { slots - 1 } else { usize::MAX }
        });
        let slot = slot.collect();
        Bounded { factor, free, vertices: spoken.len(), slot, slots, slopes: BTreeMap::new() }
    }

    /// The unknowns that obey `demands` at the least energy, or the best met.
    ///
    /// # Errors
    /// [`Error::Constraint`] if the equations contradict one another.
    pub fn solve(&mut self, demands: &Demands<'_>, stop: Stop) -> Result<(Vec<f64>, Outcome), Error> {
        let n = self.vertices;
        let mut unknowns = self.free.to_vec();
        let mut outcome = Outcome { excess: demands.excess(&positions(&unknowns, n)), ..Outcome::default() };
        let mut best = (unknowns.clone(), outcome);
        let mut active = BTreeSet::new();
        for k in 1..=stop.iterations {
            let rows = demands.rows(&positions(&unknowns, n), &active);
            if rows.is_empty() {
                break;
            }
            let (next, held) = self.step(&rows, &unknowns, k <= FRESH)?;
            let moved =
                (next[..2 * n].iter().zip(&unknowns)).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
            unknowns = next;
            active = held;
            let excess = demands.excess(&positions(&unknowns, n));
            outcome = Outcome { iterations: k, excess, step: moved, active: active.len() };
            let miss = |e: &Excess| (e.length / stop.length).max(e.shape / stop.shape).max(1.0);
            if miss(&excess) <= miss(&best.1.excess) {
                best = (unknowns.clone(), outcome);
            }
            if miss(&excess) <= 1.0 && moved <= stop.step {
                break;
            }
        }
        best.1.iterations = outcome.iterations;
        Ok(best)
    }

    /// One step about `layout`; says which bounds hold it.
    fn step(
        &mut self,
        rows: &[Row],
        layout: &[f64],
        fresh: bool,
    ) -> Result<(Vec<f64>, BTreeSet<Key>), Error> {
        self.respond(rows, fresh);
        let slopes: Vec<&Slope> = rows.iter().map(|row| &self.slopes[&row.key]).collect();
        let mut compliance = DMatrix::from_fn(rows.len(), rows.len(), |i, j| {
            slopes[i].coefficients.iter().map(|(at, c)| c * slopes[j].response[self.slot[*at]]).sum::<f64>()
        });
        for i in 0..rows.len() {
            compliance[(i, i)] *= 1.0 + COMPLIANCE;
        }
        // Values at the unconstrained minimum, by the linear view of this layout.
        let values = DVector::from_iterator(
            rows.len(),
            rows.iter().zip(&slopes).map(|(row, slope)| {
                let shift = slope.coefficients.iter().map(|&(i, c)| c * (self.free[i] - layout[i]));
                row.value + shift.sum::<f64>()
            }),
        );
        let multipliers = active_set(&compliance, &values, rows)?;
        let mut change = vec![0.0; self.free.len()];
        for (slope, mu) in slopes.iter().zip(multipliers.iter()) {
            slope.coefficients.iter().for_each(|&(i, c)| change[i] += mu * c);
        }
        self.factor.solve(&mut change);
        let unknowns = self.free.iter().zip(&change).map(|(u, c)| u - c).collect();
        let held = rows.iter().zip(multipliers.iter());
        let held = held.filter(|(row, mu)| row.low < row.high && **mu != 0.0).map(|(row, _)| row.key);
        Ok((unknowns, held.collect()))
    }

    /// Sees to it that every row has a slope and its response.
    fn respond(&mut self, rows: &[Row], fresh: bool) {
        if fresh {
            self.slopes.clear();
        }
        let missing: Vec<&Row> = rows.iter().filter(|row| !self.slopes.contains_key(&row.key)).collect();
        let size = self.free.len();
        for batch in missing.chunks(BATCH) {
            let mut columns = vec![0.0; size * batch.len()];
            for (row, column) in batch.iter().zip(columns.chunks_exact_mut(size)) {
                row.coefficients.iter().for_each(|&(i, c)| column[i] += c);
            }
            self.factor.solve(&mut columns);
            for (row, column) in batch.iter().zip(columns.chunks_exact(size)) {
                let mut response = vec![0.0; self.slots];
                let spoken = self.slot.iter().zip(column).filter(|(at, _)| **at != usize::MAX);
                spoken.for_each(|(&at, &value)| response[at] = value);
                self.slopes.insert(row.key, Slope { coefficients: row.coefficients.clone(), response });
            }
        }
    }
}

/// Multipliers `mu` with `values - K mu` in every row's interval, zero where a bound is slack.
fn active_set(k: &DMatrix<f64>, values: &DVector<f64>, rows: &[Row]) -> Result<DVector<f64>, Error> {
    /// Where a row stands: off, or held at its low or high end.
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        Off,
        Low,
        High,
    }
    let equation = |i: usize| rows[i].low == rows[i].high;
    let mut state: Vec<State> =
        (0..rows.len()).map(|i| if equation(i) { State::High } else { State::Off }).collect();
    let mut multipliers = DVector::zeros(rows.len());
    for _ in 0..CHANGES {
        let held: Vec<usize> = (0..rows.len()).filter(|&i| state[i] != State::Off).collect();
        multipliers.fill(0.0);
        if !held.is_empty() {
            let small = k.select_rows(&held).select_columns(&held);
            let wanted = |i: usize| if state[i] == State::Low { rows[i].low } else { rows[i].high };
            let gap = DVector::from_iterator(held.len(), held.iter().map(|&i| values[i] - wanted(i)));
            let solved = small.cholesky().ok_or(Error::Constraint { chains: held.len() })?.solve(&gap);
            held.iter().zip(solved.iter()).for_each(|(&i, mu)| multipliers[i] = *mu);
        }
        let now = values - k * &multipliers;
        let next = |i: usize| match state[i] {
            _ if equation(i) => State::High,
            State::High if multipliers[i] >= 0.0 => State::High,
            State::Low if multipliers[i] <= 0.0 => State::Low,
            State::Off if now[i] > rows[i].high => State::High,
            State::Off if now[i] < rows[i].low => State::Low,
            _ => State::Off,
        };
        let changed: Vec<State> = (0..rows.len()).map(next).collect();
        if changed == state {
            break;
        }
        state = changed;
    }
    Ok(multipliers)
}
