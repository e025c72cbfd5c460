//! Carrying garments to a new body (paper section 4.1, 3D Mesh Transfer).
//!
//! The displacement that takes the source body to the target is spread through the space
//! around it as a slow, viscous, weakly compressible flow, and the garment drifts along:
//!
//! ```text
//! -div(nu D(u)) + grad p = 0                            around the body
//! -min(0, det(I + grad u) - 1) - gamma p = 0            compression is resisted, growth is not
//! u = u_body                                            on the body, by a penalty beta
//! ```
//!
//! Trilinear displacement and one pressure per cell, on a sparse regular grid in a narrow
//! band around the body ([`activity`], [`domain`], [`element`]). Eliminating the pressure
//! leaves `A + B^T (gamma M_p)^-1 B` ([`terms`], [`stencil`]), which conjugate gradients with
//! a multigrid cycle ([`multigrid`]) invert in a fixed-point loop over the nonlinear volume
//! term ([`field`], [`volume`]). The boundary condition is weak, by closest-point quadrature
//! ([`boundary`]); so the moved body misses its target by a little. What it misses is asked for once
//! more on the same cells, and an *outer* loop starts again from where the body came to, until the gap
//! is closed.
//!
//! # Scales
//! With `h` the side of a cell, only `nu gamma` (the volume's stiffness against shear) and
//! `beta h^2 / nu` (the boundary's against viscosity) matter: `nu` = 100 and `gamma` = 0.01
//! give a ratio of 1, `beta` = 1e6 at 2 cm gives 4.
//!
//! # What differs from the paper
//! - Momentum is `-div(nu D(u)) + grad p`; the printed form lacks the divergence.
//! - The best rigid motion is taken out first, and with it what exceeds a tenth in size
//!   ([`align`]).
//! - What lies inside of the body hardly counts: cells deep inside have no volume term and a tenth of
//!   the viscosity, cut cells the share that lies outside, and the boundary condition is asked for on
//!   the surface alone ([`terms`], [`boundary`]). With the paper's, cells of 5 mm are as near to the
//!   solution with fine cells as 6.7 mm ones are so.
//! - The band's stiffness fades out towards its end ([`activity`]): a band that ends at once moves
//!   cloth 8 cm from the skin by millimetres with the size of the cells.
//! - The band depends on the body pair alone, and so does the number of outer loops. A
//!   garment that reaches beyond is given cells of its own ([`extension`]), so its result
//!   does not change with its outfit-mates.
//! - The first flow is solved once more on finer cells near the skin ([`refine`]).
//! - Further outer iterations *close* what is left by a mean over the skin nearby ([`closing`]), not by
//!   a flow: what cells miss dies off within less than they are wide, and a flow on them would push
//!   cloth a centimetre away by what the skin alone misses.
//! - The skin's long edges are split, so that what is missed is known between the body's vertices too
//!   ([`outer`]).
//! - Where closing after the band's own cells may reach the gap asked for, and that is a millimetre or
//!   more, it is tried before anything is refined: a gap of 2 mm costs a tenth of one of 0.4 mm.
//! - What the gap leaves in creases of the target is named ([`folds`]).
//! - The flow moves points. Triangles that cut the skin between them are lifted out of it ([`clear`]).
//! - The bias starts anew in every outer loop, so compression that was accepted before is
//!   forgotten. The *composed* map's deformation gradient is therefore carried along with
//!   each garment vertex, and its smallest determinant is reported.
//! - A target in another pose than its source is unposed first ([`pose`]).
//! - Only the body's outer skin is a boundary: eyes, teeth and tongue are left out.

