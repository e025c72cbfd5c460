//! The body point that each cloth point lies on.
//!
//! That is the nearest one, if its normal agrees with the cloth's within the cone; else the one
//! straight behind along the cloth's normal, or in front of it where the cloth has sunk in,
//! under the same condition. Cloth normals are averaged with their neighbours' first, and those
//! of a piece that faces the body are turned. Where a piece is folded over (a turned-up cuff, a
//! fallen hood) its outside faces the skin: that is told from a sleeve against the torso by there
//! being no body behind it. A patch of matches that is torn off from all around it (a bit of the
//! left hem that met the right leg) is not trusted.

use rayon::prelude::*;

use super::Params;
use super::cloth::Cloth;
use crate::geometry::{Closest, Surface};
use crate::model::Vec3;
use crate::model::seam::DisjointSets;

/// How far outward the search looks for skin that the cloth has sunk under [m].
const SUNK: f64 = 0.02;
/// Cloth that faces the nearest skin is folded over if there is no body behind it within [m].
const BEHIND: f64 = 0.3;
/// Body points of two neighbours are torn apart if they are farther from each other than this
/// many times the edge and [`SLACK`] more.
const TORN: f64 = 2.0;
/// See [`TORN`]: what a fold of the skin may add [m].
const SLACK: f64 = 0.02;
/// A torn-off patch with less than this share of the largest patch's area is not trusted.
const STRAY: f64 = 0.1;
/// Nodes that follow one another are near each other in runs of this length.
const RUN: usize = 512;

/// A place on the body's surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub triangle: u32,
    pub barycentric: [f64; 3],
    pub point: Vec3,
}

/// What the search found.
pub(super) struct Found {
    /// For each node.
    pub matches: Vec<Option<Place>>,
    /// The nearest body point of each node.
    pub nearest: Vec<Closest>,
    /// Pieces whose normals were turned.
    pub turned: usize,
}

/// Searches for every node of the cloth.
pub(super) fn run(cloth: &Cloth, body: &Surface, params: &Params) -> Found {
    let nearest = nearest(&cloth.mesh.points, body);
    let mut normals = smoothed_normals(cloth, params.smoothing);
    let turned = turn_outward(cloth, &nearest, &mut normals);
    let agree = params.cone.to_radians().cos();
    let mut matches: Vec<Option<Place>> = (0..cloth.len())
        .into_par_iter()
        .with_min_len(RUN)
        .map(|n| facing(&cloth.mesh.points[n], &normals[n], &nearest[n], body, params.distance, agree))
        .collect();
    drop_strays(cloth, &mut matches);
    Found { matches, nearest, turned }
}

/// The nearest body point of each point. Points are visited along a space-filling curve, so that
/// the last one's triangle is a good first guess.
fn nearest(points: &[Vec3], body: &Surface) -> Vec<Closest> {
    let order = along_curve(points);
    let found: Vec<Closest> = order
        .par_chunks(RUN)
        .flat_map_iter(|run| {
            let mut guess = None;
            run.iter().map(move |&n| {
                let closest = body.closest_from(&points[n as usize], guess);
                guess = Some(closest.triangle);
                closest
            })
        })
        .collect();
    let mut nearest = found.clone();
    order.iter().zip(found).for_each(|(&n, closest)| nearest[n as usize] = closest);
    nearest
}

/// Indices along a Morton curve of 1024 cells a side.
fn along_curve(points: &[Vec3]) -> Vec<u32> {
    let lo = points.iter().fold(Vec3::repeat(f64::MAX), |lo, p| lo.inf(p));
    let hi = points.iter().fold(Vec3::repeat(f64::MIN), |hi, p| hi.sup(p));
    let scale = 1023.0 / (hi - lo).max().max(f64::MIN_POSITIVE);
    let spread = |x: f64| {
        let mut x = (x * scale) as u32;
        x = (x | (x << 16)) & 0x0300_00ff;
        x = (x | (x << 8)) & 0x0300_f00f;
        x = (x | (x << 4)) & 0x030c_30c3;
        (x | (x << 2)) & 0x0924_9249
    };
    let code = |p: &Vec3| spread(p.x - lo.x) | spread(p.y - lo.y) << 1 | spread(p.z - lo.z) << 2;
    let mut keyed: Vec<(u32, u32)> = points.iter().zip(0..).map(|(p, n)| (code(p), n)).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, n)| n).collect()
}

