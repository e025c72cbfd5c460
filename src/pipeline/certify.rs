//! What was achieved: the certificate of every garment, at rest and in poses.

use super::layers::Draped;
use super::{Error, Settings};
use crate::certificate::{self, Certificate, posed};
use crate::geometry::OuterSkin;
use crate::model::{Character, Garment, Outfit, Skin, TriMesh, Vec2};
use crate::pose::{self, Pose};
use crate::{pattern, rig};

/// The poses that the character will be judged in, and what to say of those that it cannot take.
///
/// # Errors
/// A skeleton that is no tree, or a setting that names no pose.
pub(super) fn poses(character: &Character, settings: &Settings) -> Result<(Vec<Pose>, Vec<String>), Error> {
    if !settings.posed.enabled {
        return Ok((Vec::new(), Vec::new()));
    }
    let set = pose::poses(&character.skeleton)?;
    let poses = posed::chosen(&set, &settings.posed).map_err(Error::UnknownPose)?;
    let mut notes: Vec<String> = Vec::new();
    for part in ["arms", "legs", "spine", "neck"] {
        let without: Vec<&str> = set.left_out.iter().filter(|l| l.1 == part).map(|l| l.0).collect();
        if !without.is_empty() {
            notes.push(format!(
                "{}: the skeleton's {part} were not found: the posed check leaves out {}",
                character.path,
                without.join(", ")
            ));
        }
    }
    Ok((poses, notes))
}

/// Measures every garment.
#[expect(clippy::too_many_arguments, reason = "every stage before has a say")]
pub(super) fn run(
    outfit: &Outfit,
    sources: &[OuterSkin],
    character: &Character,
    body: &OuterSkin,
    draped: &[Draped],
    patterns: &[(Vec<Vec2>, pattern::Info)],
    skins: &[(Skin, rig::Info)],
    poses: &[Pose],
) -> Vec<Certificate> {
    let garments: Vec<certificate::Dressed<'_>> = (0..outfit.garments.len())
        .map(|g| certificate::Dressed {
            garment: &outfit.garments[g],
            points: &draped[g].points,
            pattern: &patterns[g].0,
            skin: Some(&skins[g].0),
            offsets: Some(&draped[g].rest_offsets),
            bound: Some(&draped[g].bound),
        })
        .collect();
    let mut certificates = certificate::measure(&certificate::Input {
        body: &body.surface,
        source_bodies: &sources.iter().map(|s| &s.surface).collect::<Vec<_>>(),
        garments: &garments,
    });
    if poses.is_empty() {
        return certificates;
    }
    let welded: Vec<(TriMesh, Skin)> = outfit
        .garments
        .iter()
        .zip(draped)
        .zip(skins)
        .map(|((garment, draped), skin)| (garment.welded_mesh(&draped.points), welded_skin(garment, &skin.0)))
        .collect();
    let cloths: Vec<posed::Cloth<'_>> =
        welded.iter().map(|(mesh, skin)| posed::Cloth { mesh, skin }).collect();
    let figures = posed::measure(character, body, &cloths, poses);
    for (certificate, figures) in certificates.iter_mut().zip(figures) {
        certificate.posed = figures;
    }
    certificates
}

/// Weights of the points of [`Garment::welded_mesh`]: those of the first vertex of each weld.
fn welded_skin(garment: &Garment, skin: &Skin) -> Skin {
    let (groups, k) = (&garment.groups, skin.influences);
    let mut welded = Skin {
        influences: k,
        joint_indices: vec![0; groups.weld_count * k],
        joint_weights: vec![0.0; groups.weld_count * k],
    };
    for v in (0..garment.points.len()).rev() {
        let (from, to) = (v * k, groups.weld_of_vertex[v] as usize * k);
        welded.joint_indices[to..to + k].copy_from_slice(&skin.joint_indices[from..from + k]);
        welded.joint_weights[to..to + k].copy_from_slice(&skin.joint_weights[from..from + k]);
    }
    welded
}
