//! Evens the weights out, the more the farther the cloth is from the skin.
//!
//! Where the nearest skin jumps from one limb to another, so do the matched weights. Cloth on
//! the skin must follow it to the millimetre; cloth that hangs 5 cm away need not. So with the
//! clearance `d` of each node the final weights `w` minimise, for each joint,
//!
//! `integral c |w - w0|^2 + s^2 |grad w|^2`,  `c = (g / d)^3` within bounds,
//!
//! which is one linear system `(c M + s^2 L) w = c M w0` for all joints. Cotangents are
//! bounded below by zero, so its matrix is an M-matrix with constants in its kernel's place:
//! what comes out is a weighted mean of what went in, so it cannot be negative and sums to 1.
//!
//! On a coarse mesh a few edges keep a jump all the same (skin-tight cloth across a crease of the
//! body). The ends of those are averaged with their neighbours until no jump is left or the
//! rounds are spent.

use super::cloth::Cloth;
use super::table::Table;
use crate::solve::cholesky::{CholeskyError, SparseCholesky, SymmetricTriplets};

/// Bounds of `c`: above the first the cloth counts as skin-tight, the second is for cloth whose
/// skin is unknown.
const TIGHTEST: f64 = 80.0;
const LOOSEST: f64 = 0.02;
/// Of `g / d`. With 2 close cloth is smoothed too far and sinks into the posed body.
const POWER: i32 = 3;

/// Rounds of averaging the ends of edges with a jump.
pub(super) const ROUNDS: usize = 30;

/// `clearance`: distance from the skin of each node that was matched, infinite for others [m].
pub(super) fn run(
    cloth: &Cloth,
    clearance: &[f64],
    gap: f64,
    reach: f64,
    table: &mut Table,
) -> Result<(), CholeskyError> {
    let (size, width) = (cloth.len(), table.width());
    if reach == 0.0 || width < 2 {
        return Ok(());
    }
    let pull = |n: usize| (gap / clearance[n]).powi(POWER).clamp(LOOSEST, TIGHTEST);
    let mut right = vec![0.0; size * width];
    for n in 0..size {
        let pull = pull(n) * cloth.areas[n];
        table.row(n).iter().enumerate().for_each(|(c, w)| right[c * size + n] = pull * w);
    }
    screened(cloth, pull, reach)?.solve(&mut right);
    let all: Vec<u32> = (0..size as u32).collect();
    table.take_columns(&all, &right);
    Ok(())
}

/// The factor of `c M + reach^2 L`.
fn screened(cloth: &Cloth, pull: impl Fn(usize) -> f64, reach: f64) -> Result<SparseCholesky, CholeskyError> {
    let mut matrix = SymmetricTriplets::default();
    for n in 0..cloth.len() {
        let mut diagonal = pull(n) * cloth.areas[n];
        for e in cloth.around(n) {
            let stiffness = reach * reach * e.cotangent.max(0.0);
            diagonal += stiffness;
            if (e.node as usize) < n {
                matrix.add(n, e.node as usize, -stiffness);
            }
        }
        matrix.add(n, n, diagonal);
    }
    SparseCholesky::new(cloth.len(), &matrix)
}

/// Averages the ends of every edge along which the weights change by more than `most` (the sum of
/// the absolute differences, 2 at most).
pub(super) fn limit_jumps(cloth: &Cloth, most: f64, table: &mut Table) {
    let jumps = |table: &Table, n: usize| {
        let jump = |m: u32| table.row(n).iter().zip(table.row(m as usize)).map(|(a, b)| (a - b).abs()).sum();
        cloth.around(n).iter().any(|e| {
            let jump: f64 = jump(e.node);
            jump > most
        })
    };
    let mut suspects: Vec<usize> = (0..cloth.len()).collect();
    for _ in 0..ROUNDS {
        suspects.retain(|&n| jumps(table, n));
        if suspects.is_empty() {
            return;
        }
        let averaged: Vec<Vec<f64>> = suspects.iter().map(|&n| average(cloth, table, n)).collect();
        suspects.iter().zip(averaged).for_each(|(&n, row)| table.row_mut(n).copy_from_slice(&row));
        // What a change can disturb lies next to it.
        let around = suspects.iter().flat_map(|&n| cloth.around(n).iter().map(|e| e.node as usize));
        let next: std::collections::BTreeSet<usize> = around.chain(suspects.iter().copied()).collect();
        suspects = next.into_iter().collect();
    }
}

