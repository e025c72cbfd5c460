//! The whole way of an outfit onto a character; the only file that knows every stage.
//!
//! Proxies (paper 6) leave pockets and trims out until a layer is done. Transfer (4.1) carries
//! every garment from its source body to the target, the pattern refit (4.2) gives each its new
//! panels, the draper (5) settles the layers one after the other on the body and on what already
//! lies there, details included, and the rig (7) gives them skin weights. The certificate
//! measures the result with tests of its own.

mod animate;
mod carry;
mod certify;
mod ease;
mod error;
mod layers;
mod report;
mod rigged;
mod shapes;

use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::certificate::{self, Certificate, Thresholds};
use crate::device::Device;
use crate::geometry::{OuterSkin, Surface};
use crate::measure::{self, Ease};
use crate::model::{BlendShape, Character, Garment, Outfit, Skin, Vec2, Vec3};
use crate::proxy::{self, Proxy};
use crate::transfer::{self, Cache};
use crate::{drape, pattern, rig};
pub use animate::{Motion, Simulated, SimulatedGarment, SimulatedReport, simulate};
use carry::CarriedGarment;
pub use carry::FlowReport;
pub use error::Error;
use layers::Draped;
pub use report::{GarmentReport, Report, Seconds};

/// Every setting of every stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Detail panels.
    pub proxy: proxy::Params,
    /// 3D transfer.
    pub transfer: transfer::Params,
    /// Pattern refit.
    pub pattern: pattern::Params,
    /// Ease by measurement.
    pub ease: measure::Params,
    /// Draper.
    pub drape: drape::Params,
    /// Rig.
    pub rig: rig::Params,
    /// Blend shapes of the body.
    pub blend_shapes: rig::blend_shapes::Params,
    /// Check of the weights in poses.
    pub posed: certificate::posed::Params,
    /// What makes a result pass.
    pub thresholds: Thresholds,
}

/// A garment on its new body.
#[derive(Clone, Debug)]
pub struct DressedGarment {
    /// Points of the source mesh, on the target [m].
    pub points: Vec<Vec3>,
    /// Vertices (one for each distinct point and panel position), on the target [m].
    pub vertex_points: Vec<Vec3>,
    /// Refitted panels, per vertex [m].
    pub pattern: Vec<Vec2>,
    /// Refitted panels, per triangle corner [m].
    pub corner_pattern: Vec<[Vec2; 3]>,
    /// Skin weights, per point of the source mesh.
    pub skin: Skin,
    /// The body's blend shapes that move it, per point of the source mesh.
    pub blend_shapes: Vec<BlendShape>,
}

/// What [`fit`] makes.
#[derive(Clone, Debug)]
pub struct Dressed {
    /// Garments in the outfit's order.
    pub garments: Vec<DressedGarment>,
    /// The account.
    pub report: Report,
}

/// Told at every step: the stage (`transfer`, `pattern`, `drape`, `rig`, `certify`) and how
/// much of it is done, 0 to 1.
pub type Progress<'a> = dyn FnMut(&str, f64) + 'a;

/// Fits an outfit to a character; flows between bodies are kept in `cache`.
///
/// # Errors
/// Input that cannot be worked on, or a device's failure; see [`Error`]. A result that falls
/// short of a threshold is no error: the report says it.
pub fn fit(
    outfit: &Outfit,
    character: &Character,
    settings: &Settings,
    device: &Device,
    cache: &Cache,
    progress: &mut Progress<'_>,
) -> Result<Dressed, Error> {
    let started = Instant::now();
    let mut seconds = Seconds::default();
    for garment in &outfit.garments {
        check_body(outfit, garment, character)?;
    }
    settings.ease.check()?;
    let proxies = outfit
        .garments
        .iter()
        .map(|garment| Proxy::new(garment, &settings.proxy))
        .collect::<Result<Vec<_>, _>>()?;
    let (poses, pose_notes) = certify::poses(character, settings)?;

    progress("transfer", 0.0);
    let clock = Instant::now();
    let carried = carry::carry_all(outfit, &proxies, character, settings, device, cache)?;
    seconds.transfer = clock.elapsed().as_secs_f64();
    progress("transfer", 1.0);

    let clock = Instant::now();
    let tapes = ease::Tapes::new(outfit, character, &carried.unposed, &settings.ease);
    let patterns = refit_all(outfit, &proxies, &carried.garments, &tapes, settings, progress)?;
    seconds.pattern = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let body = OuterSkin::new(&character.body);
    let sources: Vec<OuterSkin> = outfit.bodies.iter().map(|b| OuterSkin::new(&b.body)).collect();
    let colliders: Vec<Surface> = character.colliders.iter().map(|c| Surface::new(c.mesh.clone())).collect();
    let ground = layers::Ground {
        solids: std::iter::once(&body.surface).chain(&colliders).collect(),
        sources: sources.iter().map(|s| &s.surface).collect(),
    };
    let draped = layers::drape_all(
        outfit,
        &proxies,
        &ground,
        &carried.garments,
        &patterns,
        settings,
        device,
        progress,
    )?;
    seconds.drape = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let skins = rigged::rig_all(outfit, &proxies, character, &body, &draped, settings, progress)?;
    seconds.rig = clock.elapsed().as_secs_f64();
    let joint_notes = rigged::notes(outfit, &skins);
    progress("rig", 1.0);

    progress("certify", 0.0);
    let clock = Instant::now();
    let certificates = certify::run(outfit, &sources, character, &body, &draped, &patterns, &skins, &poses);
    let eases: Vec<Ease> = (0..outfit.garments.len())
        .map(|g| tapes.measure(&proxies[g], &carried.garments[g].fitted, &draped[g].points, &patterns[g].0))
        .collect();
    seconds.certify = clock.elapsed().as_secs_f64();
    progress("certify", 1.0);

    let mut notes: Vec<String> = proxies.iter().flat_map(Proxy::notes).collect();
    notes.extend(carried.notes.into_iter().chain(pose_notes).chain(joint_notes));
    let parts =
        carried.garments.into_iter().zip(patterns).zip(draped).zip(skins).zip(certificates).zip(eases);
    let (mut garments, mut reports, mut broken) = (Vec::new(), Vec::new(), Vec::new());
    for (g, (((((transferred, pattern), draped), skin), certificate), ease)) in parts.enumerate() {
        let garment = &outfit.garments[g];
        let blend_shapes = shapes::run(character, &body, &proxies[g], garment, &draped, settings);
        let finished = Finished { transferred, pattern, draped, skin, blend_shapes, certificate, ease };
        let (dressed, report) = finished.split(garment);
        broken.extend(report.broken(&settings.thresholds));
        garments.push(dressed);
        reports.push(report);
    }
    seconds.total = started.elapsed().as_secs_f64();
    let (device, passed) = (device.info(), broken.is_empty());
    let report = Report { device, passed, broken, seconds, flows: carried.flows, notes, garments: reports };
    Ok(Dressed { garments, report })
}

