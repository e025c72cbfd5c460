//! A transfer that is solved once for a pair of bodies and then carries any garment.
//!
//! The flow depends on the body pair alone: [`Prepared`] holds the fields and what closes the rest,
//! and a garment is carried by sampling one after the other. Where it lies beyond
//! the band it is given cells of its own ([`super::extension`]), which no other sees.

use std::sync::OnceLock;

use nalgebra::Matrix3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::align::Motion;
use super::boundary::is_inside;
use super::clear::{Cloth, Lift, clear};
use super::closing::Closing;
use super::extension::extend;
use super::field::{Field, InnerInfo};
use super::folds::{self, Fold};
use super::gap::{Gap, near};
use super::{Error, Info, Params, Stop, finite};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::{TriMesh, Vec3};

/// The body's outer skin.
#[derive(Debug)]
pub(super) struct Skin {
    pub triangles: Vec<[u32; 3]>,
    /// Index of each skin point in the body.
    pub of_body: Vec<u32>,
}

impl Skin {
    /// Those of the body's points that lie on the skin.
    pub fn of(&self, body: &[Vec3]) -> Vec<Vec3> {
        self.of_body.iter().map(|&i| body[i as usize]).collect()
    }

    pub fn mesh(&self, body: &[Vec3]) -> TriMesh {
        TriMesh { points: self.of(body), triangles: self.triangles.clone() }
    }
}

/// Points that drift along, with the gradient of the composed map at each.
#[derive(Clone)]
pub(super) struct Drift {
    pub points: Vec<Vec3>,
    gradient: Vec<Matrix3<f64>>,
    /// Cells of the last extension.
    extra_cells: usize,
    cg_iterations: usize,
    /// Whether all extensions converged.
    pub converged: bool,
}

impl Drift {
    pub fn new(points: &[Vec3], motion: &Motion) -> Drift {
        Drift {
            points: points.iter().map(|p| motion.apply(p)).collect(),
            gradient: vec![motion.linear; points.len()],
            extra_cells: 0,
            cg_iterations: 0,
            converged: true,
        }
    }

    /// Moves the points along with a closing.
    pub fn close(&mut self, closing: &Closing) {
        let moves = closing.sample_all(&self.points);
        for ((p, gradient), moved) in self.points.iter_mut().zip(&mut self.gradient).zip(moves) {
            if let Some((u, slope)) = moved {
                *p += u;
                *gradient = (Matrix3::identity() + slope) * *gradient;
            }
        }
    }

    fn determinant_min(&self) -> f64 {
        self.gradient.iter().map(Matrix3::determinant).fold(f64::INFINITY, f64::min)
    }
}

/// The flow of one outer iteration.
#[derive(Debug)]
pub(super) struct Step {
    pub field: Field,
    /// The same flow on finer cells near the skin, where it was refined.
    pub fine: Option<Field>,
    /// The skin's points at its start [m].
    pub skin: Vec<Vec3>,
    pub surface: OnceLock<Surface>,
}

impl Step {
    pub fn new(field: Field, surface: Surface) -> Step {
        Step { field, fine: None, skin: surface.mesh().points.clone(), surface: surface.into() }
    }

    /// As read from a file: the surface is made when it is asked for.
    pub fn stored(field: Field, fine: Option<Field>, skin: Vec<Vec3>) -> Step {
        Step { field, fine, skin, surface: OnceLock::new() }
    }

    /// Moves points along with the field and its extension to them.
    pub fn advect(
        &self,
        device: &Device,
        flow: &Flow,
        skin: &[[u32; 3]],
        drift: &mut Drift,
    ) -> Result<(), Error> {
        let surface = || {
            self.surface
                .get_or_init(|| Surface::new(TriMesh { points: self.skin.clone(), triangles: skin.to_vec() }))
        };
        let extension = extend(device, &flow.params, &self.field, surface, &drift.points, flow.reach)?;
        if let Some((extra, info)) = &extension {
            drift.extra_cells = extra.domain.cells.len();
            drift.cg_iterations += info.cg_iterations.iter().sum::<usize>();
            drift.converged &= info.converged;
        } else {
            drift.extra_cells = 0;
        }
        for (p, gradient) in drift.points.iter_mut().zip(&mut drift.gradient) {
            let beyond = || extension.as_ref().and_then(|(extra, _)| extra.sample(p));
            let fine = self.fine.as_ref().and_then(|fine| fine.sample(p));
            let sampled = fine.or_else(|| self.field.sample(p)).or_else(beyond);
            let (u, slope) = sampled.expect("every point has an active cell");
            *p += u;
            *gradient = (Matrix3::identity() + slope) * *gradient;
        }
        Ok(())
    }
}

