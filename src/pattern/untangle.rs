//! Foldover-free relaxation [Garanzha et al. 2021, Foldover-free maps in 50 lines of code].
//!
//! With `J` the map from the original triangle (scaled to the layout's mean size) to the
//! layout and `D = det J`, minimises over the movable vertices
//!
//! `sum_t A_t ((1 - theta) |J|^2 + theta (D^2 + 1)) / chi(D)`,
//! `chi(D) = (D + sqrt(eps^2 + D^2)) / 2`
//!
//! with `eps` lowered to zero as the smallest determinant rises: finite where triangles are
//! turned over, a barrier against it in the end. Limited-memory BFGS with backtracking.

use std::collections::VecDeque;

use nalgebra::{DVector, Matrix2};

use super::frame::edges_2d;
use crate::model::{Garment, Vec2};

/// Share of the volume term, as in the paper's code.
const THETA: f64 = 1.0 / 128.0;
/// Updates of `eps`.
const OUTER: usize = 40;
/// Quasi-Newton steps for each.
const INNER: usize = 60;
/// Pairs that the quasi-Newton matrix remembers.
const MEMORY: usize = 8;
/// Determinant from which a layout is taken for upright: ten times what counts as flat.
const UPRIGHT: f64 = 1e-2;

struct Element {
    vertices: [u32; 3],
    gradients: [Vec2; 3],
    area: f64,
}

struct Problem {
    elements: Vec<Element>,
    /// Movable vertices.
    vertices: Vec<u32>,
    /// Place of each vertex among the movable ones, or `usize::MAX`.
    place: Vec<usize>,
}

/// Moves the vertices marked in `movable` until no triangle that they touch is turned over,
/// or the iterations are spent: the caller counts.
pub fn untangle(garment: &Garment, movable: &[bool], pattern: &mut [Vec2]) {
    let problem = Problem::new(garment, movable, pattern);
    if problem.vertices.is_empty() || problem.elements.is_empty() {
        return;
    }
    for outer in 0..OUTER {
        let least = problem.least_determinant(pattern);
        if outer > 0 && least > UPRIGHT {
            break;
        }
        let eps = (1e-12 + 0.04 * least.min(0.0).powi(2)).sqrt();
        if !problem.minimise(pattern, eps) && least > 0.0 {
            break;
        }
    }
}

impl Problem {
    fn new(garment: &Garment, movable: &[bool], pattern: &[Vec2]) -> Problem {
        let mut place = vec![usize::MAX; movable.len()];
        let mut vertices = Vec::new();
        for v in (0..movable.len()).filter(|&v| movable[v]) {
            place[v] = vertices.len();
            vertices.push(v as u32);
        }
        let touched: Vec<usize> = (0..garment.triangles.len())
            .filter(|&t| garment.triangles[t].iter().any(|&v| movable[v as usize]))
            .collect();
        let rest = |t: usize| edges_2d(garment.pattern_corners(&garment.pattern, t));
        let now = |t: usize| edges_2d(garment.pattern_corners(pattern, t)).determinant().abs();
        let (new, old): (f64, f64) =
            touched.iter().fold((0.0, 0.0), |(n, o), &t| (n + now(t), o + rest(t).determinant().abs()));
        let scale = (new / old).sqrt();
        let elements = touched
            .into_iter()
            .filter_map(|t| {
                let rest = rest(t) * scale;
                let m = rest.try_inverse()?;
                let (g1, g2) = (m.row(0).transpose(), m.row(1).transpose());
                let area = 0.5 * rest.determinant().abs();
                Some(Element { vertices: garment.triangles[t], gradients: [-(g1 + g2), g1, g2], area })
            })
            .collect();
        Problem { elements, vertices, place }
    }

    fn least_determinant(&self, pattern: &[Vec2]) -> f64 {
        self.elements.iter().map(|e| e.jacobian(pattern).determinant()).fold(f64::INFINITY, f64::min)
    }