/// Half of a node's own weights and half of the mean of its neighbours'.
fn average(cloth: &Cloth, table: &Table, node: usize) -> Vec<f64> {
    let around = cloth.around(node);
    let mut row: Vec<f64> = table.row(node).iter().map(|w| 0.5 * w).collect();
    for e in around {
        let share = 0.5 / around.len() as f64;
        row.iter_mut().zip(table.row(e.node as usize)).for_each(|(r, w)| *r += share * w);
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{SeamGroups, TriMesh, Vec3};
    use crate::rig::Sewn;

    /// A strip of squares of 1 cm, wide enough to have inner nodes.
    fn strip(length: usize) -> TriMesh {
        let at = |i: usize, j: usize| (i * 4 + j) as u32;
        let mut mesh = TriMesh::default();
        for i in 0..=length {
            for j in 0..4 {
                mesh.points.push(Vec3::new(i as f64 * 0.01, j as f64 * 0.01, 0.0));
                if i > 0 && j > 0 {
                    let (a, b, c, d) = (at(i - 1, j - 1), at(i, j - 1), at(i, j), at(i - 1, j));
                    mesh.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        mesh
    }

    fn smoothed(clearance: f64) -> (TriMesh, Table) {
        let mesh = strip(60);
        let groups = SeamGroups::new(mesh.points.len(), &[], &[]);
        let cloth = Cloth::new(&Sewn {
            points: &mesh.points,
            triangles: &mesh.triangles,
            groups: &groups,
            joints: &[],
        });
        let side = |p: &Vec3| Some(vec![(u32::from(p.x > 0.3), 1.0)]);
        let mut table = Table::new(&mesh.points.iter().map(side).collect::<Vec<_>>(), 2);
        run(&cloth, &vec![clearance; cloth.len()], 0.01, 0.03, &mut table).expect("solves");
        (mesh, table)
    }

    /// A step decays as exp(-x / l) with l = s / sqrt(c) = reach * (clearance / gap)^(3/2).
    #[test]
    fn a_step_is_spread_the_more_the_farther_the_skin_is() {
        for clearance in [0.01, 0.015, 0.02] {
            let (mesh, table) = smoothed(clearance);
            let length = 0.03 * f64::powf(clearance / 0.01, 1.5);
            for (n, p) in mesh.points.iter().enumerate().filter(|(_, p)| (p.x - 0.305).abs() < 0.1) {
                let x = p.x - 0.305;
                let exact = 0.5 * (-x.abs() / length).exp();
                let exact = if x > 0.0 { 1.0 - exact } else { exact };
                let found = table.row(n)[1];
                assert!((found - exact).abs() < 0.01, "{clearance} at {x}: {found} not {exact}");
            }
        }
    }

    #[test]
    fn what_comes_out_is_a_weighted_mean_of_what_went_in() {
        let (_, table) = smoothed(0.02);
        for row in table.values.chunks(2) {
            assert!(row.iter().all(|&w| (0.0..=1.0).contains(&w)));
            assert!((row[0] + row[1] - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn no_edge_keeps_a_jump() {
        let (mesh, mut table) = smoothed(0.001);
        let groups = SeamGroups::new(mesh.points.len(), &[], &[]);
        let cloth = Cloth::new(&Sewn {
            points: &mesh.points,
            triangles: &mesh.triangles,
            groups: &groups,
            joints: &[],
        });
        let largest = |table: &Table| {
            let edges =
                (0..cloth.len()).flat_map(|n| cloth.around(n).iter().map(move |e| (n, e.node as usize)));
            edges.map(|(a, b)| 2.0 * (table.row(a)[1] - table.row(b)[1]).abs()).fold(0.0, f64::max)
        };
        assert!(largest(&table) > 1.0);
        limit_jumps(&cloth, 0.6, &mut table);
        assert!(largest(&table) <= 0.6 + 1e-12, "{}", largest(&table));
        assert!(table.values.chunks(2).all(|row| (row[0] + row[1] - 1.0).abs() < 1e-12));
    }
}
