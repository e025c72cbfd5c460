//! Lifts what cuts the skin: a garment that lay outside of its source body lies outside of the target.
//!
//! The flow keeps points out of the body, and a triangle spans what the skin between them does: over
//! a crease or a sharp ridge of the target its corners lie outside and its middle does not. Each point
//! `p(w) = sum w_i x_i` of a triangle that cuts the skin asks for
//!
//! ```text
//! n . (p(w) - closest(p)) >= CLEARANCE,        n the skin's pseudo-normal there
//! ```
//!
//! by the least change of its corners; the demands are met one after the other until all are
//! (Kaczmarz' method for inequalities [Agmon 1954]), and the cloth around goes along. What cut the
//! source's skin already is left alone, and so is all cloth if that does not leave fewer cuts and no
//! crossing of the cloth with itself that was not there.

use std::collections::HashSet;

use crate::geometry::Surface;
use crate::geometry::intersect::{mesh_intersections, self_intersections};
use crate::geometry::topology::neighbours;
use crate::model::{TriMesh, Vec3};

/// How far lifted cloth is to lie from the skin [m].
const CLEARANCE: f64 = 3e-4;
/// Rounds of demands; a round moves what was lifted into other skin out again.
const ROUNDS: usize = 12;
/// Passes over a round's demands.
const PASSES: usize = 8;
/// Rings of cloth that go along with what is lifted.
const RINGS: usize = 3;
/// Points along a triangle's edge that make demands.
const DIVISIONS: usize = 5;

/// A garment as welded cloth on the source body.
#[derive(Clone, Copy, Debug)]
pub struct Cloth<'a> {
    /// Its points on the source body [m].
    pub points: &'a [Vec3],
    /// Its triangles over points.
    pub triangles: &'a [[u32; 3]],
    /// The number of each point once sewn points are one; all that have it lie together.
    pub weld: &'a [u32],
}

/// What was lifted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lift {
    /// Pairs of triangles of cloth and skin that met, those that met on the source left out.
    pub pairs_before: usize,
    /// Those that are left.
    pub pairs: usize,
    /// Farthest that a point was lifted [m].
    pub largest_m: f64,
}

/// A demand on the corners of a triangle: `normal . sum w_i x_i >= level`.
struct Demand {
    triangle: [u32; 3],
    weights: [f64; 3],
    normal: Vec3,
    level: f64,
}

/// Lifts the points of `cloth`, carried to `points`, out of the `skin`; `source` is asked for the
/// source's skin where any of them cuts it.
pub fn clear(
    cloth: &Cloth<'_>,
    points: &mut [Vec3],
    skin: &Surface,
    source: impl FnOnce() -> Surface,
) -> Lift {
    let start = Surface::new(cloth.welded(points));
    if mesh_intersections(&start, skin).is_empty() {
        return Lift::default();
    }
    let on_source = mesh_intersections(&Surface::new(cloth.welded(cloth.points)), &source());
    let cut_before: HashSet<u32> = on_source.iter().map(|pair| pair[0]).collect();
    let cuts = |cloth: &Surface| -> Vec<[u32; 2]> {
        let new = |pair: &[u32; 2]| !cut_before.contains(&pair[0]);
        mesh_intersections(cloth, skin).into_iter().filter(new).collect()
    };
    let pairs_before = cuts(&start).len();
    let crossings = |surface: &Surface| self_intersections(surface).len();
    let Some((lifted, pairs)) =
        search(&start, skin, cuts).filter(|(lifted, _)| crossings(lifted) <= crossings(&start))
    else {
        return Lift { pairs_before, pairs: pairs_before, largest_m: 0.0 };
    };
    let moves: Vec<Vec3> =
        lifted.mesh().points.iter().zip(&start.mesh().points).map(|(p, q)| p - q).collect();
    points.iter_mut().zip(cloth.weld).for_each(|(x, &w)| *x += moves[w as usize]);
    Lift { pairs_before, pairs, largest_m: moves.iter().map(Vec3::norm).fold(0.0, f64::max) }
}

/// Round by round from `start`, where `cuts` says what is to be lifted: the surface that cuts least,
/// with the number of its cuts, if that is fewer than at the start.
fn search(
    start: &Surface,
    skin: &Surface,
    cuts: impl Fn(&Surface) -> Vec<[u32; 2]>,
) -> Option<(Surface, usize)> {
    let neighbours = neighbours(start.mesh().points.len(), &start.mesh().triangles);
    let mut at = start.mesh().points.clone();
    let mut pairs = cuts(start);
    let (mut best, mut fewest) = (None, pairs.len());
    for _ in 0..ROUNDS {
        if pairs.is_empty() {
            break;
        }
        let mut cutting: Vec<u32> = pairs.iter().map(|pair| pair[0]).collect();
        cutting.dedup(); // they are sorted
        let triangles = cutting.iter().map(|&t| start.mesh().triangles[t as usize]);
        let demands: Vec<Demand> = triangles.flat_map(|t| demands(&at, t, skin)).collect();
        let moves = meet(&demands, &at, &neighbours);
        at.iter_mut().zip(moves).for_each(|(x, d)| *x += d);
        let now = start.moved(at.clone());
        pairs = cuts(&now);
        if pairs.len() < fewest {
            fewest = pairs.len();
            best = Some(now);
        }
    }
    best.map(|best| (best, fewest))
}

