//! Skin weights of every garment, refined together: the body is posed once for all.

use super::layers::Draped;
use super::{Error, Progress, Settings};
use crate::geometry::OuterSkin;
use crate::model::{Character, Garment, Outfit, Skin, Vec3};
use crate::pose;
use crate::proxy::Proxy;
use crate::rig::refine::{self, Worn};
use crate::rig::{self, Sewn};

/// Weights of the garments with their details, and how they were found.
///
/// # Errors
/// What the rig cannot work on.
pub(super) fn rig_all(
    outfit: &Outfit,
    proxies: &[Proxy<'_>],
    character: &Character,
    body: &OuterSkin,
    draped: &[Draped],
    settings: &Settings,
    progress: &mut Progress<'_>,
) -> Result<Vec<(Skin, rig::Info)>, Error> {
    let count = outfit.garments.len() as f64;
    let points: Vec<Vec<Vec3>> = proxies.iter().zip(draped).map(|(p, d)| p.gather(&d.points)).collect();
    let mut skins = Vec::new();
    for (g, garment) in outfit.garments.iter().enumerate() {
        progress("rig", 0.5 * g as f64 / count);
        let rigged = rig::run(character, body, proxies[g].garment(), &points[g], &settings.rig)
            .map_err(|error| Error::Rig { garment: garment.path.clone(), error })?;
        skins.push(rigged);
    }
    progress("rig", 0.5);
    let mut worn: Vec<Worn<'_>> = skins
        .iter_mut()
        .zip(proxies)
        .zip(&points)
        .map(|(((skin, info), proxy), points)| Worn { sewn: Sewn::new(proxy.garment(), points), skin, info })
        .collect();
    let poses = pose::poses(&character.skeleton)?.poses;
    refine::run(character, body, &mut worn, &poses, &settings.rig)
        .map_err(|error| Error::Rig { garment: character.path.clone(), error })?;
    let capping = rig::Capping::new(&character.skeleton);
    let with_details = |(((skin, info), proxy), draped): (((Skin, rig::Info), &Proxy<'_>), &Draped)| {
        (proxy.skin(&skin, &draped.points, &|p, row, most| capping.row(p, row, most)), info)
    };
    Ok(skins.into_iter().zip(proxies).zip(draped).map(with_details).collect())
}

/// What to say of garments whose own joints the skeleton does not have.
pub(super) fn notes(outfit: &Outfit, skins: &[(Skin, rig::Info)]) -> Vec<String> {
    let missing = |(garment, (_, info)): (&Garment, &(Skin, rig::Info))| {
        let (named, found) = (garment.joints.len(), info.own_joints);
        (found < named).then(|| {
            let then = if found == 0 { ": every joint may move it" } else { "" };
            format!("<{}>: the skeleton has {found} of the {named} joints in skel:joints{then}", garment.path)
        })
    };
    outfit.garments.iter().zip(skins).filter_map(missing).collect()
}
