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
mod rigged;
mod shapes;

use std::time::Instant;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::certificate::{self, Certificate, Thresholds};
use crate::device::{Device, DeviceInfo};
use crate::drape;
use crate::drape::hold::Band;
use crate::geometry::skinning::SkinningError;
use crate::geometry::{OuterSkin, Surface};
use crate::measure::{self, Ease};
use crate::model::{BlendShape, Character, Garment, Outfit, Skin, Vec2, Vec3};
use crate::pattern;
use crate::proxy::{self, Proxy};
use crate::rig;
use crate::transfer::{self, Cache};
pub use animate::{Motion, Simulated, SimulatedGarment, SimulatedReport, simulate};
use carry::CarriedGarment;
pub use carry::FlowReport;

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

/// Seconds of each stage; what the caller does (reading, writing) is filled in by it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Seconds {
    pub read: f64,
    pub transfer: f64,
    pub pattern: f64,
    pub drape: f64,
    pub rig: f64,
    pub certify: f64,
    pub write: f64,
    pub total: f64,
}

/// What was done to one garment, and what came of it.
#[derive(Clone, Debug, Serialize)]
pub struct GarmentReport {
    /// Name of the garment.
    pub name: String,
    /// Its path in the outfit's stage.
    pub path: String,
    /// Its layer.
    pub layer: i32,
    /// Points of the source mesh.
    pub vertices: usize,
    /// Triangulated faces of the source mesh.
    pub triangles: usize,
    /// Panels.
    pub panels: usize,
    /// Authored seams.
    pub seams: usize,
    /// What was left out of transfer and drape, and how it came back.
    pub proxy: proxy::Info,
    /// The transfer's account.
    pub transfer: transfer::Info,
    /// The pattern refit's account.
    pub pattern: pattern::Info,
    /// Girths of the garment and of the bodies under it.
    pub ease: Ease,
    /// The draper's account.
    pub drape: drape::Info,
    /// What held its bands, and how hard.
    pub held: Vec<drape::hold::Held>,
    /// The rig's account.
    pub rig: rig::Info,
    /// Blend shapes of the body that were carried over.
    pub blend_shapes: Vec<String>,
    /// Measured by tests of its own.
    pub certificate: Certificate,
}

/// The account of a fit: the contract's JSON without what the caller adds.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Where the kernels ran.
    pub device: DeviceInfo,
    /// Whether no threshold was broken.
    pub passed: bool,
    /// Broken thresholds, in words.
    pub broken: Vec<String>,
    /// Time of each stage [s].
    pub seconds: Seconds,
    /// The flow from each source body.
    pub flows: Vec<FlowReport>,
    /// What the user should know and no threshold says.
    pub notes: Vec<String>,
    /// Garments in the outfit's order.
    pub garments: Vec<GarmentReport>,
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

