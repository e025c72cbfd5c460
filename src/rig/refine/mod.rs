//! Weights refined against poses.
//!
//! The steps before look at the bind pose alone; what they cannot know is how the cloth is stretched when
//! joints turn, and where it meets skin that it does not lie on: lap and belly when the body sits, an arm
//! that comes down on the side. So body and garments are posed, and all weights of a garment are taken
//! that stretch it little in those poses and keep it out of the body, near those that it had ([`weights`]).
//! Skin also comes through between vertices, so the centres of faces are kept out too ([`contact`]).
//!
//! In each round the posed garment is looked at, and its weights are relaxed with the contacts found. Where
//! that stretches the cloth more than it was, contacts count less in the next round, else more
//! ([`garment`]). Each garment keeps the round that is best in the figures of the posed check taken together,
//! of those that are worse in none than what it came with.

mod contact;
mod exchange;
mod garment;
mod known;
mod weights;

use std::cell::OnceCell;

use rayon::prelude::*;

use super::cloth::node_mesh;
use super::influences::Posed;
use super::{Error, Info, Params, Sewn, check, rows_of, skin};
use crate::certificate::posed::posed_points;
use crate::geometry::OuterSkin;
use crate::model::{Character, Skin, TriMesh, Vec3};
use crate::pose::Pose;
use contact::Sinking;
use garment::Garment;

/// What has moved by less has not [m].
const STILL: f64 = 1e-7;

/// A rigged garment.
pub struct Worn<'a> {
    /// Its mesh on the body in the bind pose.
    pub sewn: Sewn<'a>,
    /// Weights of its vertices.
    pub skin: &'a mut Skin,
    /// The account of the rig.
    pub info: &'a mut Info,
}

/// Who is posed.
struct Scene<'a> {
    character: &'a Character,
    /// Outer skin of the body.
    body: &'a OuterSkin,
    poses: &'a [Pose],
    /// Its points in each pose [m].
    posed: Vec<Vec<Vec3>>,
    turns: Posed,
}

/// Refines the weights of garments that `character` wears; `body` is the outer skin of its body.
///
/// # Errors
/// As [`super::run`].
pub fn run(
    character: &Character,
    body: &OuterSkin,
    worn: &mut [Worn<'_>],
    poses: &[Pose],
    params: &Params,
) -> Result<(), Error> {
    params.check()?;
    if params.refine == 0 || poses.is_empty() {
        return Ok(());
    }
    check::body(character, body)?;
    worn.iter().try_for_each(|w| check::cloth(&w.sewn))?;
    let posed = poses.iter().map(|pose| posed_points(character, body, pose)).collect();
    let scene = Scene { character, body, poses, posed, turns: Posed::new(&character.skeleton) };
    let meshes: Vec<TriMesh> = worn.iter().map(|w| node_mesh(&w.sewn)).collect();
    let mut garments: Vec<Garment<'_>> =
        worn.iter().zip(&meshes).map(|(w, mesh)| Garment::new(&scene, w, mesh)).collect();
    for round in 0..=params.refine {
        let found = sinking(&scene, &mut garments);
        garments.par_iter_mut().zip(&found).for_each(|(garment, sinking)| {
            garment.judge(sinking);
            if round < params.refine {
                garment.correct(sinking, params.jump);
            }
        });
    }
    for (garment, w) in garments.iter().zip(worn) {
        let nodes = &w.sewn.groups.node_of_vertex;
        let before = rows_of(w.skin, w.sewn.groups);
        let changed = |node: &&u32| before[**node as usize] != garment.best[**node as usize];
        w.info.refined = nodes.iter().filter(changed).count() as f64 / nodes.len() as f64;
        let scale = 1.0 / (poses.len() * garment.spots()).max(1) as f64;
        w.info.sunk_m = garment.depths.map(|d| d * scale);
        *w.skin = skin(&garment.best, nodes, w.skin.influences);
    }
    Ok(())
}

/// Where every garment sinks. A pose in which nothing is to be asked does not pose the body.
fn sinking(scene: &Scene<'_>, garments: &mut [Garment<'_>]) -> Vec<Sinking> {
    let mut found: Vec<Sinking> = garments.iter().map(|_| Sinking::default()).collect();
    for pose in 0..scene.poses.len() {
        let posed = OnceCell::new();
        let body = || posed.get_or_init(|| scene.body.surface.moved(scene.posed[pose].clone()));
        for (garment, own) in garments.iter_mut().zip(&mut found) {
            garment.look(pose, &body);
            own.add(pose, garment);
        }
    }
    found
}
