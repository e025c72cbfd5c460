//! Anderson's acceleration of a fixed point, type II [Anderson 1965; Walker and Ni 2011].
//!
//! The volume term is cubic in the displacement's gradient: a combination that goes too far may
//! land where every further step leads away. One that multiplies the residual is taken back, and
//! the fixed point's own step, shortened, is taken from the best iterate instead.

use nalgebra::{DMatrix, DVector};

use crate::model::Vec3;

/// Iterates that are combined.
const DEPTH: usize = 5;

/// An iterate whose residual exceeds the smallest so far by this factor is taken back.
const ASTRAY: f64 = 2.0;

/// What the last iterates teach about the next.
#[derive(Debug)]
pub struct Anderson {
    iterates: Vec<Vec<Vec3>>,
    steps: Vec<Vec<Vec3>>,
    /// The iterate of the smallest residual, and its step.
    best: (Vec<Vec3>, Vec<Vec3>),
    smallest: f64,
    /// Share of the fixed point's own step that is taken after an iterate was taken back.
    share: f64,
}

impl Default for Anderson {
    fn default() -> Self {
        let (iterates, steps, best) = Default::default();
        Anderson { iterates, steps, best, smallest: f64::INFINITY, share: 1.0 }
    }
}

impl Anderson {
    /// Moves `u`, whose residual has the norm `residual`, on by `step`, corrected by what the last
    /// iterates teach.
    pub fn advance(&mut self, u: &mut [Vec3], step: Vec<Vec3>, residual: f64) {
        if residual > ASTRAY * self.smallest {
            return self.take_back(u);
        }
        if residual < self.smallest {
            self.smallest = residual;
            self.best = (u.to_vec(), step.clone());
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

    fn take_back(&mut self, u: &mut [Vec3]) {
        self.share *= 0.5;
        self.iterates.clear();
        self.steps.clear();
        let (from, step) = &self.best;
        u.iter_mut().zip(from).zip(step).for_each(|((u, from), d)| *u = from + d * self.share);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leads_astray_is_taken_back() {
        // x -> x - f(x), f a cubic that pushes ever farther away beyond 1.
        let f = |x: f64| 0.5 * x - 3.0 * x.powi(3);
        let mut u = [Vec3::new(0.39, 0.0, 0.0)];
        let mut acceleration = Anderson::default();
        let mut taken_back = 0;
        for _ in 0..60 {
            let step = -f(u[0].x);
            let share = acceleration.share;
            acceleration.advance(&mut u, vec![Vec3::new(step, 0.0, 0.0)], step.abs());
            taken_back += i32::from(acceleration.share < share);
        }
        assert!(taken_back < 10 && f(u[0].x).abs() < 1e-9, "{taken_back} {}", u[0].x);
        // An iterate thrown far away comes back to the best one, and half its step.
        let (best, step) = acceleration.best.clone();
        acceleration.share = 1.0;
        u[0].x = 50.0;
        acceleration.advance(&mut u, vec![Vec3::zeros()], 1e3);
        assert_eq!(u[0], best[0] + step[0] * 0.5);
        assert!(acceleration.iterates.is_empty());
    }
}