/// From the source to the target: a motion, the steps, then the closings.
#[derive(Debug)]
pub(super) struct Flow {
    pub params: Params,
    pub motion: Motion,
    /// Farthest that a point may be from the body [m].
    pub reach: f64,
    pub steps: Vec<Step>,
    pub closings: Vec<Closing>,
}

/// What the outer loop did.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Course {
    pub inner: Vec<InnerInfo>,
    /// 99th percentile of the skin's gap after each outer iteration [m].
    pub gaps: Vec<f64>,
    pub stop: Stop,
}

/// The flow from a source body to a target, solved and ready to carry garments.
#[derive(Debug)]
pub struct Prepared {
    pub(super) flow: Flow,
    pub(super) skin: Skin,
    pub(super) source_skin: Vec<Vec3>,
    pub(super) target_skin: Vec<Vec3>,
    pub(super) areas: Vec<f64>,
    pub(super) course: Course,
    pub(super) body: Vec<Vec3>,
    pub(super) body_gap: Gap,
    pub(super) body_converged: bool,
    pub(super) target_surface: OnceLock<Surface>,
}

/// How the skin near an outfit met the target.
#[derive(Clone, Debug)]
pub struct Near {
    /// Distance of the moved skin from the target's.
    pub gap: Gap,
    /// Where the target's skin folds and the gap was not closed for it.
    pub folds: Vec<Fold>,
}

/// A garment that was carried.
#[derive(Clone, Debug)]
pub struct Carried {
    /// Its points on the target [m].
    pub points: Vec<Vec3>,
    /// Cells of its own in the last outer iteration.
    pub extra_cells: usize,
    /// Conjugate gradient iterations for those.
    pub cg_iterations: usize,
    /// Whether the solves for those converged.
    pub converged: bool,
    /// Smallest determinant of the composed map's gradient over its points.
    pub determinant_min: f64,
    /// Points inside the target body, before anything is lifted.
    pub points_inside: usize,
    /// What was lifted out of the skin.
    pub lift: Lift,
}

impl Prepared {
    /// The source body as it was moved [m].
    pub fn body(&self) -> &[Vec3] {
        &self.body
    }

    /// Memory that it takes, roughly, with the surfaces that it makes when asked [bytes].
    pub fn bytes(&self) -> usize {
        let field = |field: &Field| field.domain.bytes() + size_of::<Vec3>() * field.displacement.len();
        let of_step = |step: &Step| field(&step.field) + step.fine.as_ref().map_or(0, field);
        let grids = self.flow.steps.iter().map(of_step);
        let surfaces = (self.flow.steps.len() + 1) * 400 * self.skin.triangles.len();
        let closings = 60 * self.flow.closings.len() * self.skin.of_body.len();
        grids.sum::<usize>() + surfaces + closings + 120 * self.body.len()
    }

    /// Carries a garment's points, shape `[n, 3]` [m].
    ///
    /// # Errors
    /// A point that is not finite or farther from the body than the body is large (of a mesh
    /// without a name, see [`Error::within`]), or a device's failure.
    pub fn carry(&self, device: &Device, points: &[Vec3]) -> Result<Carried, Error> {
        finite("", points)?;
        let mut drift = Drift::new(points, &self.flow.motion);
        for step in &self.flow.steps {
            step.advect(device, &self.flow, &self.skin.triangles, &mut drift)?;
        }
        self.flow.closings.iter().for_each(|closing| drift.close(closing));
        let target = self.target_surface();
        Ok(Carried {
            extra_cells: drift.extra_cells,
            cg_iterations: drift.cg_iterations,
            converged: drift.converged,
            determinant_min: drift.determinant_min(),
            points_inside: drift.points.par_iter().filter(|p| is_inside(target, p)).count(),
            points: drift.points,
            lift: Lift::default(),
        })
    }