impl Cloth<'_> {
    fn welded(&self, points: &[Vec3]) -> TriMesh {
        let count = self.weld.iter().max().map_or(0, |w| *w as usize + 1);
        let mut welded = vec![Vec3::zeros(); count];
        points.iter().zip(self.weld).for_each(|(p, &w)| welded[w as usize] = *p);
        let triangles = self.triangles.iter().map(|t| t.map(|i| self.weld[i as usize])).collect();
        TriMesh { points: welded, triangles }
    }
}

/// Moves of the points `at` that meet the demands, with the cloth around going along.
fn meet(demands: &[Demand], at: &[Vec3], neighbours: &[Vec<u32>]) -> Vec<Vec3> {
    let mut moves = vec![Vec3::zeros(); at.len()];
    let mut held = vec![false; at.len()];
    for demand in (0..PASSES).flat_map(|_| demands) {
        let corners = demand.triangle.map(|i| i as usize);
        let place: Vec3 = (0..3).map(|k| (at[corners[k]] + moves[corners[k]]) * demand.weights[k]).sum();
        let missing = demand.level - demand.normal.dot(&place);
        if missing > 0.0 {
            let norm: f64 = demand.weights.iter().map(|w| w * w).sum();
            for (i, weight) in corners.into_iter().zip(demand.weights) {
                moves[i] += demand.normal * (weight * missing / norm);
                held[i] = true;
            }
        }
    }
    for _ in 0..RINGS {
        let before = moves.clone();
        for i in (0..at.len()).filter(|&i| !held[i] && !neighbours[i].is_empty()) {
            let sum: Vec3 = neighbours[i].iter().map(|&j| before[j as usize]).sum();
            moves[i] = sum / neighbours[i].len() as f64;
        }
    }
    moves
}

/// What the points of a triangle demand.
fn demands(at: &[Vec3], triangle: [u32; 3], skin: &Surface) -> Vec<Demand> {
    let corners = triangle.map(|i| at[i as usize]);
    let mut demands = Vec::new();
    for i in 0..=DIVISIONS {
        for j in 0..=DIVISIONS - i {
            let weights = [i, j, DIVISIONS - i - j].map(|k| k as f64 / DIVISIONS as f64);
            let p: Vec3 = (0..3).map(|k| corners[k] * weights[k]).sum();
            let closest = skin.closest(&p);
            let normal = skin.pseudo_normal(&closest);
            let level = normal.dot(&closest.point) + CLEARANCE;
            demands.push(Demand { triangle, weights, normal, level });
        }
    }
    demands
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::tests::shapes::{mapped, sphere};

    /// A ball of 12 cm, and cloth of coarse triangles whose corners alone lie outside of it.
    fn tight() -> (Surface, TriMesh) {
        (Surface::new(sphere(Vec3::zeros(), 0.12, 5)), sphere(Vec3::zeros(), 0.121, 3))
    }

    fn own(mesh: &TriMesh) -> Vec<u32> {
        (0..mesh.points.len() as u32).collect()
    }

    #[test]
    fn what_spans_the_skin_is_lifted_out_of_it() {
        let (skin, mesh) = tight();
        let cloth = Cloth { points: &mesh.points, triangles: &mesh.triangles, weld: &own(&mesh) };
        let mut points = mesh.points.clone();
        let lift = clear(&cloth, &mut points, &skin, || Surface::new(sphere(Vec3::zeros(), 0.1, 4)));
        assert!(lift.pairs_before > 100 && lift.pairs == 0, "{lift:?}");
        let lifted = TriMesh { points, triangles: mesh.triangles.clone() };
        assert!(mesh_intersections(&Surface::new(lifted.clone()), &skin).is_empty());
        for t in 0..lifted.triangles.len() {
            let middle: Vec3 = lifted.corners(t).iter().sum::<Vec3>() / 3.0;
            assert!(middle.norm() > 0.12 && middle.norm() < 0.1215);
        }
        let moved = lifted.points.iter().zip(&mesh.points).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
        assert_eq!(moved, lift.largest_m);
    }

    #[test]
    fn what_cut_the_source_is_left_alone() {
        let (skin, mesh) = tight();
        let cloth = Cloth { points: &mesh.points, triangles: &mesh.triangles, weld: &own(&mesh) };
        let mut points = mesh.points.clone();
        let lift = clear(&cloth, &mut points, &skin, || tight().0);
        assert_eq!((lift, points), (Lift::default(), mesh.points));
    }

    #[test]
    fn sewn_points_stay_together_and_what_is_far_away_stays() {
        let (_, mesh) = tight();
        // A ridge around the equator lifts what lies over it alone.
        let skin = Surface::new(mapped(&sphere(Vec3::zeros(), 0.115, 6), |p| {
            p * (1.0 + 0.06 * (-(p.y / 0.006).powi(2)).exp())
        }));
        let corners: Vec<u32> = mesh.triangles.concat();
        let points: Vec<Vec3> = corners.iter().map(|&i| mesh.points[i as usize]).collect();
        let triangles: Vec<[u32; 3]> =
            (0..points.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let cloth = Cloth { points: &points, triangles: &triangles, weld: &corners };
        let mut lifted = points.clone();
        let lift = clear(&cloth, &mut lifted, &skin, || Surface::new(sphere(Vec3::zeros(), 0.1, 4)));
        assert!(lift.pairs_before > 0 && lift.pairs == 0, "{lift:?}");
        for (k, &i) in corners.iter().enumerate() {
            let moved = lifted[k] - points[k];
            let first = corners.iter().position(|&j| j == i).unwrap();
            assert_eq!(moved, lifted[first] - points[first]);
            assert!(points[k].y.abs() < 0.08 || moved == Vec3::zeros());
        }
    }
}
