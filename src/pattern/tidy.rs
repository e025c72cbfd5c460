//! The Dirichlet tidy-up (paper section 4.2.4) and what keeps every triangle upright.
//!
//! With the outline pinned, inner vertices minimise the Dirichlet energy whose Laplacian is
//! computed on the original pattern: a crumpled transfer leaves no trace inside, and an
//! unchanged outline gives the original inside back. The price is strain: the inside forgets
//! what its triangles want, and over a bust or a seat that is a lot (measured over our pairs,
//! the 99th percentile of the change of stretch rises from about 0.1 to about 0.3). So by
//! default only the surroundings of crumpled or flipped triangles are tidied up.
//!
//! Cotangent weights are negative across obtuse pairs and an outline need not be convex, so a
//! triangle may still flip. Whatever is flipped is dealt with in order, each step's success
//! being a count of zero:
//!
//! 1. the same system around the flips with weights clamped to positive ones;
//! 2. foldover-free relaxation ([`super::untangle`]) of inner vertices near the flips;
//! 3. the same with the outline near them free as well;
//! 4. the least blend towards the original pattern, scaled, at which nothing is flipped.

use std::collections::BTreeMap;

use super::untangle::untangle;
use super::{Error, Repair, Tidy};
use crate::model::{Garment, Vec2};
use crate::solve::cholesky::{SparseCholesky, SymmetricTriplets};

/// A triangle counts as flipped below this part of its original area (relative to the whole
/// pattern's change): what has lost all but a thousandth of its area is not cloth.
const SMALLEST_AREA: f64 = 1e-3;

/// Least weight of an edge relative to the mean when weights are clamped.
const LEAST_WEIGHT: f64 = 1e-2;

/// Rings of triangles around a crumpled one that are tidied up with it.
const RINGS: usize = 3;

/// Halvings in the search for the least blend.
const BLEND_STEPS: usize = 12;

/// Signed double area over the original's, for triangle `t`.
pub fn area_ratio(garment: &Garment, pattern: &[Vec2], t: usize) -> f64 {
    let double = |p: &[Vec2]| {
        let [a, b, c] = garment.pattern_corners(p, t);
        (b - a).perp(&(c - a))
    };
    double(pattern) / double(&garment.pattern)
}

/// Triangles of `pattern` that are turned over, or flat.
pub fn flipped(garment: &Garment, pattern: &[Vec2]) -> Vec<u32> {
    // A NaN counts as flipped.
    (0..garment.triangles.len())
        .filter(|&t| {
            area_ratio(garment, pattern, t).partial_cmp(&SMALLEST_AREA) != Some(std::cmp::Ordering::Greater)
        })
        .map(|t| t as u32)
        .collect()
}

/// Moves inner vertices of `pattern` to the minimum of the Dirichlet energy.
///
/// # Errors
/// [`Error::Solve`] if the Laplacian cannot be factored.
pub fn dirichlet(
    garment: &Garment,
    pinned: &[bool],
    pattern: &[Vec2],
    positive: bool,
) -> Result<Vec<Vec2>, Error> {
    let mut unknown = vec![usize::MAX; pinned.len()];
    let mut count = 0;
    for v in 0..pinned.len() {
        if !pinned[v] {
            unknown[v] = count;
            count += 1;
        }
    }
    let mut matrix = SymmetricTriplets::default();
    let mut right = vec![0.0; 2 * count];
    for ([i, j], weight) in cotangent_weights(garment, positive) {
        for (v, w) in [(i as usize, j as usize), (j as usize, i as usize)] {
            if pinned[v] {
                continue;
            }
            matrix.add(unknown[v], unknown[v], weight);
            if pinned[w] {
                right[unknown[v]] += weight * pattern[w].x;
                right[count + unknown[v]] += weight * pattern[w].y;
            } else if v < w {
                matrix.add(unknown[v], unknown[w], -weight);
            }
        }
    }
    SparseCholesky::new(count, &matrix)?.solve(&mut right);
    Ok((0..pinned.len())
        .map(|v| match pinned[v] {
            true => pattern[v],
            false => Vec2::new(right[unknown[v]], right[count + unknown[v]]),
        })
        .collect())
}

/// Half the sum of cotangents opposite each edge, on the original pattern.
fn cotangent_weights(garment: &Garment, positive: bool) -> BTreeMap<[u32; 2], f64> {
    let mut weights = BTreeMap::new();
    for (t, tri) in garment.triangles.iter().enumerate() {
        let p = garment.pattern_corners(&garment.pattern, t);
        for k in 0..3 {
            let (e, f) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let (i, j) = (tri[(k + 1) % 3], tri[(k + 2) % 3]);
            *weights.entry([i.min(j), i.max(j)]).or_insert(0.0) += 0.5 * e.dot(&f) / e.perp(&f).abs();
        }
    }
    if positive {
        weights.values_mut().for_each(|w| *w = w.max(LEAST_WEIGHT));
    }
    weights
}

