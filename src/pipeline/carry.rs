//! Every garment from its own source body to the target.

use serde::Serialize;

use super::{Error, Settings};
use crate::device::Device;
use crate::geometry::OuterSkin;
use crate::model::{Character, Outfit, Vec3};
use crate::proxy::Proxy;
use crate::rig;
use crate::transfer::cache::Origin;
use crate::transfer::clear::Cloth;
use crate::transfer::pose::{PoseInfo, Unposed, unpose};
use crate::transfer::{self, Cache};

/// The flow from one source body to the target.
#[derive(Clone, Debug, Serialize)]
pub struct FlowReport {
    /// Path of the source body.
    pub source: String,
    /// Whether it was solved now, or where it was found.
    pub origin: Origin,
    /// How the target's pose differs from the source's, if it does.
    pub pose: Option<PoseInfo>,
}

/// What became of one garment's proxy.
#[derive(Clone)]
pub(super) struct CarriedGarment {
    /// Its points on the target [m].
    pub points: Vec<Vec3>,
    /// Its points on the target in the source's pose, which say how the cloth is strained [m].
    pub fitted: Vec<Vec3>,
    /// The transfer's account.
    pub info: transfer::Info,
}

/// What became of the garments.
pub(super) struct CarriedOutfit {
    /// In the outfit's order.
    pub garments: Vec<CarriedGarment>,
    /// The target in the pose of each source body, where it is in another.
    pub unposed: Vec<Option<Character>>,
    pub flows: Vec<FlowReport>,
    pub notes: Vec<String>,
}

/// Carries the proxies of the garments of each source body; the flow is theirs in common.
pub(super) fn carry_all(
    outfit: &Outfit,
    proxies: &[Proxy<'_>],
    character: &Character,
    settings: &Settings,
    device: &Device,
    cache: &Cache,
) -> Result<CarriedOutfit, Error> {
    let mut results = vec![None; outfit.garments.len()];
    let mut unposed_targets = vec![None; outfit.bodies.len()];
    let (mut flows, mut notes) = (Vec::new(), Vec::new());
    for (b, body) in outfit.bodies.iter().enumerate() {
        let members: Vec<usize> =
            (0..outfit.garments.len()).filter(|&g| outfit.garments[g].body == b).collect();
        if members.is_empty() {
            continue;
        }
        let unposed =
            unpose(&body.body.points, character, settings.transfer.unpose).map_err(transfer::Error::from)?;
        let target = unposed.as_ref().map_or(character, |u| &u.character);
        let found = cache.prepare(device, &body.body, &target.body, &settings.transfer)?;
        let pose = unposed.as_ref().map(|u| u.info.clone());
        notes.extend(pose.as_ref().map(|pose| pose_note(&body.path, pose)));
        flows.push(FlowReport { source: body.path.clone(), origin: found.origin, pose });
        notes.extend(found.note);
        let points: Vec<Vec3> =
            members.iter().flat_map(|&g| proxies[g].garment().points.iter().copied()).collect();
        let near = found.prepared.near(&points);
        let skin = unposed.as_ref().map(|u| OuterSkin::new(&u.character.body));
        for g in members {
            let garment = proxies[g].garment();
            let weld = &garment.groups.weld_of_vertex;
            let cloth = Cloth { points: &garment.points, triangles: &garment.triangles, weld };
            let carried = found.prepared.carry_cloth(device, &cloth).map_err(|e| e.within(&garment.path))?;
            let info = found.prepared.info(&carried, &near);
            let fitted = carried.points;
            let points = match unposed.as_ref().zip(skin.as_ref()) {
                Some((unposed, skin)) => bring_back(unposed, skin, &proxies[g], &fitted, settings)?,
                None => fitted.clone(),
            };
            results[g] = Some(CarriedGarment { points, fitted, info });
        }
        unposed_targets[b] = unposed.map(|u| u.character);
    }
    let garments = results.into_iter().map(|r| r.expect("every garment has a source body")).collect();
    Ok(CarriedOutfit { garments, unposed: unposed_targets, flows, notes })
}

/// Takes a garment on the unposed target to the target's own pose, with skin weights of its own.
fn bring_back(
    unposed: &Unposed,
    body: &OuterSkin,
    proxy: &Proxy<'_>,
    fitted: &[Vec3],
    settings: &Settings,
) -> Result<Vec<Vec3>, Error> {
    let garment = proxy.garment();
    let (skin, _) = rig::run(&unposed.character, body, garment, fitted, &settings.rig)
        .map_err(|error| Error::Rig { garment: garment.path.clone(), error })?;
    Ok(unposed.pose(fitted, &skin))
}

fn pose_note(source: &str, pose: &PoseInfo) -> String {
    let joint = pose.joint.rsplit('/').next().unwrap_or(&pose.joint);
    format!(
        "the target stands in another pose than <{source}> ({joint} is turned by {:.0} degrees): garments \
         were fitted in the source's pose and brought back with their own skin weights",
        pose.angle_degrees
    )
}
