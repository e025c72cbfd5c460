//! Narrow phase: the gaps of all pairs at one configuration, as stencils.

use rayon::prelude::*;

use super::aim::Aim;
use super::ccd::{Shape, combine};
use super::pairs::{FIXED, Mode, Pair, Role, Scene, orientation};
use super::stencil::{Kind, Stencil};
use crate::model::Vec3;

/// Segments whose squared sine is below this are faded out [Li et al. 2020, sec. 4].
const PARALLEL: f64 = 1e-3;
/// A gap shorter than this has no direction of its own [m].
const NO_DIRECTION: f64 = 1e-9;
/// A spring on a tangled pair needs the gap this well along the collider's normal (cosine).
const ALIGNED: f64 = 0.3;
/// Deepest tangle of edges and of collider points that is pushed back [m]; deeper ones are
/// left to the contact points' own springs.
const DEEPEST: f64 = 0.01;
/// Pairs that a CPU task takes.
const CHUNK: usize = 1024;

/// All contacts at one configuration.
#[derive(Clone, Debug, Default)]
pub struct Contacts {
    /// Stencils within reach of their potentials.
    pub stencils: Vec<Stencil>,
    /// Distance of each pair [m]; a lower bound of it where that is beyond the pair's radius.
    pub distances: Vec<f64>,
}

/// Finds the contacts of `pairs`, and the springs of `aims` that are not met, at `x`.
///
/// `stiffness` is a pair's [N/m]; `moves` is how far each contact point has moved since its pairs
/// were found [m]: a pair that cannot have come near since is not looked at.
pub fn contacts(
    scene: &Scene<'_>,
    pairs: &[Pair],
    aims: &[Aim],
    x: &[Vec3],
    stiffness: f64,
    moves: &[f64],
) -> Contacts {
    let longest = moves.iter().copied().fold(0.0, f64::max);
    let parts: Vec<Contacts> = pairs
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut part = Contacts { stencils: Vec::new(), distances: Vec::with_capacity(chunk.len()) };
            for pair in chunk {
                if matches!(pair.mode, Mode::Clean)
                    && let Some(least) = still_apart(scene, pair, moves, longest)
                {
                    part.distances.push(least);
                    continue;
                }
                let corners = scene.corners(pair, x);
                let weights = pair.role.shape().coefficients(&corners);
                let gap = combine(&weights, &corners);
                let d = gap.norm();
                part.distances.push(d);
                if d < pair.radius || matches!(pair.mode, Mode::Wrong { .. }) {
                    let of = (&scene.sheet.node[..], stiffness);
                    let ids = scene.ids(pair);
                    resist(scene, pair, &corners, &ids, &weights, &gap, of, &mut part.stencils);
                }
            }
            part
        })
        .collect();
    let mut all = Contacts::default();
    for part in parts {
        all.stencils.extend(part.stencils);
        all.distances.extend(part.distances);
    }
    let springs = aims.par_iter().filter_map(|aim| aim.stencil(&scene.sheet.node, x, stiffness));
    all.stencils.par_extend(springs);
    all
}

/// A lower bound of a pair's distance [m] if that is beyond its radius, by how far its points have
/// moved, the `longest` [m] if that is enough to say so.
fn still_apart(scene: &Scene<'_>, pair: &Pair, moves: &[f64], longest: f64) -> Option<f64> {
    let sides = if pair.role.is_own() { 2.0 } else { 1.0 };
    let rough = pair.found_at - sides * longest;
    if rough > pair.radius {
        return Some(rough);
    }
    let least = pair.found_at - nearer(scene, pair, moves);
    (least > pair.radius).then_some(least)
}

/// How much nearer a pair can have come by the `moves` of its points [m].
fn nearer(scene: &Scene<'_>, pair: &Pair, moves: &[f64]) -> f64 {
    let by = scene.of_corners(pair, |i| moves[i as usize], |_| 0.0);
    let (first, second) = by.split_at(pair.role.shape().first());
    let longest = |by: &[f64]| by.iter().copied().fold(0.0, f64::max);
    longest(first) + longest(second)
}

/// The forces of clean pairs on the contact points that are `wanted` [N].
pub fn forces_on(
    scene: &Scene<'_>,
    pairs: &[Pair],
    x: &[Vec3],
    stiffness: f64,
    wanted: &[bool],
) -> Vec<(u32, Vec3)> {
    let points: Vec<u32> = (0..x.len() as u32).collect();
    let mut forces = Vec::new();
    for pair in pairs.iter().filter(|pair| matches!(pair.mode, Mode::Clean)) {
        let (corners, ids) = (scene.corners(pair, x), scene.ids(pair));
        if !ids.iter().any(|&i| i != FIXED && wanted[i as usize]) {
            continue;
        }
        let weights = pair.role.shape().coefficients(&corners);
        let gap = combine(&weights, &corners);
        if gap.norm() >= pair.radius {
            continue;
        }
        let mut stencils = Vec::new();
        resist(scene, pair, &corners, &ids, &weights, &gap, (&points, stiffness), &mut stencils);
        for stencil in stencils {
            let force = stencil.evaluate(&[]).1;
            let parts = stencil.nodes.iter().zip(stencil.weights).filter(|(_, w)| *w != 0.0);
            forces.extend(parts.filter(|(p, _)| wanted[**p as usize]).map(|(&p, w)| (p, -force * w)));
        }
    }
    forces
}

