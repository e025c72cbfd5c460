//! A quadratic programme in the few weights of one node.

/// Exchanges of weight for each joint.
const EXCHANGES: usize = 2;
/// A smaller gain is none [m^2].
const NOTHING: f64 = 1e-12;

/// Lowers `w^T form w - 2 pull . w`, `w >= 0`, with the sum kept: weight goes from the joint where that
/// gains the most to the one that gains the most by it.
pub(super) fn exchange(form: &[f64], pull: &[f64], weights: &mut [f64]) {
    let count = weights.len();
    let at = |a: usize, b: usize| form[a * count + b];
    let slope = |a: usize| weights.iter().enumerate().map(|(b, w)| at(a, b) * w).sum::<f64>() - pull[a];
    let mut slopes: Vec<f64> = (0..count).map(slope).collect();
    for _ in 0..EXCHANGES * count {
        let lowest = (0..count).min_by(|&a, &b| slopes[a].total_cmp(&slopes[b]));
        let giving = (0..count).filter(|&a| weights[a] > 0.0);
        let highest = giving.max_by(|&a, &b| slopes[a].total_cmp(&slopes[b]));
        let (Some(to), Some(from)) = (lowest, highest) else { return };
        let (gain, curvature) = (slopes[from] - slopes[to], at(to, to) + at(from, from) - 2.0 * at(to, from));
        if gain <= 0.0 || gain * gain <= NOTHING * curvature {
            return;
        }
        let moved = if curvature > 0.0 { (gain / curvature).min(weights[from]) } else { weights[from] };
        weights[to] += moved;
        weights[from] -= moved;
        slopes.iter_mut().enumerate().for_each(|(a, s)| *s += moved * (at(a, to) - at(a, from)));
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::rig::influences;

    #[test]
    fn exchanges_end_at_the_least_value() {
        let unit = |i: usize, k: usize| ((i * 7 + k) as f64 * 0.754_877).fract();
        for case in 0..40 {
            let a = DMatrix::from_fn(8, 6, |r, c| unit(case * 8 + r, c) - 0.5);
            let form = a.transpose() * &a + DMatrix::identity(6, 6) * 0.05;
            let pull = DVector::from_fn(6, |k, _| unit(k, case) - 0.5);
            let value = |w: &DVector<f64>| w.dot(&(&form * w)) - 2.0 * pull.dot(w);
            let even = DVector::from_element(6, 1.0 / 6.0);
            let least = value(&influences::fit(&form, &pull, &even, (0..6).collect()));
            let mut weights = vec![1.0 / 6.0; 6];
            let mut last = value(&even);
            for _ in 0..20 {
                exchange(form.as_slice(), pull.as_slice(), &mut weights);
                let now = value(&DVector::from_column_slice(&weights));
                assert!(now <= last + 1e-12, "case {case}: {now} after {last}");
                last = now;
            }
            assert!(weights.iter().all(|&w| w >= 0.0));
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            // What drops the most negative weight is not always the least, exchanges are.
            assert!(last <= least + 1e-6, "case {case}: {last}, fitted {least}");
        }
    }
}
