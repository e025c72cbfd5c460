//! Weights where the search found nothing: the smoothest extension over the cloth
//! [Abdrashitov 2023].
//!
//! With the cotangent Laplacian `L` and lumped areas `M`, each joint's weights minimise
//! `w^T L M^-1 L w` with the known ones held; the result is clamped to be non-negative and
//! normalised to sum to 1.

use super::Weights;
use crate::model::TriMesh;
use crate::solve::cholesky::{CholeskyError, SparseCholesky, SymmetricTriplets};

/// Smallest share of the mean area that a point counts with: slivers would stiffen all.
const LEAST_AREA: f64 = 1e-3;
/// Cotangents beyond this are those of slivers.
const MOST_COTANGENT: f64 = 50.0;

/// Fills in the weights that are `None`; every piece of cloth has at least one that is not.
pub(super) fn run(cloth: &TriMesh, known: Vec<Option<Weights>>) -> Result<Vec<Weights>, CholeskyError> {
    let mut unknown_of = vec![usize::MAX; known.len()];
    let unknown: Vec<usize> = (0..known.len()).filter(|&n| known[n].is_none()).collect();
    unknown.iter().enumerate().for_each(|(u, &n)| unknown_of[n] = u);
    if unknown.is_empty() {
        return Ok(known.into_iter().flatten().collect());
    }
    let rows = laplacian(cloth);
    let areas = cloth.point_areas();
    let least = LEAST_AREA * areas.iter().sum::<f64>() / areas.len() as f64;
    let mut joints: Vec<u32> = known.iter().flatten().flatten().map(|w| w.0).collect();
    joints.sort_unstable();
    joints.dedup();

    let size = unknown.len();
    let mut matrix = SymmetricTriplets::default();
    let mut right = vec![0.0; size * joints.len()];
    for (n, row) in rows.iter().enumerate() {
        let inner: Vec<(usize, f64)> =
            row.iter().filter(|e| unknown_of[e.0] != usize::MAX).map(|e| (unknown_of[e.0], e.1)).collect();
        if inner.is_empty() {
            continue;
        }
        let scale = 1.0 / areas[n].max(least);
        matrix.add_outer(scale, &inner);
        for &(m, l) in row {
            for &(joint, w) in known[m].iter().flatten() {
                let column = joints.binary_search(&joint).unwrap_or(0);
                for &(u, lu) in &inner {
                    right[column * size + u] -= scale * lu * l * w;
                }
            }
        }
    }
    SparseCholesky::new(size, &matrix)?.solve(&mut right);

    let fill = |u: usize| {
        let raw: Vec<f64> = (0..joints.len()).map(|j| right[j * size + u].max(0.0)).collect();
        let sum: f64 = raw.iter().sum();
        let weights = joints.iter().zip(raw).map(|(&joint, w)| (joint, w / sum));
        weights.filter(|w| w.1 > 0.0).collect::<Weights>()
    };
    Ok(known.into_iter().enumerate().map(|(n, w)| w.unwrap_or_else(|| fill(unknown_of[n]))).collect())
}

/// Rows of the cotangent Laplacian, each with its diagonal: (column, value), ascending.
fn laplacian(cloth: &TriMesh) -> Vec<Vec<(usize, f64)>> {
    let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); cloth.points.len()];
    for (t, tri) in cloth.triangles.iter().enumerate() {
        let p = cloth.corners(t);
        for k in 0..3 {
            let (i, j) = (tri[(k + 1) % 3] as usize, tri[(k + 2) % 3] as usize);
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let half = 0.5
                * (a.dot(&b) / a.cross(&b).norm().max(f64::MIN_POSITIVE))
                    .clamp(-MOST_COTANGENT, MOST_COTANGENT);
            for (r, c) in [(i, j), (j, i)] {
                rows[r].push((r, half));
                rows[r].push((c, -half));
            }
        }
    }
    for row in &mut rows {
        row.sort_by_key(|e| e.0);
        row.dedup_by(|b, a| {
            a.0 == b.0 && {
                a.1 += b.1;
                true
            }
        });
    }
    rows
}
