//! The quasi-Newton history of a minimisation.

use crate::model::Vec3;
use crate::solve::host_cg::dot;

/// Iterations that the history remembers.
const MEMORY: usize = 5;

/// Changes of position and gradient in a step's last iterations, for the two loops of L-BFGS
/// [Nocedal and Wright 2006, alg. 7.4] around the Newton solve [Liu et al. 2017].
///
/// The projected matrix lacks the curvature that buckled cloth loses, which leaves Newton
/// with a slow linear tail; the history puts it back.
#[derive(Default)]
pub(super) struct History {
    pairs: std::collections::VecDeque<(Vec<Vec3>, Vec<Vec3>, f64)>,
}

fn add(a: &mut [Vec3], b: &[Vec3], factor: f64) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b * factor);
}

impl History {
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    pub fn clear(&mut self) {
        self.pairs.clear();
    }

    /// Remembers a step, if the curvature along it is positive.
    pub fn push(&mut self, x0: &[Vec3], x1: &[Vec3], g0: &[Vec3], g1: &[Vec3]) {
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
    pub fn before(&self, mut gradient: Vec<Vec3>) -> (Vec<Vec3>, Vec<f64>) {
        let mut weights = vec![0.0; self.pairs.len()];
        for (i, (s, y, curvature)) in self.pairs.iter().enumerate().rev() {
            weights[i] = dot(s, &gradient) / curvature;
            add(&mut gradient, y, -weights[i]);
        }
        (gradient, weights)
    }

    /// The direction from the solve's.
    pub fn after(&self, mut direction: Vec<Vec3>, weights: &[f64]) -> Vec<Vec3> {
        for ((s, y, curvature), w) in self.pairs.iter().zip(weights) {
            let b = dot(y, &direction) / curvature;
            add(&mut direction, s, -(w + b));
        }
        direction
    }
}