pub mod activity;
pub mod align;
mod anderson;
pub mod boundary;
pub mod cache;
pub mod clear;
mod closing;
pub mod domain;
pub mod element;
pub mod exact;
pub mod extension;
pub mod field;
pub mod folds;
pub mod gap;
pub mod multigrid;
mod outer;
mod params;
pub mod pose;
pub mod prepared;
mod refine;
pub mod stencil;
mod store;
pub mod terms;
#[cfg(test)]
mod tests;
mod turn;
pub mod volume;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::device::{Device, DeviceError, Kernel};
use crate::model::{TriMesh, Vec3};
pub use cache::Cache;
use field::InnerInfo;
pub use params::Params;
pub use prepared::{Carried, Near, Prepared};

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = {
    let [relax, start, restrict, prolong] = multigrid::KERNELS;
    &[&stencil::STENCIL, &volume::PRESSURE, &volume::RESIDUAL, relax, start, restrict, prolong]
};

/// What is carried where.
#[derive(Clone, Debug)]
pub struct Input<'a> {
    /// The body that the garments were made on.
    pub source: &'a TriMesh,
    /// The body to dress: for each source point, the point that it goes to.
    pub target: &'a TriMesh,
    /// Points of each garment on the source body [m].
    pub garments: Vec<&'a [Vec3]>,
}

/// Why the outer loop ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// The gap is closed.
    Reached,
    /// A further outer loop did not bring the body nearer.
    Stalled,
    /// The most outer iterations were made.
    Limit,
}

/// What the transfer of one garment achieved; gaps are measured on the outer skin within
/// [`Params::near`] of any garment and weighted by area.
#[derive(Clone, Debug, Serialize)]
pub struct Info {
    /// Largest gap [m].
    pub gap_max_m: f64,
    /// 99th percentile of the gap [m].
    pub gap_p99_m: f64,
    /// Mean gap [m].
    pub gap_mean_m: f64,
    /// 99th percentile of the gap over the whole body, inner parts included [m].
    pub body_gap_p99_m: f64,
    /// 99th percentile of the gap over the outer skin, which ends the outer loop [m].
    pub skin_gap_p99_m: f64,
    /// Active cells in the last outer iteration, the garment's extension included.
    pub active_cells: usize,
    /// Finer cells near the skin.
    pub refined_cells: usize,
    /// Outer iterations, closing ones included.
    pub outer_iterations: usize,
    /// Conjugate gradient iterations in all, the garment's extensions included.
    pub cg_iterations: usize,
    /// Whether the gap is accepted and every inner loop converged.
    pub converged: bool,
    /// Why the outer loop ended.
    pub stop: Stop,
    /// Smallest determinant of the composed map's gradient over the garment's points.
    pub determinant_min: f64,
    /// Points of the garment inside the target body.
    pub points_inside: usize,
    /// Pairs of triangles of garment and skin that meet and did not on the source.
    pub skin_pairs: usize,
    /// Farthest that a point was lifted so that its triangles leave the skin [m].
    pub lift_max_m: f64,
    /// 99th percentile of the outer skin's gap after each outer iteration [m].
    pub skin_gaps_p99_m: Vec<f64>,
    /// Where the target's skin folds and the gap was not closed for it.
    pub folds: Vec<folds::Fold>,
    /// The inner loop of each flow that was solved.
    pub inner: Vec<InnerInfo>,
}

/// The garments on the target body.
#[derive(Clone, Debug)]
pub struct Output {
    /// Points of each garment [m].
    pub garments: Vec<Vec<Vec3>>,
    /// The moved source body [m].
    pub body: Vec<Vec3>,
    /// What was achieved, per garment.
    pub infos: Vec<Info>,
}