/// The nearest point if it faces as the cloth does; else skin straight behind, or in front; else
/// the nearest all the same, if the cloth is folded over.
fn facing(
    p: &Vec3,
    normal: &Vec3,
    nearest: &Closest,
    body: &Surface,
    distance: f64,
    agree: f64,
) -> Option<Place> {
    if *normal == Vec3::zeros() || nearest.distance > distance {
        return None;
    }
    let cosine = |triangle: u32, barycentric: &[f64; 3]| {
        let corners = body.mesh().triangles[triangle as usize];
        let n: Vec3 = (0..3).map(|k| body.point_normals()[corners[k] as usize] * barycentric[k]).sum();
        n.try_normalize(0.0).map_or(0.0, |n| n.dot(normal))
    };
    let &Closest { triangle, barycentric, point, .. } = nearest;
    let at_nearest = Some(Place { triangle, barycentric, point });
    let nearest_cosine = cosine(triangle, &barycentric);
    if nearest_cosine >= agree {
        return at_nearest;
    }
    let along = |direction: &Vec3, reach: f64| {
        let hit = body.ray(p, direction, reach)?;
        (cosine(hit.triangle, &hit.barycentric) >= agree).then(|| Place {
            triangle: hit.triangle,
            barycentric: hit.barycentric,
            point: p + direction * hit.distance,
        })
    };
    along(&-normal, distance).or_else(|| along(normal, SUNK.min(distance))).or_else(|| {
        let folded = nearest_cosine <= -agree && body.ray(p, &-normal, BEHIND).is_none();
        at_nearest.filter(|_| folded)
    })
}

/// Unit normals, averaged with their neighbours' `rounds` times.
fn smoothed_normals(cloth: &Cloth, rounds: usize) -> Vec<Vec3> {
    let mut normals = cloth.mesh.point_normals();
    for _ in 0..rounds {
        let average = |n: usize| {
            let sum: Vec3 = cloth.around(n).iter().map(|e| normals[e.node as usize]).sum();
            (sum + normals[n]).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
        };
        normals = (0..cloth.len()).map(average).collect();
    }
    normals
}

/// Turns the normals of pieces that face the body more than they face away from it; returns how
/// many.
fn turn_outward(cloth: &Cloth, nearest: &[Closest], normals: &mut [Vec3]) -> usize {
    let mut tally = vec![0.0; cloth.piece_count];
    for n in 0..cloth.len() {
        let away = (cloth.mesh.points[n] - nearest[n].point).try_normalize(0.0);
        let vote = away.map_or(0.0, |away| cloth.areas[n] * away.dot(&normals[n]));
        tally[cloth.piece[n] as usize] += vote;
    }
    for (n, &piece) in normals.iter_mut().zip(&cloth.piece) {
        if tally[piece as usize] < 0.0 {
            *n = -*n;
        }
    }
    tally.iter().filter(|&&t| t < 0.0).count()
}

/// Forgets the matches of small patches that torn edges part from the rest of their piece.
fn drop_strays(cloth: &Cloth, matches: &mut [Option<Place>]) {
    let mut sets = DisjointSets::new(cloth.len());
    for n in 0..cloth.len() {
        for e in cloth.around(n).iter().filter(|e| (e.node as usize) < n) {
            let m = e.node as usize;
            let torn = match (&matches[n], &matches[m]) {
                (Some(a), Some(b)) => {
                    let edge = (cloth.mesh.points[n] - cloth.mesh.points[m]).norm();
                    (a.point - b.point).norm() > TORN * edge + SLACK
                }
                _ => false,
            };
            if !torn {
                sets.union(n as u32, m as u32);
            }
        }
    }
    let (patch, count) = sets.labels();
    if count == cloth.piece_count {
        return;
    }
    let mut areas = vec![0.0; count];
    let mut largest = vec![0.0; cloth.piece_count];
    for n in (0..cloth.len()).filter(|&n| matches[n].is_some()) {
        let area: &mut f64 = &mut areas[patch[n] as usize];
        *area += cloth.areas[n];
        let most: &mut f64 = &mut largest[cloth.piece[n] as usize];
        *most = most.max(*area);
    }
    for n in 0..cloth.len() {
        if areas[patch[n] as usize] < STRAY * largest[cloth.piece[n] as usize] {
            matches[n] = None;
        }
    }
}
