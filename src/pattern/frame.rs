//! Tangent frames, polar decompositions and bindings (paper section 4.2.1 and 4.2.2).
//!
//! A triangle's tangent frame `F = E M` (3x2) carries the pattern's unit warp and weft to
//! space: `E` holds the two edge vectors in space and `M` is the inverse of the two edge
//! vectors in the pattern. `F = R S` with `R` orthonormal and `S` symmetric positive.
//! On the target body the frame wanted is `R_target S_ref` (the source's stretch), and it is
//! bound to the triangle by `B = pinv(E_target) R_target S_ref`. Since
//! `pinv(E_target) = M S_target^-1 R_target^T`, that is `B = M S_target^-1 S_ref`, which
//! needs no pseudo-inverse. For any layout with edges `P` (2x2), `P B` is the image of that
//! frame in the pattern; the wanted layout makes it the identity.

use nalgebra::{Matrix2, Matrix3x2};

use super::{Error, Fit};
use crate::model::{Garment, Vec2, Vec3};

/// Below this stretch a target triangle counts as crumpled: its frame is no longer followed
/// to the letter, or its binding would outweigh the whole panel. Transfer alone compresses
/// cloth to about half on the worst pairs seen (grown man to child).
pub const SMALLEST_STRETCH: f64 = 0.1;

/// A pattern triangle's area below this part of its longest edge squared has no frame.
const SMALLEST_ASPECT: f64 = 1e-9;

/// What one triangle wants.
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Gradients of the three corners' hat functions: `F = sum_v x_v g_v^T` [1/m].
    pub gradients: [Vec2; 3],
    /// Area of the triangle in the pattern that the binding asks for [m^2].
    pub area: f64,
    /// Whether the target triangle was crumpled below [`SMALLEST_STRETCH`].
    pub clamped: bool,
}

/// The pattern's edge vectors as columns.
pub fn edges_2d(p: [Vec2; 3]) -> Matrix2<f64> {
    Matrix2::from_columns(&[p[1] - p[0], p[2] - p[0]])
}

/// The edge vectors in space as columns.
pub fn edges_3d(p: [Vec3; 3]) -> Matrix3x2<f64> {
    Matrix3x2::from_columns(&[p[1] - p[0], p[2] - p[0]])
}

/// The symmetric positive factor of the polar decomposition of a 3x2 frame:
/// `S = sqrt(F^T F)`, in closed form `(C + sqrt(det C) I) / sqrt(tr C + 2 sqrt(det C))`.
pub fn stretch(frame: &Matrix3x2<f64>) -> Matrix2<f64> {
    let c = frame.transpose() * frame;
    // |f0 x f1| has none of the cancellation of det C.
    let s = frame.column(0).cross(&frame.column(1)).norm();
    let t = (c.trace() + 2.0 * s).sqrt();
    if t > 0.0 { (c + Matrix2::identity() * s) / t } else { Matrix2::zeros() }
}

/// Raises the eigenvalues of a symmetric matrix to at least `least`; says whether any moved.
fn raise_eigenvalues(s: &Matrix2<f64>, least: f64) -> (Matrix2<f64>, bool) {
    let eigen = s.symmetric_eigen();
    if eigen.eigenvalues.min() >= least {
        return (*s, false);
    }
    let raised = eigen.eigenvalues.map(|l| l.max(least));
    let q = eigen.eigenvectors;
    (q * Matrix2::from_diagonal(&raised) * q.transpose(), true)
}

/// The stretch `S` of every triangle with its vertices at `points`, against `pattern`.
///
/// # Errors
/// [`Error::Degenerate`] if a triangle has no area in its panel.
pub fn stretches(garment: &Garment, pattern: &[Vec2], points: &[Vec3]) -> Result<Vec<Matrix2<f64>>, Error> {
    (0..garment.triangles.len())
        .map(|t| {
            let rest = edges_2d(garment.pattern_corners(pattern, t));
            let size = rest.norm_squared();
            let inverse = (rest.determinant().abs() > SMALLEST_ASPECT * size)
                .then(|| rest.try_inverse())
                .flatten()
                .ok_or_else(|| degenerate(garment, t, "its panel"))?;
            let corners = garment.triangles[t].map(|v| points[v as usize]);
            Ok(stretch(&(edges_3d(corners) * inverse)))
        })
        .collect()
}

