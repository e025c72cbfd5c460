//! Rig: skin weights for a dressed garment (paper section 7, Rig Transfer).
//!
//! A garment moves well if what lies on the skin moves with that skin, and what hangs free moves
//! with the cloth around it. Four steps:
//!
//! 1. **Search** ([`search`]). A cloth point takes the weights of the nearest body point, if it
//!    is within `distance` and its normal agrees with the cloth's within `cone`; else of the
//!    skin behind it along its smoothed normal. So a sleeve that touches the torso does not
//!    become a part of it.
//! 2. **Inpainting** ([`inpaint`], [Abdrashitov 2023]). Points without a match get the smoothest
//!    extension over the cloth of the weights of those that have one. The nearest body point
//!    decides only for a piece of cloth without any match.
//! 3. **Evening out** ([`smooth`]). Where the nearest skin jumps from one limb to another, so do
//!    the weights. They are smoothed along the cloth, the more the farther the skin is.
//! 4. **Few influences** ([`influences`]). Those are kept, and fitted again, that move the point
//!    as all of them would.
//!
//! Joints that garments ignore (fingers, face) hand their weight on to an ancestor first
//! ([`joints`]). Weights belong to *nodes* (seam groups), so they are identical across seams,
//! and on what is sewn on with an offset.
//!
//! # What differs from the paper
//! The paper falls back to proximity for every point that its search misses; a loose skirt would
//! then split where left and right leg are equally near. It names neither steps 3 and 4.

pub mod blend_shapes;
mod cloth;
mod influences;
mod inpaint;
mod joints;
mod search;
mod smooth;
mod table;
#[cfg(test)]
mod tests;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::OuterSkin;
use crate::model::{Character, Garment, SeamGroups, Skin, Vec3};
use crate::solve::cholesky::CholeskyError;
use cloth::Cloth;
use influences::Posed;
use table::{Sparse, Table};

/// Settings of the rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Most influences for a vertex. Without it 4, or 8 where 4 would move a vertex of the garment
    /// by more than `influence_error`.
    pub influences: Option<usize>,
    /// Displacement by leaving out influences that is worth 8 of them: when every joint in turn is
    /// turned by 45 degrees about any axis, the root of the summed mean squares [m].
    pub influence_error: f64,
    /// Farthest body point that a cloth point can be matched to [m].
    pub distance: f64,
    /// Largest angle between the normals of cloth and body at a match [degrees].
    pub cone: f64,
    /// Rounds of averaging the cloth's normals with their neighbours'.
    pub smoothing: usize,
    /// Length along the cloth over which weights are evened out, where it lies `gap` from the
    /// skin; with the power 3/2 of the distance elsewhere [m].
    pub reach: f64,
    /// Distance from the skin that `reach` is meant for [m].
    pub gap: f64,
    /// Largest change of the weights along an edge, as the sum of absolute differences (2 at most):
    /// where more is left, the ends are averaged with their neighbours.
    pub jump: f64,
    /// Joints whose weight goes to their nearest kept ancestor. A pattern must match whole words of
    /// a joint's name, whatever the case; `*` and `?` stand for letters; `NAME/*` means all joints
    /// below. A garment of which they hold more than a quarter is made for them and keeps them.
    pub ignore: Vec<String>,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            influences: None,
            influence_error: 1e-3,
            distance: 0.08,
            cone: 45.0,
            smoothing: 2,
            reach: 0.03,
            gap: 0.016,
            jump: 0.6,
            ignore: IGNORED.map(str::to_owned).to_vec(),
        }
    }
}

/// Fingers, toes and the face, whatever the rig calls them.
const IGNORED: [&str; 9] =
    ["hand/*", "wrist/*", "foot/*", "ankle/*", "head/*", "finger", "thumb", "toe", "eye"];
/// Influences that every engine takes, and those that most can.
const FEW: usize = 4;
const MANY: usize = 8;

/// How the weights were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Fraction of vertices whose body point was found by the search.
    pub matched: f64,
    /// Fraction of vertices whose weights were extended from those.
    pub inpainted: f64,
    /// Fraction of vertices that took the nearest body point's.
    pub nearest: f64,
    /// Most influences of any vertex.
    pub influences_max: usize,
    /// Largest displacement by leaving out influences, as `influence_error` measures it [m].
    pub influence_error_max_m: f64,
    /// Share of the weight that ignored joints gave to their ancestors.
    pub ignored: f64,
    /// Pieces of the garment whose normals point at the body and were turned for the search.
    pub turned_pieces: usize,
}