/// `of` is the index that stencils get for each contact point, and a pair's stiffness.
#[allow(clippy::too_many_arguments)] // one pair's working values
fn resist(
    scene: &Scene<'_>,
    pair: &Pair,
    corners: &[Vec3; 4],
    ids: &[u32; 4],
    weights: &[f64; 4],
    gap: &Vec3,
    (index, stiffness): (&[u32], f64),
    list: &mut Vec<Stencil>,
) {
    let d = gap.norm();
    let mut stencil = Stencil {
        kind: Kind::Barrier,
        nodes: [0; 4],
        weights: [0.0; 4],
        normal: if d > NO_DIRECTION { gap / d } else { Vec3::y() },
        gap: d,
        radius: pair.radius,
        stiffness,
    };
    if let Mode::Wrong { sign } = pair.mode {
        let Some((normal, signed)) = signed_gap(scene, pair, corners, weights, gap, sign) else { return };
        stencil.kind = Kind::Spring;
        (stencil.normal, stencil.gap) = (normal, signed);
        if signed >= pair.radius {
            return;
        }
    }
    fill(index, ids, weights, &mut stencil);
    if pair.role.shape() == Shape::SegmentSegment && matches!(pair.mode, Mode::Clean) {
        fade(index, corners, ids, &mut stencil, list);
    }
    list.push(stencil);
}

/// Sets nodes and weights; collider corners are left out, and corners on one node added up.
fn fill(index: &[u32], ids: &[u32; 4], weights: &[f64; 4], stencil: &mut Stencil) {
    let mut count = 0;
    for k in 0..4 {
        if ids[k] == FIXED || weights[k] == 0.0 {
            continue;
        }
        let node = index[ids[k] as usize];
        let slot = (0..count).find(|&j| stencil.nodes[j] == node).unwrap_or(count);
        count = count.max(slot + 1);
        stencil.nodes[slot] = node;
        stencil.weights[slot] += weights[k];
    }
}

/// Fades a contact of near-parallel segments out, with the force that goes with it.
fn fade(index: &[u32], corners: &[Vec3; 4], ids: &[u32; 4], stencil: &mut Stencil, list: &mut Vec<Stencil>) {
    let (a, b) = (corners[1] - corners[0], corners[3] - corners[2]);
    let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
    let cross = (aa * bb - ab * ab).max(0.0);
    let scale = PARALLEL * aa * bb;
    if cross >= scale || scale == 0.0 {
        return;
    }
    let q = cross / scale;
    let energy = stencil.evaluate(&[]).0;
    // The factor is 2q - q^2; its slope over the sine's square s = cross / (aa bb).
    let slope = energy * (2.0 - 2.0 * q) / PARALLEL;
    let s = cross / (aa * bb);
    let by_a = ((a * bb - b * ab) / (aa * bb) - a * (s / aa)) * (2.0 * slope);
    let by_b = ((b * aa - a * ab) / (aa * bb) - b * (s / bb)) * (2.0 * slope);
    for (force, w) in [(by_a, [-1.0, 1.0, 0.0, 0.0]), (by_b, [0.0, 0.0, -1.0, 1.0])] {
        let mut part = Stencil { kind: Kind::Force, nodes: [0; 4], weights: [0.0; 4], ..*stencil };
        (part.normal, part.stiffness) = (force, 1.0);
        fill(index, ids, &w, &mut part);
        if part.weights.iter().any(|w| *w != 0.0) {
            list.push(part);
        }
    }
    stencil.stiffness *= q * (2.0 - q);
}

/// Direction and signed gap of a tangled pair; `None` where it has no meaning.
fn signed_gap(
    scene: &Scene<'_>,
    pair: &Pair,
    corners: &[Vec3; 4],
    weights: &[f64; 4],
    gap: &Vec3,
    sign: f64,
) -> Option<(Vec3, f64)> {
    let d = gap.norm();
    let interior = match pair.role.shape() {
        Shape::PointTriangle => weights[1..].iter().all(|w| *w < -1e-6),
        Shape::SegmentSegment => weights.iter().all(|w| w.abs() > 1e-6),
    };
    if !interior || d > DEEPEST {
        return None;
    }
    // The direction in which the gap should open, from the second primitive to the first.
    let outward = match pair.role {
        Role::OwnFace | Role::OwnEdges => {
            if sign == 0.0 {
                return None;
            }
            let axis = match pair.role.shape() {
                Shape::PointTriangle => (corners[2] - corners[1]).cross(&(corners[3] - corners[1])),
                Shape::SegmentSegment => (corners[1] - corners[0]).cross(&(corners[3] - corners[2])),
            };
            debug_assert!(orientation(pair.role, corners, gap).is_finite());
            axis.try_normalize(0.0)? * sign
        }
        Role::OnCollider => scene.colliders[pair.collider as usize].triangle_normals[pair.b as usize],
        Role::EdgeCollider => scene.colliders[pair.collider as usize].edge_normal(pair.b),
        Role::UnderCloth => -scene.colliders[pair.collider as usize].surface.point_normals()[pair.a as usize],
    };
    if d < 1e-6 {
        return Some((outward, 0.0));
    }
    let along = gap.dot(&outward) / d;
    if along.abs() < ALIGNED {
        return None;
    }
    Some((gap * (along.signum() / d), d * along.signum()))
}
