//! The account of a fit.

use serde::Serialize;

use super::carry::FlowReport;
use crate::certificate::{self, Certificate, Thresholds};
use crate::device::DeviceInfo;
use crate::measure::Ease;
use crate::{drape, pattern, proxy, rig, transfer};

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

impl GarmentReport {
    /// Thresholds that the garment breaks, in words.
    pub(super) fn broken(&self, thresholds: &Thresholds) -> Vec<String> {
        let stages = certificate::StageFigures {
            gap_p99_m: Some(self.transfer.gap_p99_m),
            transfer_converged: Some(self.transfer.converged),
            flipped_triangles: Some(self.pattern.flipped_triangles),
            seam_mismatch_max: Some(self.pattern.seam_mismatch_max),
            drape_converged: Some(self.drape.converged),
            details_inside: Some(self.proxy.inside),
            detail_offset_change: Some(self.proxy.offset_change()),
        };
        thresholds.broken(&self.name, &self.certificate, &stages)
    }
}
