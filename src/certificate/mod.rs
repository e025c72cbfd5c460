//! What was achieved, measured by exact tests and not by the solvers' own view.
//!
//! Everything is taken from the final positions, the refitted pattern and the weights:
//! - **Intersections**: pairs of triangles that meet, by exact predicates
//!   ([`crate::geometry::intersect`]), after welding seams without offset; the same counts on
//!   the source bodies, for comparison.
//! - **Penetration**: the vertex deepest inside the body, by winding number and distance.
//! - **Strain** ([`strain`]) along warp and weft, and its change against the source.
//! - **Folds** ([`folds`]): how far neighbouring triangles are bent, against the source.
//! - **Poses** ([`posed`]): how the garment follows its body.
//! - **Seams**: whether sewn vertices are where they are sewn and follow the same joints.
//!
//! [`Thresholds`] say which figures are too large, in words.

pub mod folds;
pub mod posed;
pub mod strain;
mod thresholds;

pub use thresholds::{StageFigures, Thresholds};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::{Surface, intersect};
use crate::model::{Garment, Skin, Vec2, Vec3};

/// A point with a larger winding number is inside the body.
const INSIDE: f64 = 0.5;

/// What is judged: the garments of one dressed character.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Outer skin of the target body ([`crate::geometry::outer_skin`]): what cloth can touch.
    pub body: &'a Surface,
    /// Outer skins of the source bodies; [`Garment::body`] indexes them.
    pub source_bodies: &'a [&'a Surface],
    /// The garments.
    pub garments: &'a [Dressed<'a>],
}

/// A garment with what the stages made of it.
#[derive(Clone, Copy, Debug)]
pub struct Dressed<'a> {
    /// The garment as authored.
    pub garment: &'a Garment,
    /// Final vertex positions [m].
    pub points: &'a [Vec3],
    /// Refitted pattern [m].
    pub pattern: &'a [Vec2],
    /// Weights of the vertices, if the garment is rigged.
    pub skin: Option<&'a Skin>,
    /// Rest offset of each vertex from its node [m], if it was measured again after the
    /// transfer; else the source's counts. Offsets turn with the cloth: only lengths are
    /// compared.
    pub offsets: Option<&'a [Vec3]>,
    /// Vertices that follow a proxy, if there are any: sewn on with an offset they have the
    /// weights of a spot between vertices, so that only their welds are compared.
    pub bound: Option<&'a [bool]>,
}

/// The figures of one garment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// Triangle pairs of garment and body that intersect.
    pub body_intersections: usize,
    /// Depth of the vertex deepest inside the body [m]; infinite if a position is not finite.
    pub body_penetration_max_m: f64,
    /// Triangle pairs of this and other garments that intersect.
    pub layer_intersections: usize,
    /// Triangle pairs of this garment that intersect beyond what they share.
    pub self_intersections: usize,
    /// |F_warp| - 1 at 1, 50 and 99 percent of the area.
    pub strain_warp: [f64; 3],
    /// |F_weft| - 1 at 1, 50 and 99 percent of the area.
    pub strain_weft: [f64; 3],
    /// Cosine between F_warp and F_weft at 1, 50 and 99 percent of the area.
    pub strain_shear: [f64; 3],
    /// Largest entry of |S_target - S_source| at 99 percent of the area.
    pub strain_change_p99: f64,
    /// Root mean square of the angles between neighbouring triangles of a panel [rad].
    pub fold_angle_rms: f64,
    /// `fold_angle_rms` of the source garment: cloth with much more is crumpled.
    pub source_fold_angle_rms: f64,
    /// `body_intersections` of the source garment on its source body.
    pub source_body_intersections: usize,
    /// `layer_intersections` of the source garment with those on the same source body.
    pub source_layer_intersections: usize,
    /// `self_intersections` of the source garment.
    pub source_self_intersections: usize,
    /// Largest deviation of a sewn vertex from where it is sewn [m].
    pub seam_gap_max_m: f64,
    /// Largest deviation of a vertex's weights from a sum of 1; `None` if not rigged.
    pub weight_sum_error_max: Option<f64>,
    /// Largest difference of a weight across a seam; `None` if not rigged.
    pub seam_weight_error_max: Option<f64>,
    /// How it follows its body in poses ([`posed::measure`]); empty if it was not posed.
    pub posed: Vec<posed::PoseFigures>,
}

/// Measures every garment, in the order given.
///
/// # Panics
/// If arrays do not have one element for each vertex, or a garment names a source body that is
/// not there: the stages keep lengths.
pub fn measure(input: &Input<'_>) -> Vec<Certificate> {
    let target = count(input.garments.iter().map(|d| (d.garment, d.points, input.body, 0)));
    let source = count(input.garments.iter().map(|d| {
        let body = d.garment.body;
        (d.garment, &d.garment.points[..], input.source_bodies[body], body)
    }));
    let garments = input.garments.par_iter().zip(target).zip(source);
    garments
        .map(|((d, target), source)| Certificate {
            body_intersections: target.body,
            layer_intersections: target.layer,
            self_intersections: target.own,
            source_body_intersections: source.body,
            source_layer_intersections: source.layer,
            source_self_intersections: source.own,
            fold_angle_rms: folds::angle_rms(&d.garment.triangles, d.points),
            source_fold_angle_rms: folds::angle_rms(&d.garment.triangles, &d.garment.points),
            body_penetration_max_m: penetration(input.body, d.points),
            seam_gap_max_m: seam_gap(d),
            weight_sum_error_max: d.skin.map(weight_sum_error),
            seam_weight_error_max: d.skin.map(|skin| seam_weight_error(d, skin)),
            ..strains(d)
        })
        .collect()
}

#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    body: usize,
    layer: usize,
    own: usize,
}