/// New panels of every garment.
fn refit_all(
    outfit: &Outfit,
    proxies: &[Proxy<'_>],
    transferred: &[CarriedGarment],
    tapes: &ease::Tapes<'_>,
    settings: &Settings,
    progress: &mut Progress<'_>,
) -> Result<Vec<(Vec<Vec2>, pattern::Info)>, Error> {
    let mut patterns = Vec::new();
    for (g, garment) in outfit.garments.iter().enumerate() {
        progress("pattern", g as f64 / outfit.garments.len() as f64);
        let refitted = proxies[g]
            .refit(&transferred[g].fitted, &settings.pattern, tapes.holding(garment).as_ref())
            .map_err(|error| Error::Pattern { garment: garment.path.clone(), error })?;
        patterns.push(refitted);
    }
    progress("pattern", 1.0);
    Ok(patterns)
}

/// What every stage made of one garment.
struct Finished {
    transferred: CarriedGarment,
    pattern: (Vec<Vec2>, pattern::Info),
    draped: Draped,
    skin: (Skin, rig::Info),
    blend_shapes: Vec<BlendShape>,
    certificate: Certificate,
    ease: Ease,
}

impl Finished {
    /// What is written, and what is said of it.
    fn split(self, garment: &Garment) -> (DressedGarment, GarmentReport) {
        let Finished { transferred, pattern, draped, skin, blend_shapes, certificate, ease } = self;
        let report = GarmentReport {
            name: garment.name.clone(),
            path: garment.path.clone(),
            layer: garment.layer,
            vertices: garment.point_count,
            triangles: garment.triangles.len(),
            panels: garment.panels.len(),
            seams: garment.seams.len(),
            proxy: draped.proxy,
            transfer: transferred.info,
            pattern: pattern.1,
            ease,
            drape: draped.info,
            held: draped.held,
            rig: skin.1,
            blend_shapes: blend_shapes.iter().map(|shape| shape.name.clone()).collect(),
            certificate,
        };
        let dressed = DressedGarment {
            points: garment.scatter_points(&draped.points),
            corner_pattern: garment.triangles.iter().map(|t| t.map(|v| pattern.0[v as usize])).collect(),
            skin: garment.scatter_skin(&skin.0),
            blend_shapes,
            vertex_points: draped.points,
            pattern: pattern.0,
        };
        (dressed, report)
    }
}

/// The paper assumes one topology for source and target; anything else is refused here.
fn check_body(outfit: &Outfit, garment: &Garment, character: &Character) -> Result<(), Error> {
    let source = outfit.bodies.get(garment.body).ok_or_else(|| Error::NoBody {
        garment: garment.path.clone(),
        body: garment.body,
        count: outfit.bodies.len(),
    })?;
    let differs = |what, found, expected, element| Error::Topology {
        source_path: source.path.clone(),
        target_path: character.path.clone(),
        what,
        found,
        expected,
        element,
    };
    let (s, t) = (&source.body, &character.body);
    if s.points.len() != t.points.len() {
        return Err(differs("vertices", t.points.len(), s.points.len(), None));
    }
    if s.triangles.len() != t.triangles.len() {
        return Err(differs("triangles", t.triangles.len(), s.triangles.len(), None));
    }
    match (0..s.triangles.len()).find(|&i| s.triangles[i] != t.triangles[i]) {
        Some(i) => {
            let k = (0..3).find(|&k| s.triangles[i][k] != t.triangles[i][k]).unwrap_or(0);
            let (found, expected) = (t.triangles[i][k] as usize, s.triangles[i][k] as usize);
            Err(differs("triangle corners", found, expected, Some(i)))
        }
        None => Ok(()),
    }
}