/// Why an outfit could not be fitted.
#[derive(Debug, Error)]
pub enum Error {
    /// Source and target bodies do not correspond vertex by vertex.
    #[error(
        "{target_path}: {what} of the body differ from those of the source body {source_path}: \
         {found} instead of {expected}{}", element.map(|e| format!(" (first at {e})")).unwrap_or_default()
    )]
    Topology {
        /// The source body's path.
        source_path: String,
        /// The target body's path.
        target_path: String,
        /// `vertices`, `triangles` or `triangle corners`.
        what: &'static str,
        /// As the target has it.
        found: usize,
        /// As the source has it.
        expected: usize,
        /// First element that differs.
        element: Option<usize>,
    },
    /// A garment names a source body that the outfit does not have.
    #[error("{garment}: source body {body} is not among the outfit's {count}")]
    NoBody {
        /// The garment's path.
        garment: String,
        /// The index named.
        body: usize,
        /// Source bodies there are.
        count: usize,
    },
    /// A frame of a motion has another number of points than the body.
    #[error("frame {frame} of the body's motion has {found} points, the body {expected}")]
    Motion {
        /// The frame.
        frame: usize,
        /// As the frame has it.
        found: usize,
        /// As the body has it.
        expected: usize,
    },
    /// The skeleton cannot be posed.
    #[error("the skeleton cannot be posed: {0}")]
    Skeleton(#[from] SkinningError),
    /// A setting names a pose that is not there.
    #[error("posed.poses: there is no pose '{0}'")]
    UnknownPose(String),
    /// A garment has no proxy.
    #[error(transparent)]
    Proxy(#[from] proxy::Error),
    /// The transfer failed.
    #[error("transfer: {0}")]
    Transfer(#[from] transfer::Error),
    /// The pattern refit failed.
    #[error("{garment}: pattern: {error}")]
    Pattern {
        /// The garment's path.
        garment: String,
        /// Why.
        error: pattern::Error,
    },
    /// A girth cannot be held as the settings say.
    #[error(transparent)]
    Hold(#[from] measure::HoldError),
    /// The draper failed.
    #[error("{garment}: drape: {error}")]
    Drape {
        /// The garment's path.
        garment: String,
        /// Why.
        error: drape::Error,
    },
    /// The rig failed.
    #[error("{garment}: rig: {error}")]
    Rig {
        /// The garment's path.
        garment: String,
        /// Why.
        error: rig::Error,
    },
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
    let transferred = carried.garments;
    seconds.transfer = clock.elapsed().as_secs_f64();
    progress("transfer", 1.0);

    let clock = Instant::now();
    let tapes = ease::Tapes::new(outfit, character, &carried.unposed, &settings.ease);
    let mut patterns = Vec::new();
    for (g, garment) in outfit.garments.iter().enumerate() {
        progress("pattern", g as f64 / outfit.garments.len() as f64);
        let refitted = proxies[g]
            .refit(&transferred[g].fitted, &settings.pattern, tapes.holding(garment).as_ref())
            .map_err(|error| Error::Pattern { garment: garment.path.clone(), error })?;
        patterns.push(refitted);
    }
    seconds.pattern = clock.elapsed().as_secs_f64();
    progress("pattern", 1.0);

    let clock = Instant::now();
    let body = OuterSkin::new(&character.body);
    let colliders: Vec<Surface> = character.colliders.iter().map(|c| Surface::new(c.mesh.clone())).collect();
    let solids: Vec<&Surface> = std::iter::once(&body.surface).chain(&colliders).collect();
    let sources: Vec<OuterSkin> = outfit.bodies.iter().map(|b| OuterSkin::new(&b.body)).collect();
    let held: Vec<Vec<Band>> = (proxies.iter().zip(&outfit.garments))
        .map(|(p, g)| drape::hold::find(p.garment(), &sources[g.body].surface, &settings.drape.hold))
        .collect();
    let draped =
        drape_all(outfit, &proxies, &solids, &transferred, &patterns, &held, settings, device, progress)?;
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
        .map(|g| tapes.measure(&proxies[g], &transferred[g].fitted, &draped[g].points, &patterns[g].0))
        .collect();
    seconds.certify = clock.elapsed().as_secs_f64();
    progress("certify", 1.0);

    let mut garments = Vec::new();
    let mut reports = Vec::new();
    let mut broken = Vec::new();
    let parts = transferred.into_iter().zip(patterns).zip(draped).zip(skins).zip(certificates).zip(eases);
    for ((garment, proxy), (((((transferred, pattern), draped), skin), certificate), ease)) in
        outfit.garments.iter().zip(&proxies).zip(parts)
    {
        let blend_shapes = shapes::run(character, &body, proxy, garment, &draped, settings);
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
        broken.extend(broken_thresholds(&report, &settings.thresholds));
        garments.push(DressedGarment {
            points: garment.scatter_points(&draped.points),
            corner_pattern: garment.triangles.iter().map(|t| t.map(|v| pattern.0[v as usize])).collect(),
            skin: garment.scatter_skin(&skin.0),
            blend_shapes,
            vertex_points: draped.points,
            pattern: pattern.0,
        });
        reports.push(report);
    }
    seconds.total = started.elapsed().as_secs_f64();
    let passed = broken.is_empty();
    let report = Report {
        device: device.info(),
        passed,
        broken,
        seconds,
        flows: carried.flows,
        notes: proxies
            .iter()
            .flat_map(Proxy::notes)
            .chain(carried.notes)
            .chain(pose_notes)
            .chain(joint_notes)
            .collect(),
        garments: reports,
    };
    Ok(Dressed { garments, report })
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

/// A garment with its details, draped.
struct Draped {
    points: Vec<Vec3>,
    rest_offsets: Vec<Vec3>,
    /// Vertices that follow the proxy.
    bound: Vec<bool>,
    info: drape::Info,
    held: Vec<drape::hold::Held>,
    proxy: proxy::Info,
}

/// Drapes layer after layer on the solids; finished garments, details and all, are colliders of
/// the next (paper, algorithm 1 and section 6).
#[expect(clippy::too_many_arguments, reason = "every stage before has a say")]
fn drape_all(
    outfit: &Outfit,
    proxies: &[Proxy<'_>],
    solids: &[&Surface],
    transferred: &[CarriedGarment],
    patterns: &[(Vec<Vec2>, pattern::Info)],
    held: &[Vec<Band>],
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
        let input = drape::Input {
            garment: proxies[g].garment(),
            points: &transferred[g].points,
            pattern: &proxies[g].gather(&patterns[g].0),
            colliders: solids,
            layers: &layers,
            pinned: &[],
            held: &held[g],
        };
        let count = order.len() as f64;
        progress("drape", done as f64 / count);
        let mut report = |now: &drape::Moment<'_>| progress("drape", (done as f64 + now.share) / count);
        let output = drape::run_with_progress(device, &input, &settings.drape, &mut report)
            .map_err(|error| Error::Drape { garment: garment.path.clone(), error })?;
        let (points, proxy) = proxies[g].restore(&output.points, &[solids, &layers[..]].concat());
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

fn broken_thresholds(report: &GarmentReport, thresholds: &Thresholds) -> Vec<String> {
    let stages = certificate::StageFigures {
        gap_p99_m: Some(report.transfer.gap_p99_m),
        transfer_converged: Some(report.transfer.converged),
        flipped_triangles: Some(report.pattern.flipped_triangles),
        seam_mismatch_max: Some(report.pattern.seam_mismatch_max),
        drape_converged: Some(report.drape.converged),
        details_inside: Some(report.proxy.inside),
        detail_offset_change: Some(report.proxy.offset_change()),
    };
    thresholds.broken(&report.name, &report.certificate, &stages)
}
