//! Anderson's acceleration of a fixed point, type II [Anderson 1965; Walker and Ni 2011].

use nalgebra::{DMatrix, DVector};

use crate::model::Vec3;

/// Iterates that are combined.
const DEPTH: usize = 5;

/// What the last iterates teach about the next.
#[derive(Debug, Default)]
pub struct Anderson {
    iterates: Vec<Vec<Vec3>>,
    steps: Vec<Vec<Vec3>>,
}

impl Anderson {
    /// Moves `u` on by `step`, corrected by what the last iterates teach; `remember` is
    /// false for a step that is not the fixed point's own.
    pub fn advance(&mut self, u: &mut [Vec3], step: Vec<Vec3>, remember: bool) {
        if !remember {
            u.iter_mut().zip(&step).for_each(|(u, d)| *u += d);
            return;
        }
        let weights = self.weights(&step);
        let last = u.to_vec();
        for i in 0..u.len() {
            let mut next = last[i] + step[i];
            for (k, w) in weights.iter().enumerate() {
                let (from, found) = (self.iterates[k][i], self.steps[k][i]);
                next -= ((last[i] + step[i]) - (from + found)) * *w;
            }
            u[i] = next;
        }
        if self.steps.len() == DEPTH {
            self.iterates.remove(0);
            self.steps.remove(0);
        }
        self.iterates.push(last);
        self.steps.push(step);
    }

    /// Weights that make `step - sum w (step - step_k)` smallest.
    fn weights(&self, step: &[Vec3]) -> Vec<f64> {
        let n = self.steps.len();
        let difference = |k: usize, i: usize| step[i] - self.steps[k][i];
        let mut normal = DMatrix::zeros(n, n);
        let mut right = DVector::zeros(n);
        for i in 0..step.len() {
            for k in 0..n {
                let d = difference(k, i);
                right[k] += d.dot(&step[i]);
                for l in k..n {
                    normal[(k, l)] += d.dot(&difference(l, i));
                }
            }
        }
        normal.fill_lower_triangle_with_upper_triangle();
        let scale = normal.diagonal().max();
        for k in 0..n {
            normal[(k, k)] += 1e-10 * scale;
        }
        normal.cholesky().map_or_else(|| vec![0.0; n], |c| c.solve(&right).as_slice().to_vec())
    }
}