/// Why a garment could not be rigged.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// The points do not belong to the garment.
    #[error("{found} points given, the garment has {expected} vertices")]
    Length { found: usize, expected: usize },
    /// A triangle of the cloth names a vertex that is not there.
    #[error("triangle {element}: vertex {index}, but there are only {count}")]
    Index { element: usize, index: u32, count: usize },
    /// There is no cloth.
    #[error("the garment has no triangles")]
    NoCloth,
    /// A position is not a finite number.
    #[error("point {element} of the {what} is not finite")]
    NotFinite { what: &'static str, element: usize },
    /// The body has no triangles.
    #[error("{body}: the body has no triangles")]
    NoBody { body: String },
    /// The body has no weights, or not as many as it needs.
    #[error("{body}: {found} skin weights for {points} points with {influences} influences each")]
    NoSkin { body: String, found: usize, points: usize, influences: usize },
    /// A weight names a joint that is not there.
    #[error("{body}: point {element} hangs on joint {joint}, but the skeleton has only {count}")]
    Joint { body: String, element: usize, joint: u32, count: usize },
    /// Weights that are negative or not finite, or all zero.
    #[error("{body}: the weights of point {element} are not finite and positive")]
    Weights { body: String, element: usize },
    /// A setting is out of its range.
    #[error("the setting '{name}' must be {allowed}, not {value}")]
    Setting { name: &'static str, allowed: &'static str, value: f64 },
    /// The extension's linear system could not be solved.
    #[error("weights over the cloth: {0}")]
    Solve(#[from] CholeskyError),
}

/// A sewn mesh: a garment, or what stands for one.
#[derive(Clone, Copy, Debug)]
pub struct Sewn<'a> {
    /// Vertices [m].
    pub points: &'a [Vec3],
    /// Triangles over vertices.
    pub triangles: &'a [[u32; 3]],
    /// What is sewn together.
    pub groups: &'a SeamGroups,
}

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
    let (found, expected) = (points.len(), garment.points.len());
    if found != expected {
        return Err(Error::Length { found, expected });
    }
    run_sewn(
        character,
        body,
        &Sewn { points, triangles: &garment.triangles, groups: &garment.groups },
        params,
    )
}

/// As [`run`], for any sewn mesh.
///
/// # Errors
/// As [`run`].
pub fn run_sewn(
    character: &Character,
    body: &OuterSkin,
    sewn: &Sewn<'_>,
    params: &Params,
) -> Result<(Skin, Info), Error> {
    check_settings(params)?;
    check_cloth(sewn)?;
    check_body(character, body)?;
    let cloth = Cloth::new(sewn);
    let found = search::run(&cloth, &body.surface, params);
    let by_search: Vec<bool> = found.matches.iter().map(Option::is_some).collect();
    let mut has_match = vec![false; cloth.piece_count];
    (0..cloth.len()).filter(|&n| by_search[n]).for_each(|n| has_match[cloth.piece[n] as usize] = true);
    let by_nearness: Vec<bool> = cloth.piece.iter().map(|&piece| !has_match[piece as usize]).collect();

    let mut rows: Vec<Option<Sparse>> = (0..cloth.len())
        .map(|n| {
            let place = found.matches[n].map(|at| (at.triangle, at.barycentric));
            let nearest = &found.nearest[n];
            let place = place.or(by_nearness[n].then_some((nearest.triangle, nearest.barycentric)));
            place.map(|(triangle, b)| table::body_weights(body, &character.skin, triangle, &b))
        })
        .collect();
    let targets = joints::targets(&character.skeleton, &params.ignore);
    let ignored = joints::apply(&targets, &mut rows);
    let mut table = Table::new(&rows, character.skeleton.joints.len());
    let known: Vec<bool> = rows.iter().map(Option::is_some).collect();
    inpaint::run(&cloth, &known, &mut table)?;
    let clearance = |n: usize| if by_search[n] { found.nearest[n].distance } else { f64::INFINITY };
    let clearance: Vec<f64> = (0..cloth.len()).map(clearance).collect();
    smooth::run(&cloth, &clearance, params.gap, params.reach, &mut table)?;
    smooth::limit_jumps(&cloth, params.jump, &mut table);

    let node_of_vertex = &sewn.groups.node_of_vertex;
    let (capped, lost, influences) = few(&cloth, &Posed::new(&character.skeleton), &table, params);
    let share = |nodes: &[bool]| {
        let count = node_of_vertex.iter().filter(|&&n| nodes[n as usize]).count();
        count as f64 / node_of_vertex.len() as f64
    };
    let (hit, near) = (share(&by_search), share(&by_nearness));
    let info = Info {
        matched: hit,
        inpainted: (1.0 - hit - near).max(0.0),
        nearest: near,
        influences_max: capped.iter().map(Vec::len).max().unwrap_or(0),
        influence_error_max_m: lost,
        ignored,
        turned_pieces: found.turned,
    };
    Ok((skin(&capped, node_of_vertex, influences), info))
}

