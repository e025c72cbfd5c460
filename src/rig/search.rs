//! The body point behind a cloth point, along the cloth's smoothed normal.

use rayon::prelude::*;

use super::Params;
use crate::geometry::Surface;
use crate::model::{TriMesh, Vec3};

/// How far outward the search looks for skin that the cloth has sunk under [m].
const SUNK: f64 = 0.02;

/// A place on the body's surface.
pub(super) struct Place {
    pub triangle: u32,
    pub barycentric: [f64; 3],
}

/// What the search found.
pub(super) struct Found {
    /// For each node.
    pub matches: Vec<Option<Place>>,
    /// Pieces whose normals were turned.
    pub turned: usize,
}

/// Searches for every node of the cloth.
pub(super) fn run(
    cloth: &TriMesh,
    pieces: &[u32],
    piece_count: usize,
    body: &Surface,
    params: &Params,
) -> Found {
    let mut normals = smoothed_normals(cloth, params.smoothing);
    let turned = turn_outward(cloth, pieces, piece_count, body, &mut normals);
    let agree = params.cone.to_radians().cos();
    let matches = cloth
        .points
        .par_iter()
        .zip(&normals)
        .map(|(p, n)| behind(p, n, body, params.distance, agree))
        .collect();
    Found { matches, turned }
}

/// Skin straight behind the cloth; else in front of it, where the cloth has sunk in; else the
/// nearest, if it faces the same way.
fn behind(p: &Vec3, normal: &Vec3, body: &Surface, distance: f64, agree: f64) -> Option<Place> {
    if *normal == Vec3::zeros() {
        return None;
    }
    let faces = |triangle: u32, barycentric: &[f64; 3]| {
        let corners = body.mesh().triangles[triangle as usize];
        let n: Vec3 = (0..3).map(|k| body.point_normals()[corners[k] as usize] * barycentric[k]).sum();
        n.try_normalize(0.0).is_some_and(|n| n.dot(normal) >= agree)
    };
    for (direction, reach) in [(-normal, distance), (*normal, SUNK.min(distance))] {
        if let Some(hit) = body.ray(p, &direction, reach)
            && faces(hit.triangle, &hit.barycentric)
        {
            return Some(Place { triangle: hit.triangle, barycentric: hit.barycentric });
        }
    }
    let near = body.closest_within(p, distance)?;
    faces(near.triangle, &near.barycentric)
        .then_some(Place { triangle: near.triangle, barycentric: near.barycentric })
}

/// Unit normals, averaged with their neighbours' `rounds` times.
fn smoothed_normals(cloth: &TriMesh, rounds: usize) -> Vec<Vec3> {
    let mut normals = cloth.point_normals();
    for _ in 0..rounds {
        let mut sums = normals.clone();
        for t in &cloth.triangles {
            for k in 0..3 {
                sums[t[k] as usize] += normals[t[(k + 1) % 3] as usize] + normals[t[(k + 2) % 3] as usize];
            }
        }
        normals = sums.iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect();
    }
    normals
}

/// Turns the normals of pieces that face the body more than they face away from it.
fn turn_outward(
    cloth: &TriMesh,
    pieces: &[u32],
    count: usize,
    body: &Surface,
    normals: &mut [Vec3],
) -> usize {
    let areas = cloth.point_areas();
    let votes: Vec<f64> = (0..cloth.points.len())
        .into_par_iter()
        .map(|n| {
            let away = cloth.points[n] - body.closest(&cloth.points[n]).point;
            away.try_normalize(0.0).map_or(0.0, |away| areas[n] * away.dot(&normals[n]))
        })
        .collect();
    let mut tally = vec![0.0; count];
    votes.iter().zip(pieces).for_each(|(vote, &piece)| tally[piece as usize] += vote);
    for (n, &piece) in normals.iter_mut().zip(pieces) {
        if tally[piece as usize] < 0.0 {
            *n = -*n;
        }
    }
    tally.iter().filter(|&&t| t < 0.0).count()
}