/// Intersections of garments at `points` with a body, themselves and the others on that body;
/// each as (garment, points, body, which body).
fn count<'a>(garments: impl Iterator<Item = (&'a Garment, &'a [Vec3], &'a Surface, usize)>) -> Vec<Counts> {
    let worn: Vec<(Surface, &Surface, usize)> = garments
        .map(|(garment, points, body, which)| (Surface::new(garment.welded_mesh(points)), body, which))
        .collect();
    let mut counts: Vec<Counts> = worn
        .iter()
        .map(|(surface, body, _)| Counts {
            body: intersect::mesh_intersections(surface, body).len(),
            layer: 0,
            own: intersect::self_intersections(surface).len(),
        })
        .collect();
    for i in 0..worn.len() {
        for j in (0..i).filter(|&j| worn[j].2 == worn[i].2) {
            let pairs = intersect::mesh_intersections(&worn[i].0, &worn[j].0).len();
            counts[i].layer += pairs;
            counts[j].layer += pairs;
        }
    }
    counts
}

/// Depth of the deepest point inside the body [m].
fn penetration(body: &Surface, points: &[Vec3]) -> f64 {
    let depth = |p: &Vec3| {
        if !p.iter().all(|x| x.is_finite()) {
            return f64::INFINITY;
        }
        if body.winding_number(p) > INSIDE { body.closest(p).distance } else { 0.0 }
    };
    points.par_iter().map(depth).reduce(|| 0.0, f64::max)
}

/// Largest distance between vertices that are sewn onto one another, and largest change of the
/// length of an offset [m].
fn seam_gap(d: &Dressed<'_>) -> f64 {
    let groups = &d.garment.groups;
    let rest = d.offsets.map_or_else(|| groups.offsets(&d.garment.points), <[Vec3]>::to_vec);
    let now = groups.offsets(d.points);
    let mut first_of_weld = vec![usize::MAX; groups.weld_count];
    let mut gap: f64 = 0.0;
    for v in 0..d.points.len() {
        let first = &mut first_of_weld[groups.weld_of_vertex[v] as usize];
        if *first == usize::MAX {
            *first = v;
        }
        gap = gap.max((d.points[v] - d.points[*first]).norm());
        if groups.has_offset[v] {
            gap = gap.max((now[v].norm() - rest[v].norm()).abs());
        }
    }
    if d.points.iter().all(|p| p.iter().all(|x| x.is_finite())) { gap } else { f64::INFINITY }
}

/// The strain figures; the rest of the certificate is left at its default.
fn strains(d: &Dressed<'_>) -> Certificate {
    let garment = d.garment;
    let triangles: Vec<(strain::Strain, f64, f64)> = (0..garment.triangles.len())
        .into_par_iter()
        .filter_map(|t| {
            let at = |points: &[Vec3]| garment.triangles[t].map(|v| points[v as usize]);
            let pattern = garment.pattern_corners(d.pattern, t);
            let now = strain::deformation_gradient(&pattern, &at(d.points))?;
            let original = garment.pattern_corners(&garment.pattern, t);
            let source = strain::deformation_gradient(&original, &at(&garment.points))?;
            let change = (strain::stretch(&now) - strain::stretch(&source)).amax();
            Some((strain::Strain::new(&now), change, strain::signed_area(&pattern).abs()))
        })
        .collect();
    let percentiles = |figure: fn(&strain::Strain) -> f64| {
        let mut values: Vec<(f64, f64)> = triangles.iter().map(|(s, _, area)| (figure(s), *area)).collect();
        strain::percentiles(&mut values, [0.01, 0.5, 0.99])
    };
    let mut change: Vec<(f64, f64)> = triangles.iter().map(|(_, c, area)| (*c, *area)).collect();
    let [strain_change_p99] = strain::percentiles(&mut change, [0.99]);
    Certificate {
        strain_warp: percentiles(|s| s.warp),
        strain_weft: percentiles(|s| s.weft),
        strain_shear: percentiles(|s| s.shear),
        strain_change_p99,
        ..Certificate::default()
    }
}

fn weight_sum_error(skin: &Skin) -> f64 {
    let points = skin.joint_weights.chunks(skin.influences.max(1));
    points.map(|w| worst((w.iter().sum::<f64>() - 1.0).abs())).fold(0.0, f64::max)
}

/// Largest difference of any joint's weight between a vertex and the anchor of its node (the first
/// of its weld where a vertex follows a proxy).
fn seam_weight_error(d: &Dressed<'_>, skin: &Skin) -> f64 {
    let groups = &d.garment.groups;
    let influences = |v: usize| (0..skin.influences).map(move |i| v * skin.influences + i);
    let weight = |v: usize, joint: u32| -> f64 {
        influences(v).filter(|&i| skin.joint_indices[i] == joint).map(|i| skin.joint_weights[i]).sum()
    };
    let mut error: f64 = 0.0;
    let mut first_of_weld = vec![usize::MAX; groups.weld_count];
    for v in 0..groups.node_of_vertex.len() {
        let first = &mut first_of_weld[groups.weld_of_vertex[v] as usize];
        *first = (*first).min(v);
        let is_bound = d.bound.is_some_and(|bound| bound[v]);
        let anchor = groups.anchor_of_node[groups.node_of_vertex[v] as usize] as usize;
        let anchor = if is_bound { *first } else { anchor };
        for i in influences(v).chain(influences(anchor)).filter(|_| anchor != v) {
            let joint = skin.joint_indices[i];
            error = error.max(worst((weight(v, joint) - weight(anchor, joint)).abs()));
        }
    }
    error
}

/// What is not a number is infinitely wrong (and `f64::max` would drop it).
fn worst(x: f64) -> f64 {
    if x.is_nan() { f64::INFINITY } else { x }
}

#[cfg(test)]
mod tests;
