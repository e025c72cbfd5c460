//! Weights where the search found nothing: the smoothest extension over the cloth
//! [Abdrashitov 2023].
//!
//! With the cotangent Laplacian `L` and lumped areas `M`, each joint's weights minimise
//! `w^T L M^-1 L w` with the known ones held; the result is clamped to be non-negative and
//! normalised to sum to 1.

use super::cloth::Cloth;
use super::table::Table;
use crate::solve::cholesky::{CholeskyError, SparseCholesky, SymmetricTriplets};

/// Fills in the rows that are not known; every piece of cloth has at least one that is.
pub(super) fn run(cloth: &Cloth, known: &[bool], table: &mut Table) -> Result<(), CholeskyError> {
    let unknown: Vec<u32> = (0..cloth.len() as u32).filter(|&n| !known[n as usize]).collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let mut unknown_of = vec![usize::MAX; cloth.len()];
    unknown.iter().enumerate().for_each(|(u, &n)| unknown_of[n as usize] = u);
    let (size, width) = (unknown.len(), table.width());
    let mut matrix = SymmetricTriplets::default();
    let mut right = vec![0.0; size * width];
    let mut held = vec![0.0; width];
    for n in 0..cloth.len() {
        let around = cloth.around(n);
        let is_unknown = |m: usize| unknown_of[m] != usize::MAX;
        if !is_unknown(n) && !around.iter().any(|e| is_unknown(e.node as usize)) {
            continue;
        }
        let diagonal = (n, around.iter().map(|e| e.cotangent).sum());
        let row = around.iter().map(|e| (e.node as usize, -e.cotangent)).chain([diagonal]);
        let mut inner: Vec<(usize, f64)> = Vec::with_capacity(around.len() + 1);
        held.fill(0.0);
        for (m, l) in row {
            if is_unknown(m) {
                inner.push((unknown_of[m], l));
            } else {
                held.iter_mut().zip(table.row(m)).for_each(|(h, w)| *h += l * w);
            }
        }
        let scale = 1.0 / cloth.areas[n];
        matrix.add_outer(scale, &inner);
        for (c, h) in held.iter().enumerate().filter(|h| *h.1 != 0.0) {
            inner.iter().for_each(|&(u, l)| right[c * size + u] -= scale * l * h);
        }
    }
    SparseCholesky::new(size, &matrix)?.solve(&mut right);
    table.take_columns(&unknown, &right);
    Ok(())
}
