//! Strain that demands cost is spread over more triangles, where it falls on few.
//!
//! Least squares put the strain of a bound where it is cheapest as a whole: next to the corner or
//! the run that asks for it. Iteratively reweighted least squares [Lawson 1961] bring the largest
//! changes down, for a little more of the middle ones.

use super::bounded::Outcome;
use super::demand::Demands;
use super::energy::positions;
use super::frame::{self, Binding};
use super::{Error, Problem};
use crate::model::Vec3;

/// The 99th percentile of the strain change may exceed that of the layout without demands by this
/// factor before anything is done.
const COSTLY: f64 = 1.35;
/// Most further solves.
const SOLVES: usize = 3;
/// A triangle's change counts for at most this many times the 99th percentile.
const HEAVIEST: f64 = 2.0;

impl Problem<'_> {
    /// Solves `bent` again with more weight on the triangles whose strain changed most, as long as
    /// that lowers the 99th percentile of the change and all demands are met. `free` is the layout
    /// that obeys nothing.
    pub(super) fn spread(
        &self,
        target: &[Vec3],
        bindings: &[Binding],
        free: &[f64],
        mut bent: (Vec<f64>, Outcome),
        demands: &Demands<'_>,
    ) -> Result<(Vec<f64>, Outcome), Error> {
        let n = self.garment.points.len();
        let changes = |u: &[f64]| frame::strain_changes(self.garment, &positions(u, n), target);
        let p99 = |changes: &[(f64, f64)]| frame::percentiles(changes.to_vec(), [0.99])[0];
        let costly = COSTLY * p99(&changes(free)?);
        let mut now = changes(&bent.0)?;
        let mut heavier = bindings.to_vec();
        for _ in 0..SOLVES {
            let worst = p99(&now);
            if worst <= costly {
                break;
            }
            for (binding, (change, _)) in heavier.iter_mut().zip(&now) {
                binding.area *= 1.0 + (change / worst).min(HEAVIEST).powi(2);
            }
            let next = self.bend(&self.factored(&heavier)?, demands)?;
            let then = changes(&next.0)?;
            if p99(&then) >= worst || !self.obeys(&next.1) {
                break;
            }
            (bent, now) = (next, then);
        }
        Ok(bent)
    }
}
