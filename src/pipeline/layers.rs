//! Layer after layer onto the body.

use super::carry::CarriedGarment;
use super::{Error, Progress, Settings};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::{Outfit, Vec2, Vec3};
use crate::proxy::Proxy;
use crate::{drape, pattern, proxy};

/// What garments lie on.
pub(super) struct Ground<'a> {
    /// The target's outer skin, shoes.
    pub solids: Vec<&'a Surface>,
    /// Outer skins of the source bodies.
    pub sources: Vec<&'a Surface>,
}

/// A garment with its details, draped.
pub(super) struct Draped {
    /// Vertices [m].
    pub points: Vec<Vec3>,
    /// Turned with the cloth [m].
    pub rest_offsets: Vec<Vec3>,
    /// Vertices that follow the proxy.
    pub bound: Vec<bool>,
    pub info: drape::Info,
    pub held: Vec<drape::hold::Held>,
    pub proxy: proxy::Info,
}

/// Drapes layer after layer on the solids; finished garments, details and all, are colliders of
/// the next (paper, algorithm 1 and section 6).
#[expect(clippy::too_many_arguments, reason = "every stage before has a say")]
pub(super) fn drape_all(
    outfit: &Outfit,
    proxies: &[Proxy<'_>],
    ground: &Ground<'_>,
    transferred: &[CarriedGarment],
    patterns: &[(Vec<Vec2>, pattern::Info)],
    settings: &Settings,
    device: &Device,
    progress: &mut Progress<'_>,
) -> Result<Vec<Draped>, Error> {
    let mut order: Vec<usize> = (0..outfit.garments.len()).collect();
    order.sort_by_key(|&g| outfit.garments[g].layer);
    let mut finished: Vec<Surface> = Vec::new();
    let mut outputs: Vec<Option<Draped>> = outfit.garments.iter().map(|_| None).collect();
    for (done, &g) in order.iter().enumerate() {
        let garment = &outfit.garments[g];
        let layers: Vec<&Surface> = finished.iter().collect();
        let on_source = ground.sources[garment.body];
        let held = drape::hold::find(proxies[g].garment(), on_source, &settings.drape.hold);
        let input = drape::Input {
            garment: proxies[g].garment(),
            points: &transferred[g].points,
            pattern: &proxies[g].gather(&patterns[g].0),
            colliders: &ground.solids,
            layers: &layers,
            pinned: &[],
            held: &held,
        };
        let count = order.len() as f64;
        progress("drape", done as f64 / count);
        let mut report = |now: &drape::Moment<'_>| progress("drape", (done as f64 + now.share) / count);
        let output = drape::run_with_progress(device, &input, &settings.drape, &mut report)
            .map_err(|error| Error::Drape { garment: garment.path.clone(), error })?;
        let (points, proxy) = proxies[g].restore(&output.points, &[&ground.solids[..], &layers].concat());
        // Details are where their bonds put them, which the proxy's account judges.
        let now = garment.groups.offsets(&points);
        let rest_offsets = proxies[g].scatter(&output.rest_offsets, |v| now[v]);
        let bound = proxies[g].scatter(&vec![false; output.points.len()], |_| true);
        finished.push(Surface::new(garment.welded_mesh(&points)));
        outputs[g] =
            Some(Draped { points, rest_offsets, bound, info: output.info, held: output.held, proxy });
    }
    progress("drape", 1.0);
    Ok(outputs.into_iter().map(|o| o.expect("every garment was draped")).collect())
}