    /// Carries a garment and lifts it where it cuts the target's skin and did not cut the source's
    /// ([`clear`]).
    ///
    /// # Errors
    /// As [`Prepared::carry`].
    pub fn carry_cloth(&self, device: &Device, cloth: &Cloth<'_>) -> Result<Carried, Error> {
        let mut carried = self.carry(device, cloth.points)?;
        let source = || {
            let (points, triangles) = (self.source_skin.clone(), self.skin.triangles.clone());
            Surface::new(TriMesh { points, triangles })
        };
        carried.lift = clear(cloth, &mut carried.points, self.target_surface(), source);
        Ok(carried)
    }

    /// How the outer skin within [`Params::near`] of any point of an outfit (its garments'
    /// points on the source body [m]) met the target; all of the skin without points.
    pub fn near(&self, garments: &[Vec3]) -> Near {
        let mut weights = self.areas.clone();
        if !garments.is_empty() {
            let close = near(&self.source_skin, garments, self.flow.params.near);
            weights.iter_mut().zip(close).filter(|(_, close)| !close).for_each(|(w, _)| *w = 0.0);
        }
        Near { gap: self.gap(&weights), folds: self.folds(&weights) }
    }

    /// Where the skin of positive weight folds and the gap was not closed for it.
    fn folds(&self, weights: &[f64]) -> Vec<Fold> {
        let gaps: Vec<f64> = self
            .skin
            .of(&self.body)
            .iter()
            .zip(&self.target_skin)
            .zip(weights)
            .map(|((p, q), w)| if *w > 0.0 { (p - q).norm() } else { 0.0 })
            .collect();
        let params = &self.flow.params;
        folds::find(self.target_surface(), &gaps, &self.areas, params.gap_p99, params.cell)
    }

    fn target_surface(&self) -> &Surface {
        self.target_surface.get_or_init(|| {
            let (points, triangles) = (self.target_skin.clone(), self.skin.triangles.clone());
            Surface::new(TriMesh { points, triangles })
        })
    }

    /// The account of one garment; `near` is that of the skin near the outfit.
    pub fn info(&self, carried: &Carried, near: &Near) -> Info {
        let (course, gap) = (&self.course, &near.gap);
        let cells = |field: &Field| field.domain.cells.len();
        let last = self.flow.steps.last();
        let band_cells = last.map_or(0, |step| cells(&step.field));
        let fine_cells = last.and_then(|step| step.fine.as_ref()).map_or(0, cells);
        let band_iterations: usize = course.inner.iter().flat_map(|i| &i.cg_iterations).sum();
        let solved = self.body_converged && course.inner.iter().all(|i| i.converged);
        Info {
            gap_max_m: gap.max,
            gap_p99_m: gap.p99,
            gap_mean_m: gap.mean,
            body_gap_p99_m: self.body_gap.p99,
            skin_gap_p99_m: self.gap(&self.areas).p99,
            active_cells: band_cells + carried.extra_cells,
            refined_cells: fine_cells,
            outer_iterations: course.gaps.len(),
            cg_iterations: band_iterations + carried.cg_iterations,
            converged: solved && carried.converged && gap.p99 <= self.flow.params.gap_accepted,
            stop: course.stop,
            determinant_min: carried.determinant_min,
            points_inside: carried.points_inside,
            skin_pairs: carried.lift.pairs,
            lift_max_m: carried.lift.largest_m,
            skin_gaps_p99_m: course.gaps.clone(),
            folds: near.folds.clone(),
            inner: course.inner.clone(),
        }
    }

    fn gap(&self, weights: &[f64]) -> Gap {
        Gap::measure(&self.skin.of(&self.body), &self.target_skin, weights)
    }
}
