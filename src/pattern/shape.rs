//! What became of the outline and of the grain, measured on the result.

use serde::{Deserialize, Serialize};

use super::frame::edges_2d;
use super::runs::Runs;
use crate::model::{Garment, Vec2};

/// How well the refitted panels kept the shape of the original ones.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Largest deviation of an originally straight run from its chord, over the chord's length.
    pub straight_deviation_max: f64,
    /// Largest change of a corner's angle [degrees].
    pub corner_change_max_deg: f64,
    /// Largest distance between the corners of panels that mirrored one another, laid on each
    /// other mirrored [m].
    pub mirror_distance_max_m: f64,
    /// Largest turn of a panel's grain, averaged over the panel's area [degrees].
    pub grain_turn_max_deg: f64,
}

impl Shape {
    /// Measures `pattern` against the garment's original pattern.
    pub fn new(garment: &Garment, runs: &Runs, pattern: &[Vec2]) -> Shape {
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, b| a.max(b.abs()));
        let straight = runs.runs.iter().filter(|run| run.straight);
        let corners = runs.corners.iter();
        Shape {
            straight_deviation_max: largest(&mut straight.map(|run| run.deviation(pattern).1)),
            corner_change_max_deg: largest(&mut corners.map(|c| c.turned(&garment.pattern, pattern)))
                .to_degrees(),
            mirror_distance_max_m: mirror_distance(runs, pattern),
            grain_turn_max_deg: largest(&mut grain_turns(garment, pattern).into_iter()).to_degrees(),
        }
    }
}

impl Shape {
    /// The larger of each figure of two parts of a garment.
    pub fn worst(&self, other: &Shape) -> Shape {
        Shape {
            straight_deviation_max: self.straight_deviation_max.max(other.straight_deviation_max),
            corner_change_max_deg: self.corner_change_max_deg.max(other.corner_change_max_deg),
            mirror_distance_max_m: self.mirror_distance_max_m.max(other.mirror_distance_max_m),
            grain_turn_max_deg: self.grain_turn_max_deg.max(other.grain_turn_max_deg),
        }
    }
}

/// Mirrored runs grouped by their two panels, each group laid on its image by its mean.
fn mirror_distance(runs: &Runs, pattern: &[Vec2]) -> f64 {
    let mut groups: std::collections::BTreeMap<[u32; 2], Vec<[Vec2; 2]>> = Default::default();
    for &[r, s] in &runs.mirrored {
        let (run, other) = (&runs.runs[r], &runs.runs[s]);
        let (p, q) = (&run.vertices, &other.vertices);
        for (v, w) in [(p[0], q[q.len() - 1]), (p[p.len() - 1], q[0])] {
            let (at, image) = (pattern[v as usize], pattern[w as usize]);
            groups.entry([run.panel, other.panel]).or_default().push([at, Vec2::new(image.x, -image.y)]);
        }
    }
    let distance = |pairs: &Vec<[Vec2; 2]>| {
        let mean = pairs.iter().map(|[a, b]| a - b).sum::<Vec2>() / pairs.len() as f64;
        pairs.iter().map(|[a, b]| (a - b - mean).norm()).fold(0.0, f64::max)
    };
    groups.values().map(distance).fold(0.0, f64::max)
}

/// The turn of each panel's grain [rad]: of the rotation from original to refitted triangle,
/// the mean over area.
fn grain_turns(garment: &Garment, pattern: &[Vec2]) -> Vec<f64> {
    let mut sums = vec![Vec2::zeros(); garment.panels.len()];
    for t in 0..garment.triangles.len() {
        let rest = edges_2d(garment.pattern_corners(&garment.pattern, t));
        let Some(inverse) = rest.try_inverse() else { continue };
        let map = edges_2d(garment.pattern_corners(pattern, t)) * inverse;
        let turn = Vec2::new(map[(0, 0)] + map[(1, 1)], map[(1, 0)] - map[(0, 1)]);
        let weight = rest.determinant().abs();
        sums[garment.panel_of_triangle[t] as usize] +=
            turn.try_normalize(0.0).unwrap_or_else(Vec2::zeros) * weight;
    }
    sums.iter().map(|s| s.y.atan2(s.x)).collect()
}
