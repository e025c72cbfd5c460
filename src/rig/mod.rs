//! Rig: skin weights for a dressed garment (paper section 7, Rig Transfer).
//!
//! Nearness picks the wrong limb where cloth lies close to two (armpit, crotch, a sleeve
//! beside the waist). So a cloth point looks for the skin *behind* it: along its smoothed
//! normal, for a body point whose own normal agrees ([`search`]). Points that find none get
//! their weights from those that did, as the smoothest extension over the cloth
//! ([`inpaint`], [Abdrashitov 2023]); the nearest body point decides only for a piece of
//! cloth where nothing was found at all.
//!
//! Weights belong to *nodes* (seam groups), so they are identical across seams, and on what
//! is sewn on with an offset.
//!
//! # What differs from the paper
//! The paper falls back to proximity for every point that its search misses; a loose skirt
//! would then split where left and right leg are equally near.

pub mod blend_shapes;
mod inpaint;
mod search;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::OuterSkin;
use crate::model::{Character, Garment, Skin, TriMesh, Vec3};
use crate::solve::cholesky::CholeskyError;

/// Weights below this share are left out of a vertex's influences.
const NEGLIGIBLE: f64 = 1e-4;

/// Settings of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Most influences for a vertex.
    pub influences: usize,
    /// Farthest body point that the search along the normal accepts [m].
    pub distance: f64,
    /// Largest angle between the normals of cloth and body [degrees].
    pub cone: f64,
    /// Rounds of averaging the cloth's normals with their neighbours'.
    pub smoothing: usize,
}

impl Default for Params {
    fn default() -> Self {
        Params { influences: 4, distance: 0.08, cone: 60.0, smoothing: 8 }
    }
}

/// How the weights were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Fraction of vertices whose body point was found along the normal.
    pub matched: f64,
    /// Fraction of vertices whose weights were extended from those.
    pub inpainted: f64,
    /// Fraction of vertices that took the nearest body point's.
    pub nearest: f64,
    /// Most influences of any vertex.
    pub influences_max: usize,
    /// Pieces of the garment whose normals point at the body and were turned for the search.
    pub turned_pieces: usize,
}

/// Why a garment could not be rigged.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// The points do not belong to the garment.
    #[error("{found} points given, the garment has {expected} vertices")]
    Length {
        /// Points given.
        found: usize,
        /// Vertices of the garment.
        expected: usize,
    },
    /// The body has no weights.
    #[error("{body}: {found} skin weights for {points} points with {influences} influences each")]
    NoSkin {
        /// Path of the body.
        body: String,
        /// Weights there are.
        found: usize,
        /// Points of the body.
        points: usize,
        /// Influences for each point.
        influences: usize,
    },
    /// No influence is allowed.
    #[error("the setting 'influences' must be at least 1")]
    NoInfluence,
    /// The extension's linear system could not be solved.
    #[error("weight inpainting: {0}")]
    Inpaint(#[from] CholeskyError),
}

/// Weights over all joints, sparse: (joint, weight) in ascending order of joints.
type Weights = Vec<(u32, f64)>;