fn degenerate(garment: &Garment, element: usize, space: &'static str) -> Error {
    Error::Degenerate { garment: garment.path.clone(), element, space }
}

/// The bindings of all triangles for a garment carried to `target`, each made wider by its
/// `widening` (shape `[triangles]`, or empty).
///
/// # Errors
/// [`Error::Degenerate`] if a triangle has no area in its panel, or none on the source while
/// its stretch is wanted.
pub fn bind(
    garment: &Garment,
    target: &[Vec3],
    fit: Fit,
    widening: &[Matrix2<f64>],
) -> Result<Vec<Binding>, Error> {
    let source = stretches(garment, &garment.pattern, &garment.points)?;
    let carried = stretches(garment, &garment.pattern, target)?;
    (0..garment.triangles.len())
        .map(|t| {
            let rest = edges_2d(garment.pattern_corners(&garment.pattern, t));
            let (s_target, clamped) = raise_eigenvalues(&carried[t], SMALLEST_STRETCH);
            let s_ref = match fit {
                Fit::Keep if source[t].determinant() > 0.0 => source[t],
                Fit::Keep => return Err(degenerate(garment, t, "3D")),
                Fit::Loose => Matrix2::identity(),
            };
            let (s_ref, _) = raise_eigenvalues(&s_ref, SMALLEST_STRETCH);
            // P = S_ref^-1 S_target P_0, so B = P^-1 = P_0^-1 S_target^-1 S_ref.
            let mut wanted =
                s_ref.try_inverse().ok_or_else(|| degenerate(garment, t, "3D"))? * s_target * rest;
            if let Some(widening) = widening.get(t) {
                wanted = widening * wanted;
            }
            let b = wanted.try_inverse().ok_or_else(|| degenerate(garment, t, "3D"))?;
            let (g1, g2) = (b.row(0).transpose(), b.row(1).transpose());
            let area = 0.5 * wanted.determinant().abs();
            Ok(Binding { gradients: [-(g1 + g2), g1, g2], area, clamped })
        })
        .collect()
}

/// Percentiles of values with weights.
pub fn percentiles<const N: usize>(mut values: Vec<(f64, f64)>, at: [f64; N]) -> [f64; N] {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|c| c.1).sum();
    at.map(|p| {
        let mut sum = 0.0;
        let found = values.iter().find(|(_, weight)| {
            sum += weight;
            sum >= p * total
        });
        found.or(values.last()).map_or(0.0, |c| c.0)
    })
}

/// Change of stretch of each triangle, `max |S_target - S_source|` over the entries in warp and
/// weft axes, and its area: the source garment against its original pattern, the garment at
/// `target` against `pattern`. The area is the original pattern's.
///
/// # Errors
/// [`Error::Degenerate`] if a triangle has no area in its panel.
pub fn strain_changes(
    garment: &Garment,
    pattern: &[Vec2],
    target: &[Vec3],
) -> Result<Vec<(f64, f64)>, Error> {
    let source = stretches(garment, &garment.pattern, &garment.points)?;
    let carried = stretches(garment, pattern, target)?;
    let change = |t: usize| {
        let area = edges_2d(garment.pattern_corners(&garment.pattern, t)).determinant().abs();
        ((carried[t] - source[t]).amax(), area)
    };
    Ok((0..source.len()).map(change).collect())
}

/// Percentiles by area of [`strain_changes`].
///
/// # Errors
/// As [`strain_changes`].
pub fn strain_change<const N: usize>(
    garment: &Garment,
    pattern: &[Vec2],
    target: &[Vec3],
    at: [f64; N],
) -> Result<[f64; N], Error> {
    Ok(percentiles(strain_changes(garment, pattern, target)?, at))
}
