//! Ease: how much longer the cloth is than the tape about the body under it.

use serde::{Deserialize, Serialize};

use super::landmarks::{Landmark, Landmarks, ROUND};
use super::section::{Piece, cut};
use super::{Girth, Side};
use crate::model::{Garment, Tape, Vec2, Vec3};

/// An open garment (a jacket's fronts) is measured if it goes round by more than this [turns].
const MOST_OF_IT: f64 = 0.6;

/// A girth of a garment and of the body under it [m].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The body's: the convex hull of its section.
    pub body_m: f64,
    /// The garment's: the section's length in the flat pattern.
    pub garment_m: f64,
    /// The garment's less the body's.
    pub ease_m: f64,
    /// The section's length as worn.
    pub worn_m: f64,
}

/// One girth of a garment on both bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EaseEntry {
    /// Which girth.
    pub girth: Girth,
    /// Of which limb; `None` for the trunk.
    pub side: Option<Side>,
    /// Whether the garment is open there (on the source).
    pub open: bool,
    /// On the source body, as authored.
    pub source: Measured,
    /// On the target body, the carried shape against the refitted pattern.
    pub refit: Measured,
    /// On the target body, draped.
    pub target: Measured,
    /// The ease that was asked for [m], where a setting holds it.
    pub held_m: Option<f64>,
}

/// The ease of a garment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ease {
    /// Girths that the garment covers on both bodies.
    pub girths: Vec<EaseEntry>,
    /// Girths without a figure, and why.
    pub left_out: Vec<String>,
}

/// A garment's way round a landmark.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// Over the cloth.
    pub tape: Tape,
    /// Whether it does not close.
    pub open: bool,
}

/// The cloth of `garment` at `points` along a landmark's plane; the shortest of several layers.
/// `None` if it does not go round, or round more than it should.
pub fn ring(garment: &Garment, points: &[Vec3], pattern: &[Vec2], landmark: &Landmark) -> Option<Ring> {
    let weld = |v: u32| garment.groups.weld_of_vertex[v as usize];
    let pieces = cut(points, &garment.triangles, &weld, &|_| false, &landmark.plane);
    let turns = |piece: &Piece, p: &Vec3| piece.turns_around(&landmark.plane.flat(p));
    let ours = |piece: &&Piece| !landmark.beside.iter().any(|p| turns(piece, p) > MOST_OF_IT);
    let shortest = |least: f64| {
        let round = pieces.iter().filter(ours).filter(|piece| turns(piece, &landmark.centre) > least);
        round.min_by(|a, b| a.tape.rest_length(pattern).total_cmp(&b.tape.rest_length(pattern)))
    };
    let closed = shortest(ROUND).map(|piece| Ring { tape: piece.tape.clone(), open: false });
    closed.or_else(|| shortest(MOST_OF_IT).map(|piece| Ring { tape: piece.tape.clone(), open: true }))
}

/// The girth of a ring.
pub fn measured(ring: &Ring, points: &[Vec3], pattern: &[Vec2], body_m: f64) -> Measured {
    let garment_m = ring.tape.rest_length(pattern);
    Measured { body_m, garment_m, ease_m: garment_m - body_m, worn_m: ring.tape.worn_length(points) }
}

/// A garment's shape and pattern on one body.
#[derive(Clone, Copy)]
pub struct Worn<'a> {
    /// The body.
    pub body: &'a Landmarks,
    /// Vertices [m], shape `[vertices, 3]`.
    pub points: &'a [Vec3],
    /// Pattern [m], shape `[vertices, 2]`.
    pub pattern: &'a [Vec2],
}

impl Ease {
    /// Measures a garment: on its source, as refitted on the target, and draped there. `held`
    /// says which ease was asked for [m].
    pub fn new(
        garment: &Garment,
        [source, refit, draped]: [Worn<'_>; 3],
        held: &dyn Fn(Girth, Option<Side>) -> Option<f64>,
    ) -> Ease {
        let mut ease = Ease::default();
        for landmark in &source.body.found {
            let (girth, side) = (landmark.girth, landmark.side);
            let read = |worn: &Worn<'_>| {
                let landmark = worn.body.get(girth, side)?;
                let ring = ring(garment, worn.points, worn.pattern, landmark)?;
                Some((measured(&ring, worn.points, worn.pattern, landmark.body_m), ring.open))
            };
            let Some((on_source, open)) = read(&source) else { continue }; // not covered
            match (read(&refit), read(&draped)) {
                (Some((refit, _)), Some((target, _))) => {
                    let held_m = held(girth, side);
                    ease.girths.push(EaseEntry {
                        girth,
                        side,
                        open,
                        source: on_source,
                        refit,
                        target,
                        held_m,
                    });
                }
                _ => ease
                    .left_out
                    .push(format!("{}: the garment does not go round it on the target", girth.name())),
            }
        }
        for (which, landmarks) in [("source", source.body), ("target", refit.body)] {
            for (girth, why) in &landmarks.missing {
                ease.left_out.push(format!("{} of the {which} body: {why}", girth.name()));
            }
        }
        ease
    }
}
