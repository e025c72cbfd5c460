//! Every garment from its own source body to the target.

use serde::Serialize;

use super::{Error, Settings};
use crate::device::Device;
use crate::model::{Character, Outfit, Vec3};
use crate::proxy::Proxy;
use crate::transfer::cache::Origin;
use crate::transfer::{self, Cache};

/// The flow from one source body to the target.
#[derive(Clone, Debug, Serialize)]
pub struct FlowReport {
    /// Path of the source body.
    pub source: String,
    /// Whether it was solved now, or where it was found.
    pub origin: Origin,
}

/// What became of the garments.
pub(super) struct CarriedOutfit {
    /// Points [m] and account of each garment's proxy, in the outfit's order.
    pub garments: Vec<(Vec<Vec3>, transfer::Info)>,
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
    let (mut flows, mut notes) = (Vec::new(), Vec::new());
    for (b, body) in outfit.bodies.iter().enumerate() {
        let members: Vec<usize> =
            (0..outfit.garments.len()).filter(|&g| outfit.garments[g].body == b).collect();
        if members.is_empty() {
            continue;
        }
        let found = cache.prepare(device, &body.body, &character.body, &settings.transfer)?;
        flows.push(FlowReport { source: body.path.clone(), origin: found.origin });
        notes.extend(found.note);
        let points: Vec<Vec3> =
            members.iter().flat_map(|&g| proxies[g].garment().points.iter().copied()).collect();
        let gap = found.prepared.gap_near(&points);
        for g in members {
            let garment = proxies[g].garment();
            let carried =
                found.prepared.carry(device, &garment.points).map_err(|e| e.within(&garment.path))?;
            let info = found.prepared.info(&carried, &gap);
            results[g] = Some((carried.points, info));
        }
    }
    let garments = results.into_iter().map(|r| r.expect("every garment has a source body")).collect();
    Ok(CarriedOutfit { garments, flows, notes })
}
