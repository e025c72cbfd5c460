//! Rig: skin weights for a dressed garment (paper section 7, Rig Transfer).
//!
//! A garment moves well if what lies on the skin moves with that skin, and what hangs free moves
//! with the cloth around it. Four steps, and a fifth where the character can be posed:
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
//! 5. **Refinement** ([`refine`]). Garment and body are posed; weights are relaxed so that the cloth is
//!    stretched little and stays out of the body.
//!
//! Joints that garments ignore (fingers, face) hand their weight on to an ancestor first
//! ([`joints`]). Weights belong to *nodes* (seam groups), so they are identical across seams,
//! and on what is sewn on with an offset.
//!
//! # What differs from the paper
//! The paper falls back to proximity for every point that its search misses; a loose skirt would
//! then split where left and right leg are equally near. It names none of steps 3 to 5.

pub mod blend_shapes;
mod check;
mod cloth;
mod influences;
mod inpaint;
mod joints;
mod params;
pub mod refine;
mod search;
mod smooth;
mod table;
#[cfg(test)]
mod tests;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::OuterSkin;
use crate::model::{Character, Garment, SeamGroups, Skeleton, Skin, Vec3};
pub use check::Error;
use cloth::Cloth;
use influences::Posed;
pub use params::Params;
use table::{Sparse, Table};

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
    /// Joints that the garment names itself and the skeleton has; 0 if all may move it.
    pub own_joints: usize,
    /// Pieces of the garment whose normals point at the body and were turned for the search.
    pub turned_pieces: usize,
    /// Fraction of vertices whose weights were changed to follow the body in poses.
    pub refined: f64,
    /// Depth of the garment in the posed body, before and after, averaged over poses and seam
    /// groups, zero for those outside [m].
    pub sunk_m: [f64; 2],
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
    /// Joints that move it, if it says so itself; empty otherwise.
    pub joints: &'a [String],
}

impl<'a> Sewn<'a> {
    /// A garment at `points`, one for each of its vertices.
    pub fn new(garment: &'a Garment, points: &'a [Vec3]) -> Sewn<'a> {
        Sewn { points, triangles: &garment.triangles, groups: &garment.groups, joints: &garment.joints }
    }
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
    run_sewn(character, body, &Sewn::new(garment, points), params)
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
    params.check()?;
    check::cloth(sewn)?;
    check::body(character, body)?;
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
    let (own, own_joints) = joints::own(&character.skeleton, sewn.joints);
    let ignored = if own_joints == 0 {
        joints::apply(&joints::targets(&character.skeleton, &params.ignore), &mut rows)
    } else {
        joints::hand_on(&own, &mut rows);
        0.0
    };
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
        own_joints,
        turned_pieces: found.turned,
        ..Info::default()
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
    params.check()?;
    check::cloth(sewn)?;
    check::body(character, body)?;
    let found = search::run(&Cloth::new(sewn), &body.surface, params);
    let of_node = |&n: &u32| found.matches[n as usize].map(|at| at.point);
    Ok(sewn.groups.node_of_vertex.iter().map(of_node).collect())
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

/// What leaves a point on few joints.
pub struct Capping(Posed);

impl Capping {
    /// For a skeleton.
    pub fn new(skeleton: &Skeleton) -> Capping {
        Capping(Posed::new(skeleton))
    }

    /// Of the weights `row` of a point at `p` [m] at most `most`, fitted to displace it the least from where
    /// all of them would; the largest first.
    pub fn row(&self, p: &Vec3, row: &[(u32, f64)], most: usize) -> Vec<(u32, f64)> {
        influences::cap(&self.0, p, &row.to_vec(), most).0
    }
}

/// The weights of each node, from those of its vertices.
fn rows_of(skin: &Skin, groups: &SeamGroups) -> Vec<Sparse> {
    let k = skin.influences;
    let mut rows = vec![Sparse::new(); groups.node_count];
    for (v, &node) in groups.node_of_vertex.iter().enumerate() {
        let own = (v * k..(v + 1) * k).map(|i| (skin.joint_indices[i], skin.joint_weights[i]));
        rows[node as usize] = own.filter(|w| w.1 > 0.0).collect();
    }
    rows
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