/// Why a transfer could not be made.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Error {
    /// The bodies do not correspond.
    #[error("the target body has {target} points, the source body {source_points}")]
    Topology {
        /// Points of the source body.
        source_points: usize,
        /// Points of the target body.
        target: usize,
    },
    /// A body without triangles.
    #[error("the source body has no triangles")]
    Empty,
    /// A triangle of the body names a point that is not there.
    #[error("triangle {element} of the source body names point {index} of {count}")]
    Index {
        /// The triangle.
        element: usize,
        /// The point it names.
        index: u32,
        /// Number of points.
        count: usize,
    },
    /// A coordinate is not finite.
    #[error("{what}, point {element}: not a finite number")]
    NotFinite {
        /// Which mesh.
        what: String,
        /// The point.
        element: usize,
    },
    /// A setting is out of range.
    #[error("transfer setting {name} is {value}: {expected}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        expected: &'static str,
    },
    /// A body of absurd size for the cell.
    #[error("the body needs {0:.0} x {1:.0} x {2:.0} grid cells: check its units or the cell size", cells[0], cells[1], cells[2])]
    TooLarge {
        /// Cells along each axis.
        cells: [f64; 3],
    },
    /// A garment's point is far from the body.
    #[error("{what}, point {element}: {distance:.3} m from the body, more than {reach:.3} m")]
    FarPoint {
        /// Which mesh.
        what: String,
        /// The point.
        element: usize,
        /// Its distance [m].
        distance: f64,
        /// The largest distance accepted [m].
        reach: f64,
    },
    /// The field blew up.
    #[error("the transfer field of outer iteration {outer} is not finite")]
    Diverged {
        /// The outer iteration, from 1.
        outer: usize,
    },
    /// The target cannot be taken to its source's pose.
    #[error(transparent)]
    Pose(#[from] pose::PoseError),
    /// The device failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

impl Error {
    /// The same error, with the name of the mesh whose points it is about.
    #[must_use]
    pub fn within(mut self, name: &str) -> Error {
        if let Error::FarPoint { what, .. } | Error::NotFinite { what, .. } = &mut self {
            name.clone_into(what);
        }
        self
    }
}

impl From<domain::TooLarge> for Error {
    fn from(e: domain::TooLarge) -> Self {
        Error::TooLarge { cells: e.cells }
    }
}

/// Solves the flow from a source body to a target: for each source point, the point that it
/// goes to. What comes back carries any number of garments.
///
/// # Errors
/// Bodies that do not fit together, settings out of range, or a device's failure. A gap that
/// could not be closed is no error: [`Info::converged`] says it.
pub fn prepare(
    device: &Device,
    source: &TriMesh,
    target: &TriMesh,
    params: &Params,
) -> Result<Prepared, Error> {
    params.validate()?;
    validate(source, target)?;
    outer::prepare(device, source, &target.points, params).map_err(|e| e.within("source body"))
}

/// Carries garments from the source body to the target.
///
/// # Errors
/// As [`prepare`] and [`Prepared::carry`].
pub fn run(device: &Device, input: &Input<'_>, params: &Params) -> Result<Output, Error> {
    for (g, points) in input.garments.iter().enumerate() {
        finite(&format!("garment {g}"), points)?;
    }
    let prepared = prepare(device, input.source, input.target, params)?;
    let near = prepared.near(&input.garments.concat());
    let mut output = Output { garments: Vec::new(), infos: Vec::new(), body: prepared.body().to_vec() };
    for (g, points) in input.garments.iter().enumerate() {
        let carried = prepared.carry(device, points).map_err(|e| e.within(&format!("garment {g}")))?;
        output.infos.push(prepared.info(&carried, &near));
        output.garments.push(carried.points);
    }
    Ok(output)
}

fn validate(source: &TriMesh, target: &TriMesh) -> Result<(), Error> {
    if source.points.len() != target.points.len() {
        let (source_points, target) = (source.points.len(), target.points.len());
        return Err(Error::Topology { source_points, target });
    }
    if source.triangles.is_empty() {
        return Err(Error::Empty);
    }
    let count = source.points.len();
    for (element, triangle) in source.triangles.iter().enumerate() {
        if let Some(&index) = triangle.iter().find(|&&i| i as usize >= count) {
            return Err(Error::Index { element, index, count });
        }
    }
    finite("source body", &source.points)?;
    finite("target body", &target.points)
}

fn finite(what: &str, points: &[Vec3]) -> Result<(), Error> {
    match points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        Some(element) => Err(Error::NotFinite { what: what.to_owned(), element }),
        None => Ok(()),
    }
}
