//! Dressed garments on a body in motion: `dressform simulate`.

use serde::Serialize;

use super::{Error, Progress, Settings};
use crate::device::{Device, DeviceInfo};
use crate::drape::follow::{self, Follower};
use crate::drape::{self, hold};
use crate::geometry::{OuterSkin, Surface};
use crate::model::{Character, Outfit, TriMesh, Vec3};
use crate::proxy::Proxy;

/// A body over time.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Points of the whole body at every frame [m], shape `[frames][points]`; the garments are on
    /// the body of the first.
    pub body: Vec<Vec<Vec3>>,
    /// Seconds from a frame to the next.
    pub seconds_per_frame: f64,
}

/// A garment over time.
#[derive(Clone, Debug)]
pub struct SimulatedGarment {
    /// Points of the source mesh at every frame [m], shape `[frames][points]`.
    pub frames: Vec<Vec<Vec3>>,
}

/// What was done to one garment.
#[derive(Clone, Debug, Serialize)]
pub struct SimulatedReport {
    /// Its path.
    pub path: String,
    /// Frames after which an edge of it passed through the body, a lower layer or itself.
    pub crossed_frames: usize,
    /// The account.
    pub drape: follow::Info,
}

/// What [`simulate`] makes.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// Garments in the outfit's order.
    pub garments: Vec<SimulatedGarment>,
    /// Where the kernels ran.
    pub device: DeviceInfo,
    /// Reports in the outfit's order.
    pub reports: Vec<SimulatedReport>,
}

/// Simulates a dressed outfit on a body that moves.
///
/// The garments are where the outfit has them, their rest shapes are its panels, and the rest
/// angles of seams those at the start. Bands are held that lie on the body at the start.
///
/// # Errors
/// Frames without a point for each of the body's, an outfit that cannot be simulated, or a
/// device's failure.
pub fn simulate(
    outfit: &Outfit,
    character: &Character,
    motion: &Motion,
    settings: &Settings,
    device: &Device,
    progress: &mut Progress<'_>,
) -> Result<Simulated, Error> {
    check(character, motion)?;
    let skin = OuterSkin::new(&character.body);
    let at = |frame: &[Vec3]| -> Vec<Vec3> { skin.point_of.iter().map(|&i| frame[i as usize]).collect() };
    let first = motion.body.first().map_or_else(Vec::new, |frame| at(frame));
    let body = Surface::new(TriMesh { points: first, triangles: skin.surface.mesh().triangles.clone() });
    let mut order: Vec<usize> = (0..outfit.garments.len()).collect();
    order.sort_by_key(|&g| outfit.garments[g].layer);
    let proxies = order
        .iter()
        .map(|&g| Proxy::new(&outfit.garments[g], &settings.proxy))
        .collect::<Result<Vec<_>, _>>()?;
    let held: Vec<Vec<hold::Band>> =
        proxies.iter().map(|p| hold::find(p.garment(), &body, &settings.drape.hold)).collect();
    let surfaces: Vec<Surface> =
        proxies.iter().map(|p| Surface::new(p.garment().welded_mesh(&p.garment().points))).collect();
    let (solids, layers): (Vec<&Surface>, Vec<&Surface>) = (vec![&body], surfaces.iter().collect());
    let inputs: Vec<drape::Input<'_>> = (0..proxies.len())
        .map(|l| drape::Input {
            garment: proxies[l].garment(),
            points: &proxies[l].garment().points,
            pattern: &proxies[l].garment().pattern,
            colliders: &solids,
            layers: &layers[..l],
            pinned: &[],
            held: &held[l],
        })
        .collect();
    let failed = |error| Error::Drape { garment: character.path.clone(), error };
    let mut follower = Follower::new(device, &inputs, &settings.drape).map_err(failed)?;
    let mut garments: Vec<SimulatedGarment> =
        outfit.garments.iter().map(|g| SimulatedGarment { frames: vec![g.source_points.clone()] }).collect();
    let mut crossed = vec![0; order.len()];
    let steps = motion.body.len().saturating_sub(1);
    for (i, frame) in motion.body.iter().skip(1).enumerate() {
        progress("simulate", i as f64 / steps as f64);
        let to = at(frame);
        follower.advance(std::slice::from_ref(&to), motion.seconds_per_frame).map_err(failed)?;
        let now = Surface::new(TriMesh { points: to, triangles: body.mesh().triangles.clone() });
        let mut finished: Vec<Surface> = Vec::new();
        for (l, points) in follower.points().iter().enumerate() {
            let garment = &outfit.garments[order[l]];
            let below: Vec<&Surface> = std::iter::once(&now).chain(&finished).collect();
            let (points, _) = proxies[l].restore(points, &below);
            garments[order[l]].frames.push(garment.scatter_points(&points));
            crossed[l] += usize::from(follower.infos()[l].crossings != [0, 0]);
            finished.push(Surface::new(garment.welded_mesh(&points)));
        }
    }
    progress("simulate", 1.0);
    let mut reports: Vec<(usize, SimulatedReport)> = (0..order.len())
        .map(|l| {
            let (path, drape) = (outfit.garments[order[l]].path.clone(), follower.infos()[l].clone());
            (order[l], SimulatedReport { path, crossed_frames: crossed[l], drape })
        })
        .collect();
    reports.sort_by_key(|(g, _)| *g);
    let reports = reports.into_iter().map(|(_, report)| report).collect();
    Ok(Simulated { garments, device: device.info(), reports })
}

fn check(character: &Character, motion: &Motion) -> Result<(), Error> {
    let expected = character.body.points.len();
    match motion.body.iter().position(|frame| frame.len() != expected) {
        Some(frame) => Err(Error::Motion { frame, found: motion.body[frame].len(), expected }),
        None => Ok(()),
    }
}
