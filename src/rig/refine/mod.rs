//! Weights refined against poses.
//!
//! The steps before look at the bind pose alone; what they cannot know is where cloth meets skin
//! that it does not lie on: lap and belly when the body sits, an arm that comes down on the side. So
//! body and garments are posed, and the weights of a vertex that sinks into the body are fitted anew
//! ([`fit`]): of all weights that keep it outside in those poses, those that move it least when
//! any joint turns about any axis (the metric of [`super::influences`], which knows no poses). Its
//! neighbours go along by a screened Poisson equation, so that a correction does not become a dent.
//!
//! Corrections may not stretch the cloth much more than it was ([`STRETCH`]); else a share of them is
//! taken, or none. A few rounds suffice; each garment keeps the round in which it sinks the least.

mod fit;
mod garment;

use std::collections::BTreeMap;

use super::cloth::node_mesh;
use super::influences::Posed;
use super::{Error, Info, Params, Sewn, check, rows_of, skin};
use crate::certificate::posed::{Anchor, posed_body};
use crate::geometry::OuterSkin;
use crate::geometry::skinning::skin_points;
use crate::model::{Character, Skin, TriMesh, Vec3};
use crate::pose::Pose;
use garment::Garment;

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
    turns: Posed,
}

/// A vertex in the body in one pose.
#[derive(Clone, Copy)]
struct Contact {
    pose: usize,
    /// The vertex's own skin.
    anchor: Anchor,
    /// The closest point of the posed skin [m].
    skin: Vec3,
    /// Out of the body, of length 1.
    normal: Vec3,
    /// How deep the vertex is [m].
    depth: f64,
}

/// Contacts of each node that has any.
type Contacts = BTreeMap<usize, Vec<Contact>>;

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
    let scene = Scene { character, body, poses, turns: Posed::new(&character.skeleton) };
    let meshes: Vec<TriMesh> = worn.iter().map(|w| node_mesh(&w.sewn)).collect();
    let mut garments: Vec<Garment<'_>> =
        worn.iter().zip(&meshes).map(|(w, mesh)| Garment::new(&scene, w, mesh)).collect();
    for round in 0..=params.refine {
        let found = contacts(&scene, &garments);
        for (garment, contacts) in garments.iter_mut().zip(&found) {
            garment.keep_best(contacts);
            if round < params.refine && !contacts.is_empty() {
                garment.correct(&scene, contacts, params.jump)?;
            }
        }
        if found.iter().all(Contacts::is_empty) {
            break;
        }
    }
    for (garment, w) in garments.iter().zip(worn) {
        let nodes = &w.sewn.groups.node_of_vertex;
        let before = rows_of(w.skin, w.sewn.groups);
        let changed = |node: &&u32| before[**node as usize] != garment.best[**node as usize];
        w.info.refined = nodes.iter().filter(changed).count() as f64 / nodes.len() as f64;
        let scale = 1.0 / (poses.len() * before.len()) as f64;
        w.info.sunk_m = garment.depths.unwrap_or_default().map(|d| d * scale);
        *w.skin = skin(&garment.best, nodes, w.skin.influences);
    }
    Ok(())
}

/// The contacts of every garment.
fn contacts(scene: &Scene<'_>, garments: &[Garment<'_>]) -> Vec<Contacts> {
    let mut found = vec![Contacts::new(); garments.len()];
    let skins: Vec<Skin> = garments.iter().map(Garment::node_skin).collect();
    for (p, pose) in scene.poses.iter().enumerate() {
        let posed = posed_body(scene.character, scene.body, pose);
        for ((garment, skin), own) in garments.iter().zip(&skins).zip(&mut found) {
            let points = skin_points(&garment.cloth.mesh.points, skin, &pose.matrices);
            for sunk in garment.resting.sunk(&posed, &points) {
                let normal = (sunk.skin - points[sunk.vertex]) / sunk.depth;
                let contact =
                    Contact { pose: p, anchor: sunk.anchor, skin: sunk.skin, normal, depth: sunk.depth };
                own.entry(sunk.vertex).or_default().push(contact);
            }
        }
    }
    found
}
