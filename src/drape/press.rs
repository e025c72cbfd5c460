//! Folds that a transfer squeezed or spread are pressed out before the cloth settles.
//!
//! A garment that was fitted to another body starts with its source's folds, at lengths that the
//! cloth would not choose there. Quasi-static steps buckle such cloth at once, at wavelengths as
//! short as its mesh lets it, and rest in the nearest equilibrium: crumples. So settling starts with
//! a second bending stiffness, many times the cloth's own and about the start's shape without its
//! shorter folds, that fades as the steps grow to their longest (continuation in the stiffness).
//! Folds come back only where they are still needed, the longest first, and a hood keeps its shape.
//! The last steps, which alone count as converged, are the cloth's own.
//!
//! Folds that came through unchanged are the author's: how much stiffer the start is depends on how
//! far edges have left their lengths on the source. On its own body nothing is pressed.

use super::FRAME;
use super::cloth::Cloth;
use super::phases::LONGEST_STEP;
use crate::model::{Garment, Vec3};

/// Median change of the edges' lengths from which on the cloth is pressed in full.
const CHANGED: f64 = 0.05;
/// Standard deviation of the smoothing that leaves shorter folds out [m]: of folds 8 cm long half
/// remains, of 4 cm a sixteenth.
const SMOOTHED: f64 = 0.015;
/// Most passes of the smoothing, for meshes finer than what it smooths.
const MOST_PASSES: usize = 100;

/// How a garment is pressed.
pub(super) struct Press {
    /// How many times stiffer than the cloth the start is.
    pub first: f64,
    /// Nodes of each triangle.
    triangles: Vec<[u32; 3]>,
    passes: usize,
}

impl Press {
    /// `most` times stiffer where half of the edges have changed by [`CHANGED`] or more.
    pub fn new(cloth: &Cloth, garment: &Garment, start: &[Vec3], most: f64) -> Press {
        let area = cloth.areas.iter().sum::<f64>() / cloth.areas.len().max(1) as f64;
        let edge_squared = 4.0 / 3.0_f64.sqrt() * area; // of an equilateral triangle
        // A pass goes half-way to the mean of the neighbours: a quarter of an edge squared.
        let passes = (4.0 * SMOOTHED * SMOOTHED / edge_squared).ceil() as usize;
        Press {
            first: most.powf((median_change(garment, start) / CHANGED).min(1.0)),
            triangles: (0..cloth.triangles.len()).map(|t| cloth.nodes(t)).collect(),
            passes: passes.min(MOST_PASSES),
        }
    }

    /// How many times stiffer the cloth is in a step of `h` seconds.
    pub fn at(&self, h: f64) -> f64 {
        self.first.powf(((LONGEST_STEP / h).ln() / (LONGEST_STEP / FRAME).ln()).clamp(0.0, 1.0))
    }

    /// Node positions without the shorter folds.
    pub fn smoothed(&self, x: &[Vec3]) -> Vec<Vec3> {
        let mut x = x.to_vec();
        for _ in 0..self.passes {
            let mut sums = vec![(Vec3::zeros(), 0.0); x.len()];
            for &[a, b, c] in &self.triangles {
                for [i, j] in [[a, b], [b, c], [c, a], [b, a], [c, b], [a, c]] {
                    let (sum, count) = &mut sums[i as usize];
                    *sum += x[j as usize];
                    *count += 1.0;
                }
            }
            for (x, (sum, count)) in x.iter_mut().zip(sums).filter(|(_, (_, count))| *count > 0.0) {
                *x = 0.5 * (*x + sum / count);
            }
        }
        x
    }
}

/// Median change of the edges' lengths from the source to the start, over the source's.
fn median_change(garment: &Garment, start: &[Vec3]) -> f64 {
    let length = |points: &[Vec3], a: u32, b: u32| (points[a as usize] - points[b as usize]).norm();
    let mut changes: Vec<f64> = garment
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| (length(&garment.points, a, b), length(start, a, b)))
        .filter(|(source, _)| *source > 0.0)
        .map(|(source, start)| (start / source - 1.0).abs())
        .collect();
    if changes.is_empty() {
        return 0.0;
    }
    let middle = changes.len() / 2;
    *changes.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::elastic::tests::{Split, cloth_of, flat, garment_of, panel};
    use crate::model::{Fabric, Vec2};

    fn press(place: impl Fn(&Vec2) -> Vec3, start: impl Fn(&Vec3) -> Vec3) -> (Garment, Press) {
        let garment = garment_of(&panel(40, 8, 0.01, Split::Diagonal, 0.0), &Fabric::default(), place);
        let start: Vec<Vec3> = garment.points.iter().map(start).collect();
        let press = Press::new(&cloth_of(&garment), &garment, &start, 64.0);
        (garment, press)
    }

    #[test]
    fn only_what_has_changed_is_pressed() {
        let first = |s: f64| press(flat, |p| p * s).1.first;
        assert_eq!(first(1.0), 1.0);
        assert!((first(1.025) - 8.0).abs() < 1e-9);
        assert_eq!(first(0.5), 64.0);
    }

    #[test]
    fn the_longest_step_is_the_cloths_own() {
        let (_, press) = press(flat, |p| p * 0.5);
        assert!((press.at(FRAME) - 64.0).abs() < 1e-9);
        assert!(press.at(0.2) > 1.0 && press.at(0.2) < 64.0);
        assert_eq!(press.at(LONGEST_STEP), 1.0);
    }

    #[test]
    fn short_folds_are_left_out_and_long_ones_kept() {
        // Height of what is left of a corrugation, in the middle of the sheet.
        let left = |wavelength: f64| {
            let wave =
                move |p: &Vec2| Vec3::new(p.x, 1e-3 * (std::f64::consts::TAU * p.x / wavelength).cos(), p.y);
            let (garment, press) = press(wave, |p| *p);
            let smoothed = press.smoothed(&garment.groups.node_points(&garment.points));
            let middle = |v: &&Vec3| (v.x - 0.2).abs() < 0.05 && (v.z - 0.04).abs() < 0.005;
            smoothed.iter().filter(middle).map(|v| v.y.abs()).fold(0.0, f64::max) / 1e-3
        };
        assert!(left(0.04) < 0.15, "{}", left(0.04));
        assert!((left(0.08) - 0.5).abs() < 0.15, "{}", left(0.08));
        assert!(left(0.2) > 0.8, "{}", left(0.2));
    }
}