    fn energy(&self, pattern: &[Vec2], eps: f64, gradient: Option<&mut DVector<f64>>) -> f64 {
        let mut sum = 0.0;
        let mut gradient = gradient;
        if let Some(g) = gradient.as_deref_mut() {
            g.fill(0.0);
        }
        for e in &self.elements {
            let j = e.jacobian(pattern);
            let d = j.determinant();
            let root = (eps * eps + d * d).sqrt();
            // (d + root) / 2 without cancellation where d < 0.
            let chi = if d >= 0.0 { 0.5 * (d + root) } else { 0.5 * eps * eps / (root - d) };
            let numerator = (1.0 - THETA) * j.norm_squared() + THETA * (d * d + 1.0);
            sum += e.area * numerator / chi;
            let Some(g) = gradient.as_deref_mut() else { continue };
            let chi_slope = chi / root; // (1 + d / root) / 2
            let cofactor = Matrix2::new(j[(1, 1)], -j[(1, 0)], -j[(0, 1)], j[(0, 0)]);
            let slope = j * (2.0 * (1.0 - THETA) / chi)
                + cofactor * (2.0 * THETA * d / chi - numerator * chi_slope / (chi * chi));
            for (v, hat) in e.vertices.iter().zip(&e.gradients) {
                let at = self.place[*v as usize];
                if at != usize::MAX {
                    let force = slope * hat * e.area;
                    g[2 * at] += force.x;
                    g[2 * at + 1] += force.y;
                }
            }
        }
        sum
    }

    /// Quasi-Newton descent for one `eps`; says whether anything moved.
    fn minimise(&self, pattern: &mut [Vec2], eps: f64) -> bool {
        let size = 2 * self.vertices.len();
        let mut gradient = DVector::zeros(size);
        let mut value = self.energy(pattern, eps, Some(&mut gradient));
        let mut memory: VecDeque<(DVector<f64>, DVector<f64>)> = VecDeque::new();
        let mut moved = false;
        for _ in 0..INNER {
            let mut direction = -two_loop(&memory, &gradient);
            if direction.dot(&gradient) >= 0.0 {
                memory.clear();
                direction = -&gradient;
            }
            let slope = direction.dot(&gradient);
            let mut step = 1.0;
            let accepted = (0..60).find_map(|_| {
                let trial = self.moved(pattern, &direction, step);
                let new = self.energy(&trial, eps, None);
                if new.is_finite() && new <= value + 1e-4 * step * slope {
                    return Some((trial, new));
                }
                step *= 0.5;
                None
            });
            let Some((trial, new)) = accepted else { break };
            let before = gradient.clone();
            pattern.copy_from_slice(&trial);
            self.energy(pattern, eps, Some(&mut gradient));
            memory.push_back((direction * step, &gradient - before));
            if memory.len() > MEMORY {
                memory.pop_front();
            }
            moved = true;
            let gain = value - new;
            value = new;
            if gain <= 1e-7 * value {
                break;
            }
        }
        moved
    }

    fn moved(&self, pattern: &[Vec2], direction: &DVector<f64>, step: f64) -> Vec<Vec2> {
        let mut trial = pattern.to_vec();
        for (k, &v) in self.vertices.iter().enumerate() {
            trial[v as usize] += Vec2::new(direction[2 * k], direction[2 * k + 1]) * step;
        }
        trial
    }
}

impl Element {
    fn jacobian(&self, pattern: &[Vec2]) -> Matrix2<f64> {
        let mut j = Matrix2::zeros();
        for (v, g) in self.vertices.iter().zip(&self.gradients) {
            j += pattern[*v as usize] * g.transpose();
        }
        j
    }
}

/// The inverse quasi-Newton matrix times the gradient [Nocedal and Wright, algorithm 7.4].
fn two_loop(memory: &VecDeque<(DVector<f64>, DVector<f64>)>, gradient: &DVector<f64>) -> DVector<f64> {
    let usable: Vec<_> = memory.iter().filter(|(s, y)| s.dot(y) > 0.0).collect();
    let mut q = gradient.clone();
    let mut alphas = Vec::new();
    for (s, y) in usable.iter().rev() {
        let alpha = s.dot(&q) / s.dot(y);
        q -= y * alpha;
        alphas.push(alpha);
    }
    if let Some((s, y)) = usable.last() {
        q *= s.dot(y) / y.dot(y);
    }
    for ((s, y), alpha) in usable.iter().zip(alphas.iter().rev()) {
        let beta = y.dot(&q) / s.dot(y);
        q += s * (alpha - beta);
    }
    q
}