/// The body point that each vertex is matched to, where one was found [m].
///
/// # Errors
/// As [`run`].
pub fn matches(
    character: &Character,
    body: &OuterSkin,
    sewn: &Sewn<'_>,
    params: &Params,
) -> Result<Vec<Option<Vec3>>, Error> {
    check_settings(params)?;
    check_cloth(sewn)?;
    check_body(character, body)?;
    let found = search::run(&Cloth::new(sewn), &body.surface, params);
    let of_node = |&n: &u32| found.matches[n as usize].map(|at| at.point);
    Ok(sewn.groups.node_of_vertex.iter().map(of_node).collect())
}

fn check_settings(params: &Params) -> Result<(), Error> {
    let setting = |name, allowed, value| Err(Error::Setting { name, allowed, value });
    if params.influences == Some(0) {
        return setting("influences", "at least 1", 0.0);
    }
    if !(params.cone > 0.0 && params.cone <= 180.0) {
        return setting("cone", "between 0 and 180", params.cone);
    }
    if !(params.gap > 0.0 && params.gap.is_finite()) {
        return setting("gap", "positive", params.gap);
    }
    let lengths = [
        ("distance", params.distance),
        ("reach", params.reach),
        ("jump", params.jump),
        ("influence_error", params.influence_error),
    ];
    match lengths.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
        Some((name, value)) => setting(name, "finite and not negative", value),
        None => Ok(()),
    }
}

fn check_cloth(sewn: &Sewn<'_>) -> Result<(), Error> {
    let (count, expected) = (sewn.points.len(), sewn.groups.node_of_vertex.len());
    if count != expected {
        return Err(Error::Length { found: count, expected });
    }
    if sewn.triangles.is_empty() {
        return Err(Error::NoCloth);
    }
    if let Some(element) = sewn.points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { what: "garment", element });
    }
    for (element, tri) in sewn.triangles.iter().enumerate() {
        if let Some(&index) = tri.iter().find(|&&v| v as usize >= count) {
            return Err(Error::Index { element, index, count });
        }
    }
    Ok(())
}

fn check_body(character: &Character, body: &OuterSkin) -> Result<(), Error> {
    let (skin, points) = (&character.skin, character.body.points.len());
    let path = || character.path.clone();
    let (influences, found, expected) = (skin.influences, skin.joint_weights.len(), points * skin.influences);
    if expected == 0 || found != expected || skin.joint_indices.len() != expected {
        return Err(Error::NoSkin { body: path(), found, points, influences });
    }
    if body.surface.mesh().triangles.is_empty() {
        return Err(Error::NoBody { body: path() });
    }
    if let Some(element) = character.body.points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        return Err(Error::NotFinite { what: "body", element });
    }
    let count = character.skeleton.joints.len();
    if let Some(i) = skin.joint_indices.iter().position(|&j| j as usize >= count) {
        let joint = skin.joint_indices[i];
        return Err(Error::Joint { body: path(), element: i / influences, joint, count });
    }
    let good = |weights: &[f64]| {
        weights.iter().all(|w| w.is_finite() && *w >= 0.0) && weights.iter().sum::<f64>() > 0.0
    };
    match skin.joint_weights.chunks(influences).position(|weights| !good(weights)) {
        Some(element) => Err(Error::Weights { body: path(), element }),
        None => Ok(()),
    }
}

/// Rows with few influences, the largest displacement that costs, and how many were allowed.
fn few(cloth: &Cloth, posed: &Posed, table: &Table, params: &Params) -> (Vec<Sparse>, f64, usize) {
    let rows: Vec<Sparse> = (0..cloth.len())
        .into_par_iter()
        .map(|n| influences::significant(&table.joints, table.row(n)))
        .collect();
    let capped = |most: usize| -> (Vec<Sparse>, f64, usize) {
        let each: Vec<(Sparse, f64)> = rows
            .par_iter()
            .zip(&cloth.mesh.points)
            .map(|(row, p)| influences::cap(posed, p, row, most))
            .collect();
        let lost = each.iter().map(|row| row.1).fold(0.0, f64::max);
        (each.into_iter().map(|row| row.0).collect(), lost, most)
    };
    match params.influences {
        Some(most) => capped(most),
        None => {
            let few = capped(FEW);
            if few.1 > params.influence_error { capped(MANY) } else { few }
        }
    }
}

/// Each vertex has the weights of its node.
fn skin(rows: &[Sparse], node_of_vertex: &[u32], influences: usize) -> Skin {
    let mut skin = Skin { influences, ..Skin::default() };
    for &node in node_of_vertex {
        let row = &rows[node as usize];
        skin.joint_indices.extend((0..influences).map(|i| row.get(i).map_or(0, |w| w.0)));
        skin.joint_weights.extend((0..influences).map(|i| row.get(i).map_or(0.0, |w| w.1)));
    }
    skin
}
