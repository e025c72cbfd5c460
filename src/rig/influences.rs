//! The few influences that move a point as all of them would.
//!
//! Let every joint in turn be turned about its own centre `c_j`, by the same angle about any
//! axis, with its children following. A point `p` then moves by `S_j (R - I)(p - c_j)`, where
//! `S_j` is the sum of its weights on the joint and all below it. Over all axes, the squared
//! error of weights `v` in the place of `w` is, up to the angle's factor, the closed form
//!
//! `E(v) = sum_j |p - c_j|^2 (S_j(w) - S_j(v))^2 = (w - v)^T H (w - v)`,
//! `H_ab = sum of |p - c_j|^2 over the joints j above (or at) both a and b`.
//!
//! So a weight is dropped where another joint can best stand in for it (its parent, mostly),
//! not because it is the smallest, and those that stay are fitted again:
//! `min E(v)`, `v >= 0`, `sum v = 1`.

use nalgebra::{DMatrix, DVector};

use super::table::Sparse;
use crate::model::{Skeleton, Vec3};

/// Weights below this share are dropped from the start.
const NEGLIGIBLE: f64 = 1e-3;
/// Angle that every joint is turned by, for an error in metres [radians].
const ANGLE: f64 = std::f64::consts::FRAC_PI_4;

/// Joint centres and who is above whom.
pub(super) struct Posed {
    centers: Vec<Vec3>,
    parents: Vec<Option<usize>>,
    depth: Vec<usize>,
}

impl Posed {
    /// A skeleton that lacks parents or bind transforms counts as unconnected joints at the
    /// origin.
    pub fn new(skeleton: &Skeleton) -> Posed {
        let count = skeleton.joints.len();
        let mut centers = skeleton.positions();
        centers.resize(count, Vec3::zeros());
        let parents: Vec<Option<usize>> = (0..count).map(|j| skeleton.parent(j)).collect();
        let depth = |j: usize| std::iter::successors(parents[j], |&p| parents[p]).take(count).count();
        let depth = (0..count).map(depth).collect();
        Posed { centers, parents, depth }
    }

    /// `H` over `joints` for a point, up to a constant that cancels.
    pub fn metric(&self, p: &Vec3, joints: &[u32]) -> DMatrix<f64> {
        let n = joints.len();
        let mut h = DMatrix::zeros(n, n);
        for a in 0..n {
            for b in 0..=a {
                let common = self.common(joints[a] as usize, joints[b] as usize);
                let chain = std::iter::successors(common, |&j| self.parents[j]).take(self.parents.len());
                let sum = chain.map(|j| (p - self.centers[j]).norm_squared()).sum();
                (h[(a, b)], h[(b, a)]) = (sum, sum);
            }
        }
        h
    }

    /// The lowest joint above or at both.
    fn common(&self, a: usize, b: usize) -> Option<usize> {
        let (mut a, mut b) = (a, b);
        while a != b {
            let lower = if self.depth[a] >= self.depth[b] { &mut a } else { &mut b };
            *lower = self.parents[*lower]?;
        }
        Some(a)
    }
}

/// A row with at most `most` influences, the largest first, and its posed error [m].
pub(super) fn cap(posed: &Posed, p: &Vec3, row: &Sparse, most: usize) -> (Sparse, f64) {
    if row.len() <= most {
        return (sorted(row.clone()), 0.0);
    }
    let joints: Vec<u32> = row.iter().map(|w| w.0).collect();
    let all = DVector::from_iterator(row.len(), row.iter().map(|w| w.1));
    let h = posed.metric(p, &joints);
    let kept = keep(&h, &all, most);
    let fitted = fit(&h, &(&h * &all), &all, kept);
    let missing = &all - &fitted;
    let error = (turn() * missing.dot(&(&h * &missing)).max(0.0)).sqrt();
    let weights = joints.into_iter().zip(fitted.iter().copied()).filter(|w| w.1 > 0.0).collect();
    (sorted(weights), error)
}

/// What the metric is multiplied with for squared metres.
pub(super) fn turn() -> f64 {
    4.0 / 3.0 * (1.0 - ANGLE.cos())
}

/// What is worth keeping of a dense row: (joint, weight) with a sum of 1.
pub(super) fn significant(joints: &[u32], row: &[f64]) -> Sparse {
    let most = row.iter().copied().fold(0.0, f64::max);
    let kept = joints.iter().zip(row).filter(|w| *w.1 >= NEGLIGIBLE * most);
    let mut weights: Sparse = kept.map(|(&j, &w)| (j, w)).collect();
    let sum: f64 = weights.iter().map(|w| w.1).sum();
    weights.iter_mut().for_each(|w| w.1 /= sum);
    weights
}

/// The largest first.
pub(super) fn sorted(mut row: Sparse) -> Sparse {
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    row
}

/// Drops one joint after the other, always the one whose weight another can take at the least
/// cost, until `most` are left.
fn keep(h: &DMatrix<f64>, all: &DVector<f64>, most: usize) -> Vec<usize> {
    let mut weight = all.clone();
    let mut kept: Vec<usize> = (0..all.len()).collect();
    while kept.len() > most {
        let heir = |&d: &usize| {
            let others = kept.iter().filter(move |&&e| e != d);
            others
                .map(|&e| (weight[d] * weight[d] * (h[(d, d)] + h[(e, e)] - 2.0 * h[(d, e)]), d, e))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let cheapest = kept.iter().filter_map(heir).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, dropped, heir)) = cheapest else { break };
        weight[heir] += weight[dropped];
        kept.retain(|&e| e != dropped);
    }
    kept
}

