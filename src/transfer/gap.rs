//! How far the moved body is from its target.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::model::Vec3;

/// Distances between corresponding points, weighted by area [m].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Largest.
    pub max: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Mean.
    pub mean: f64,
}

impl Gap {
    /// Of the points with a positive weight.
    pub fn measure(points: &[Vec3], targets: &[Vec3], weights: &[f64]) -> Gap {
        let mut distances: Vec<(f64, f64)> = points
            .iter()
            .zip(targets)
            .zip(weights)
            .filter(|(_, w)| **w > 0.0)
            .map(|((p, q), w)| ((p - q).norm(), *w))
            .collect();
        distances.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f64 = distances.iter().map(|d| d.1).sum();
        let Some(&(max, _)) = distances.last() else {
            return Gap::default();
        };
        let mut below = 0.0;
        let p99 = distances.iter().find(|d| {
            below += d.1;
            below >= 0.99 * total
        });
        let mean = distances.iter().map(|d| d.0 * d.1).sum::<f64>() / total;
        Gap { max, p99: p99.map_or(max, |d| d.0), mean }
    }
}

/// Whether each of `points` lies within `distance` [m] of any of `others`.
pub fn near(points: &[Vec3], others: &[Vec3], distance: f64) -> Vec<bool> {
    let bin = |p: &Vec3| (p / distance).map(|c| c.floor() as i64);
    let mut bins: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (i, p) in others.iter().enumerate() {
        bins.entry(bin(p).into()).or_default().push(i as u32);
    }
    let is_near = |p: &Vec3| {
        let [i, j, k]: [i64; 3] = bin(p).into();
        (0..27).any(|o| {
            let around = bins.get(&[i + o / 9 - 1, j + o / 3 % 3 - 1, k + o % 3 - 1]);
            around.is_some_and(|ids| ids.iter().any(|&q| (others[q as usize] - p).norm() <= distance))
        })
    };
    points.par_iter().map(is_near).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_weigh_by_area() {
        let points: Vec<Vec3> = (0..100).map(|i| Vec3::new(f64::from(i), 0.0, 0.0)).collect();
        let targets = vec![Vec3::zeros(); 100];
        let mut weights = vec![1.0; 100];
        let gap = Gap::measure(&points, &targets, &weights);
        assert_eq!((gap.max, gap.p99, gap.mean), (99.0, 98.0, 49.5));
        weights[99] = 2.0;
        assert_eq!(Gap::measure(&points, &targets, &weights).p99, 99.0);
        weights[99] = 0.0;
        assert_eq!(Gap::measure(&points, &targets, &weights).max, 98.0);
    }

    #[test]
    fn near_points_are_found_across_bins() {
        let others = [Vec3::new(0.079, 0.0, 0.0)];
        let points = [Vec3::new(0.081, 0.0, 0.0), Vec3::new(0.16, 0.0, 0.0), Vec3::new(-0.002, 0.0, 0.0)];
        assert_eq!(near(&points, &others, 0.08), [true, false, false]);
    }
}