/// Gives every vertex of `garment` at `points` its skin weights; `body` is the outer skin of the
/// character's body.
///
/// # Errors
/// Arrays that do not fit together, see [`Error`].
pub fn run(
    character: &Character,
    body: &OuterSkin,
    garment: &Garment,
    points: &[Vec3],
    params: &Params,
) -> Result<(Skin, Info), Error> {
    check(character, garment, points, params)?;
    let groups = &garment.groups;
    let cloth = node_mesh(garment, points);
    let (pieces, piece_count) = cloth.components();
    let found = search::run(&cloth, &pieces, piece_count, &body.surface, params);
    let weights_at =
        |triangle, barycentric: &[f64; 3]| body_weights(body, &character.skin, triangle, barycentric);

    let mut weights: Vec<Option<Weights>> =
        found.matches.iter().map(|m| m.as_ref().map(|at| weights_at(at.triangle, &at.barycentric))).collect();
    let matched: Vec<bool> = weights.iter().map(Option::is_some).collect();
    let mut has_match = vec![false; piece_count];
    (0..cloth.points.len()).filter(|&n| matched[n]).for_each(|n| has_match[pieces[n] as usize] = true);
    for n in 0..cloth.points.len() {
        if !has_match[pieces[n] as usize] {
            let nearest = body.surface.closest(&cloth.points[n]);
            weights[n] = Some(weights_at(nearest.triangle, &nearest.barycentric));
        }
    }
    let weights = inpaint::run(&cloth, weights)?;

    let skin = cap(&weights, &groups.node_of_vertex, params.influences);
    let share = |pick: &dyn Fn(usize) -> bool| {
        let count = groups.node_of_vertex.iter().filter(|&&n| pick(n as usize)).count();
        count as f64 / groups.node_of_vertex.len() as f64
    };
    let (hit, near) = (share(&|n| matched[n]), share(&|n| !has_match[pieces[n] as usize]));
    let used = skin.joint_weights.chunks(skin.influences).map(|w| w.iter().filter(|&&w| w > 0.0).count());
    let info = Info {
        matched: hit,
        inpainted: (1.0 - hit - near).max(0.0),
        nearest: near,
        influences_max: used.max().unwrap_or(0),
        turned_pieces: found.turned,
    };
    Ok((skin, info))
}

fn check(character: &Character, garment: &Garment, points: &[Vec3], params: &Params) -> Result<(), Error> {
    if points.len() != garment.points.len() {
        return Err(Error::Length { found: points.len(), expected: garment.points.len() });
    }
    if params.influences == 0 {
        return Err(Error::NoInfluence);
    }
    let (skin, n) = (&character.skin, character.body.points.len());
    let expected = n * skin.influences;
    if expected == 0 || skin.joint_weights.len() != expected || skin.joint_indices.len() != expected {
        return Err(Error::NoSkin {
            body: character.path.clone(),
            found: skin.joint_weights.len(),
            points: n,
            influences: skin.influences,
        });
    }
    Ok(())
}

/// The cloth over its nodes; triangles that a seam has closed up are left out.
fn node_mesh(garment: &Garment, points: &[Vec3]) -> TriMesh {
    let node = &garment.groups.node_of_vertex;
    let triangles = garment.triangles.iter().map(|t| t.map(|v| node[v as usize]));
    TriMesh {
        points: garment.groups.node_points(points),
        triangles: triangles.filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect(),
    }
}

/// The body's weights at a point of its outer skin.
fn body_weights(body: &OuterSkin, skin: &Skin, triangle: u32, barycentric: &[f64; 3]) -> Weights {
    let mut weights = Weights::new();
    let k = skin.influences;
    for (corner, share) in body.surface.mesh().triangles[triangle as usize].iter().zip(barycentric) {
        let first = body.point_of[*corner as usize] as usize * k;
        for i in first..first + k {
            weights.push((skin.joint_indices[i], share * skin.joint_weights[i]));
        }
    }
    weights.sort_by_key(|w| w.0);
    weights.dedup_by(|b, a| {
        a.0 == b.0 && {
            a.1 += b.1;
            true
        }
    });
    weights.retain(|w| w.1 > 0.0);
    weights
}

/// The largest `influences` weights of each vertex's node, normalised, largest first.
fn cap(weights: &[Weights], node_of_vertex: &[u32], influences: usize) -> Skin {
    let capped: Vec<Weights> = weights
        .iter()
        .map(|w| {
            let mut kept = w.clone();
            kept.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            kept.truncate(influences);
            let most = kept.first().map_or(0.0, |w| w.1);
            kept.retain(|w| w.1 >= NEGLIGIBLE * most);
            let sum: f64 = kept.iter().map(|w| w.1).sum();
            kept.iter_mut().for_each(|w| w.1 /= sum);
            kept
        })
        .collect();
    let mut skin = Skin { influences, ..Skin::default() };
    for &node in node_of_vertex {
        let kept = &capped[node as usize];
        skin.joint_indices.extend((0..influences).map(|i| kept.get(i).map_or(0, |w| w.0)));
        skin.joint_weights.extend((0..influences).map(|i| kept.get(i).map_or(0.0, |w| w.1)));
    }
    skin
}
