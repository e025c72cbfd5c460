//! Girths that a setting holds: how much wider each triangle has to be.
//!
//! The refit as carried gives a ring of the garment the rest length `g`; wanted is the body's
//! girth and the held ease, `w`. Around that landmark the cloth is made wider by `w / g` across
//! the axis of trunk or limb; between landmarks the factor is interpolated, and a landmark that
//! is not held has a factor of one, so that a held waist leaves bust and hip alone. Above the
//! bust the factor fades out at the shoulders; below the last landmark it stays what it is there.
//! Tapes then make the held girths exact ([`super::demand`]).

use nalgebra::Matrix2;

use super::frame::{edges_2d, edges_3d};
use super::{Girths, Wanted};
use crate::measure::ease::{measured, ring};
use crate::measure::{Girth, Landmark, Landmarks, hold::Hold};
use crate::model::{Garment, Vec2, Vec3};

/// Factors are kept within this range; farther away a hold is a mistake, and the tape's
/// residual says so.
const FACTORS: [f64; 2] = [0.3, 3.0];

/// The bodies and what is held on them.
#[derive(Clone, Copy)]
pub struct Holding<'a> {
    /// Landmarks of the source body.
    pub source: &'a Landmarks,
    /// Landmarks of the target body.
    pub target: &'a Landmarks,
    /// What is held.
    pub hold: &'a Hold,
}

/// A place along a trunk or limb with the factor there.
struct Knot {
    at: f64,
    factor: f64,
}

/// Panels that are widened together across an axis.
struct Zone {
    panels: Vec<u32>,
    origin: Vec3,
    axis: Vec3,
    knots: Vec<Knot>,
}

impl Holding<'_> {
    /// The girths to be met by `garment` at `points` on the target, whose refit as carried is
    /// `pattern`; empty if it covers none that is held.
    pub fn girths(&self, garment: &Garment, points: &[Vec3], pattern: &[Vec2]) -> Girths {
        let mut girths = Girths::default();
        let mut zones: Vec<Zone> = Vec::new();
        for landmark in &self.target.found {
            let Some(ring) = ring(garment, points, pattern, landmark) else { continue };
            let now = measured(&ring, points, pattern, landmark.body_m);
            let wanted = self.wanted(garment, landmark).map(|ease| landmark.body_m + ease);
            let factor = wanted.map_or(1.0, |w| (w / now.garment_m).clamp(FACTORS[0], FACTORS[1]));
            let panels = ring.tape.triangles.iter().map(|&t| garment.panel_of_triangle[t as usize]);
            add_knot(&mut zones, landmark, panels.collect(), factor);
            if let Some(length) = wanted.filter(|w| *w > 0.0) {
                girths.tapes.push(Wanted { tape: ring.tape, length });
            }
        }
        if !girths.tapes.is_empty() {
            zones.iter_mut().for_each(|zone| zone.knots.sort_by(|a, b| a.at.total_cmp(&b.at)));
            girths.widening = widening(garment, points, &zones);
        }
        girths
    }

    /// The ease that the setting asks for at a landmark of the target [m].
    fn wanted(&self, garment: &Garment, landmark: &Landmark) -> Option<f64> {
        let on_source = self.source.get(landmark.girth, landmark.side)?;
        let ring = ring(garment, &garment.points, &garment.pattern, on_source)?;
        let source = measured(&ring, &garment.points, &garment.pattern, on_source.body_m);
        self.hold.of(landmark.girth).wanted(landmark.body_m, &source)
    }
}

/// Files a landmark's factor: trunk and legs share an axis and, where a garment covers both,
/// panels; arms and neck have theirs.
fn add_knot(zones: &mut Vec<Zone>, landmark: &Landmark, panels: Vec<u32>, factor: f64) {
    let (origin, axis) = match landmark.girth {
        Girth::Bust | Girth::Waist | Girth::Hip | Girth::Thigh => (Vec3::zeros(), Vec3::y()),
        Girth::UpperArm | Girth::Neck => (landmark.plane.origin, landmark.plane.normal),
    };
    let knot = Knot { at: (landmark.plane.origin - origin).dot(&axis), factor };
    let joins = |zone: &&mut Zone| zone.axis == axis && zone.origin == origin;
    match zones.iter_mut().find(joins).filter(|_| landmark.girth != Girth::Thigh) {
        Some(zone) => {
            zone.panels.extend(panels);
            zone.knots.push(knot);
        }
        // A leg starts from what the trunk has at the hips.
        None if landmark.girth == Girth::Thigh => {
            let trunk = zones.iter().find(|zone| zone.axis == axis);
            let mut knots = vec![knot];
            knots.extend(
                trunk.iter().flat_map(|z| z.knots.iter().map(|k| Knot { at: k.at, factor: k.factor })),
            );
            zones.push(Zone { panels, origin: Vec3::new(0.0, 0.0, 0.0), axis, knots });
        }
        None => zones.push(Zone { panels, origin, axis, knots: vec![knot] }),
    }
}

/// The factor at a place: linear between knots, constant beyond.
fn factor(knots: &[Knot], at: f64) -> f64 {
    let above = knots.partition_point(|knot| knot.at < at);
    match (above.checked_sub(1).map(|k| &knots[k]), knots.get(above)) {
        (Some(a), Some(b)) => a.factor + (b.factor - a.factor) * (at - a.at) / (b.at - a.at),
        (Some(end), None) | (None, Some(end)) => end.factor,
        (None, None) => 1.0,
    }
}

fn widening(garment: &Garment, points: &[Vec3], zones: &[Zone]) -> Vec<Matrix2<f64>> {
    (0..garment.triangles.len())
        .map(|t| {
            let panel = garment.panel_of_triangle[t];
            // The last zone that has the panel: a leg's before the trunk's.
            let Some(zone) = zones.iter().rev().find(|zone| zone.panels.contains(&panel)) else {
                return Matrix2::identity();
            };
            let corners = garment.triangles[t].map(|v| points[v as usize]);
            let centre = corners.iter().sum::<Vec3>() / 3.0;
            let f = factor(&zone.knots, (centre - zone.origin).dot(&zone.axis));
            match across(garment, t, corners, &zone.axis) {
                Some(d) => Matrix2::identity() + d * d.transpose() * (f - 1.0),
                None => Matrix2::identity(),
            }
        })
        .collect()
}

/// The pattern direction that runs across an axis on the carried triangle: in its plane and at
/// right angles to the axis. `None` where the triangle lies across the axis itself.
fn across(garment: &Garment, t: usize, corners: [Vec3; 3], axis: &Vec3) -> Option<Vec2> {
    let edges = edges_3d(corners);
    let normal = edges.column(0).cross(&edges.column(1)).try_normalize(0.0)?;
    let tangent = normal.cross(axis);
    let rest = edges_2d(garment.pattern_corners(&garment.pattern, t));
    let frame = edges * rest.try_inverse()?;
    let inverse = (frame.transpose() * frame).try_inverse()? * frame.transpose();
    (tangent.norm() > 0.2).then(|| inverse * tangent)?.try_normalize(0.0)
}