/// Border vertices.
pub fn border(garment: &Garment) -> Vec<bool> {
    let mut on_border = vec![false; garment.points.len()];
    for v in garment.border_edges().into_iter().flatten() {
        on_border[v as usize] = true;
    }
    on_border
}

/// Tidies inner vertices up, all or those near the triangles marked in `crumpled` and near
/// flipped ones.
///
/// # Errors
/// [`Error::Solve`] if the Laplacian cannot be factored.
pub fn tidy(
    garment: &Garment,
    on_border: &[bool],
    crumpled: &[u32],
    pattern: Vec<Vec2>,
    how: Tidy,
) -> Result<Vec<Vec2>, Error> {
    match how {
        Tidy::Never => Ok(pattern),
        Tidy::All => dirichlet(garment, on_border, &pattern, false),
        Tidy::Crumpled => {
            let wrong = [crumpled, &flipped(garment, &pattern)].concat();
            let movable = near(garment, &wrong, RINGS, |v| !on_border[v as usize]);
            if !movable.contains(&true) {
                return Ok(pattern);
            }
            let tidied = dirichlet(garment, &not(&movable), &pattern, false)?;
            let better = flipped(garment, &tidied).len() <= flipped(garment, &pattern).len();
            Ok(if better { tidied } else { pattern })
        }
    }
}

fn not(mask: &[bool]) -> Vec<bool> {
    mask.iter().map(|m| !m).collect()
}

/// Leaves no flipped triangle in `pattern`; says what it took.
///
/// # Errors
/// [`Error::Solve`] from the clamped Laplacian.
pub fn repair(garment: &Garment, pinned: &[bool], pattern: &mut Vec<Vec2>) -> Result<Repair, Error> {
    if flipped(garment, pattern).is_empty() {
        return Ok(Repair::None);
    }
    let movable = near(garment, &flipped(garment, pattern), RINGS, |v| !pinned[v as usize]);
    let clamped = dirichlet(garment, &not(&movable), pattern, true)?;
    if flipped(garment, &clamped).len() < flipped(garment, pattern).len() {
        *pattern = clamped;
        if flipped(garment, pattern).is_empty() {
            return Ok(Repair::ClampedWeights);
        }
    }
    for (free_border, repair) in [(false, Repair::Inside), (true, Repair::Outline)] {
        for rings in [3, 8] {
            let wrong = flipped(garment, pattern);
            let movable = near(garment, &wrong, rings, |v| free_border || !pinned[v as usize]);
            let mut trial = pattern.clone();
            untangle(garment, &movable, &mut trial);
            if flipped(garment, &trial).is_empty() {
                *pattern = trial;
                return Ok(repair);
            }
        }
    }
    blend(garment, pattern);
    Ok(Repair::Blend)
}

/// Vertices within `rings` of the given triangles that pass `allowed`.
fn near(garment: &Garment, triangles: &[u32], rings: usize, allowed: impl Fn(u32) -> bool) -> Vec<bool> {
    let mut reached = vec![false; garment.points.len()];
    for &t in triangles {
        garment.triangles[t as usize].iter().for_each(|&v| reached[v as usize] = true);
    }
    for _ in 1..rings {
        let before = reached.clone();
        for tri in &garment.triangles {
            if tri.iter().any(|&v| before[v as usize]) {
                tri.iter().for_each(|&v| reached[v as usize] = true);
            }
        }
    }
    (0..reached.len()).map(|v| reached[v] && allowed(v as u32)).collect()
}

/// The least blend with the original pattern, scaled to the same area about its mean.
fn blend(garment: &Garment, pattern: &mut [Vec2]) {
    let areas = |p: &[Vec2]| -> f64 {
        (0..garment.triangles.len())
            .map(|t| {
                let [a, b, c] = garment.pattern_corners(p, t);
                (b - a).perp(&(c - a)).abs()
            })
            .sum()
    };
    let mean = |p: &[Vec2]| p.iter().sum::<Vec2>() / p.len() as f64;
    let scale = (areas(pattern) / areas(&garment.pattern)).sqrt();
    let scale = if scale.is_finite() && scale > 0.0 { scale } else { 1.0 };
    let (from, to) = (mean(&garment.pattern), mean(pattern));
    let upright: Vec<Vec2> = garment.pattern.iter().map(|p| to + (p - from) * scale).collect();
    let start = pattern.to_vec();
    let mix =
        |s: f64| -> Vec<Vec2> { start.iter().zip(&upright).map(|(p, q)| p * (1.0 - s) + q * s).collect() };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BLEND_STEPS {
        let middle = 0.5 * (low + high);
        if flipped(garment, &mix(middle)).is_empty() { high = middle } else { low = middle }
    }
    // At a blend of one the layout is the original, scaled: upright by construction.
    pattern.copy_from_slice(&if high < 1.0 { mix(high) } else { upright.clone() });
}