/// Minimises `w^T h w - 2 pull . w` over weights on `kept` alone with a sum of 1, near `all` where
/// that leaves a choice; what would be negative is dropped too.
pub(super) fn fit(
    h: &DMatrix<f64>,
    pull: &DVector<f64>,
    all: &DVector<f64>,
    mut kept: Vec<usize>,
) -> DVector<f64> {
    let ridge = 1e-9 * h.trace().max(f64::MIN_POSITIVE);
    loop {
        let n = kept.len();
        // Stationary with a multiplier for the sum.
        let mut system = DMatrix::zeros(n + 1, n + 1);
        let mut right = DVector::zeros(n + 1);
        for (r, &a) in kept.iter().enumerate() {
            for (c, &b) in kept.iter().enumerate() {
                system[(r, c)] = h[(a, b)] + if r == c { ridge } else { 0.0 };
            }
            (system[(r, n)], system[(n, r)]) = (1.0, 1.0);
            right[r] = pull[a] + ridge * all[a];
        }
        right[n] = 1.0;
        let solved = system.lu().solve(&right);
        let mut fitted = DVector::zeros(all.len());
        let Some(solved) = solved else {
            let sum: f64 = kept.iter().map(|&a| all[a]).sum();
            kept.iter().for_each(|&a| fitted[a] = all[a] / sum);
            return fitted;
        };
        let lowest = (0..n).min_by(|&a, &b| solved[a].total_cmp(&solved[b])).unwrap_or(0);
        if n > 1 && solved[lowest] < 0.0 {
            kept.remove(lowest);
            continue;
        }
        kept.iter().zip(solved.iter()).for_each(|(&a, &v)| fitted[a] = v);
        fitted /= fitted.sum();
        return fitted;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::skinning::{blend, pose_matrices, transform};
    use nalgebra::{Rotation3, Unit};

    /// A spine of four, with an arm of four and a leg of three.
    fn skeleton() -> Skeleton {
        let parents = [-1, 0, 1, 2, 3, 4, 5, 6, 0, 8, 9];
        let at = |x: f64, y: f64| {
            let mut m = [[0.0; 4]; 4];
            (0..4).for_each(|k| m[k][k] = 1.0);
            (m[0][3], m[1][3]) = (x, y);
            m
        };
        let places = [
            (0.0, 1.0),
            (0.0, 1.2),
            (0.0, 1.35),
            (0.0, 1.5),
            (0.2, 1.5),
            (0.35, 1.45),
            (0.5, 1.4),
            (0.7, 1.3),
            (0.1, 0.95),
            (0.1, 0.5),
            (0.1, 0.1),
        ];
        Skeleton {
            joints: (0..parents.len()).map(|j| format!("j{j}")).collect(),
            parents: parents.to_vec(),
            world_from_joint: places.iter().map(|&(x, y)| at(x, y)).collect(),
        }
    }

    /// Rows with seven weights, and points around the body.
    fn rows() -> Vec<(Vec3, Sparse)> {
        let unit = |i: usize, k: usize| ((i * 7 + k) as f64 * 0.754_877).fract();
        (0..60)
            .map(|i| {
                let p = Vec3::new(0.6 * unit(i, 0), 0.6 + unit(i, 1), 0.2 * unit(i, 2));
                let mut row: Sparse = (0..7).map(|k| (((i + k) % 11) as u32, 0.02 + unit(k, i))).collect();
                row.sort_by_key(|w| w.0);
                let sum: f64 = row.iter().map(|w| w.1).sum();
                row.iter_mut().for_each(|w| w.1 /= sum);
                (p, row)
            })
            .collect()
    }

    /// Mean square over axes, summed over joints, of how far the point lands from where it should.
    fn posed_error(p: &Vec3, row: &Sparse, other: &Sparse) -> f64 {
        let skeleton = skeleton();
        let count = skeleton.joints.len();
        let axes = [Vec3::x_axis(), Vec3::y_axis(), Vec3::z_axis()];
        let mut sum = 0.0;
        for j in 0..count {
            for axis in axes {
                let mut rotations = vec![Rotation3::identity(); count];
                rotations[j] = Rotation3::from_axis_angle(&Unit::new_unchecked(axis.into_inner()), ANGLE);
                let matrices = pose_matrices(&skeleton, &rotations, &Vec3::zeros()).expect("poses");
                let at = |row: &Sparse| transform(&blend(row.iter().copied(), &matrices), p);
                sum += (at(row) - at(other)).norm_squared() / 3.0;
            }
        }
        sum.sqrt()
    }

    /// |(R - I) x|^2 is a quadratic form in the axis, so the three axes give the exact mean.
    #[test]
    fn the_closed_form_is_what_posing_gives() {
        let posed = Posed::new(&skeleton());
        for (p, row) in rows() {
            for most in [1, 2, 4, 6] {
                let (few, error) = cap(&posed, &p, &row, most);
                let measured = posed_error(&p, &row, &few);
                assert!((error - measured).abs() < 1e-6, "{error} {measured}");
                assert!(few.len() <= most && few.iter().all(|w| w.1 > 0.0));
                assert!((few.iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn fitted_weights_move_the_point_better_than_the_largest() {
        let posed = Posed::new(&skeleton());
        let (mut ours, mut largest) = (0.0, 0.0);
        for (p, row) in rows() {
            let mut cut = sorted(row.clone());
            cut.truncate(4);
            let sum: f64 = cut.iter().map(|w| w.1).sum();
            cut.iter_mut().for_each(|w| w.1 /= sum);
            let error = cap(&posed, &p, &row, 4).1;
            ours += error;
            largest += posed_error(&p, &row, &cut);
        }
        assert!(ours < 0.7 * largest, "{ours} against {largest}");
    }
}
