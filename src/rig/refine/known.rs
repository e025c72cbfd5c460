//! What is known of a garment in one pose, so that little is asked of the posed body.
//!
//! The body is the same in every round, and garments move by millimetres. What was `d` outside is
//! outside as long as it has moved by less than `d`; a face is outside if a corner is farther from
//! the skin than from the face's centre. Only the rest is asked for.

use rayon::prelude::*;

use super::STILL;
use crate::certificate::posed::{Place, Resting, Spot, place};
use crate::geometry::Surface;
use crate::model::Vec3;

/// Where a spot was when it was last asked for.
#[derive(Clone, Copy)]
struct Held {
    at: Vec3,
    /// `None` if it never was.
    place: Option<Place>,
}

impl Held {
    /// Within which distance of `p` all is outside, 0 if that is not known [m].
    fn clear(&self, p: &Vec3) -> f64 {
        match self.place {
            Some(Place::Outside { clear, .. }) => (clear - (p - self.at).norm()).max(0.0),
            _ => 0.0,
        }
    }

    fn is_known(&self, p: &Vec3) -> bool {
        self.place.is_some() && (self.clear(p) > 0.0 || (p - self.at).norm() <= STILL)
    }
}

/// A garment's vertices and faces in one pose.
pub(super) struct Known {
    vertices: Vec<Held>,
    faces: Vec<Held>,
}

/// A spot in the body or near it.
pub(super) struct Near<'a> {
    pub spot: &'a Spot,
    /// Its closest point of the skin.
    pub on: Vec3,
    /// Out of the body there, of length 1.
    pub outward: Vec3,
    /// How deep it is in the body; not positive for those outside [m].
    pub depth: f64,
}

impl Known {
    /// Nothing is known.
    pub fn new(resting: &Resting<'_>) -> Known {
        let none = Held { at: Vec3::zeros(), place: None };
        Known { vertices: vec![none; resting.vertices.len()], faces: vec![none; resting.faces.len()] }
    }

    /// Looks at the garment at `points`; `body` poses the body.
    pub fn update<'b>(&mut self, resting: &Resting<'_>, points: &[Vec3], body: &dyn Fn() -> &'b Surface) {
        let at = |spot: &Spot| points[spot.index];
        ask(&mut self.vertices, &resting.vertices, at, |spot, held| held.is_known(&at(spot)), body);
        let mut clear = vec![0.0; points.len()];
        for (held, spot) in self.vertices.iter().zip(&resting.vertices) {
            clear[spot.index] = held.clear(&at(spot));
        }
        let centre = |spot: &Spot| resting.centre(points, spot.index);
        let is_known = |spot: &Spot, held: &Held| {
            held.is_known(&centre(spot)) || resting.is_clear(points, &clear, spot.index)
        };
        for (held, spot) in self.faces.iter_mut().zip(&resting.faces) {
            if !held.is_known(&centre(spot)) && resting.is_clear(points, &clear, spot.index) {
                *held = Held { at: centre(spot), place: Some(Place::OUTSIDE) };
            }
        }
        ask(&mut self.faces, &resting.faces, centre, is_known, body);
    }

    /// Vertices that are in the body, or nearer to it than `within` [m].
    pub fn vertices<'r>(&self, resting: &'r Resting<'_>, within: f64) -> impl Iterator<Item = Near<'r>> {
        near(&self.vertices, &resting.vertices, within)
    }

    /// Faces whose centre is.
    pub fn faces<'r>(&self, resting: &'r Resting<'_>, within: f64) -> impl Iterator<Item = Near<'r>> {
        near(&self.faces, &resting.faces, within)
    }
}

fn ask<'b>(
    held: &mut [Held],
    spots: &[Spot],
    at: impl Fn(&Spot) -> Vec3 + Sync,
    is_known: impl Fn(&Spot, &Held) -> bool,
    body: &dyn Fn() -> &'b Surface,
) {
    let asked: Vec<usize> = (0..spots.len()).filter(|&i| !is_known(&spots[i], &held[i])).collect();
    if asked.is_empty() {
        return;
    }
    let body = body();
    let answer = |&i: &usize| {
        let p = at(&spots[i]);
        Held { at: p, place: Some(place(body, &p, &spots[i].anchor)) }
    };
    let answers: Vec<Held> = asked.par_iter().map(answer).collect();
    asked.into_iter().zip(answers).for_each(|(i, answer)| held[i] = answer);
}

fn near<'r>(held: &[Held], spots: &'r [Spot], within: f64) -> impl Iterator<Item = Near<'r>> {
    held.iter().zip(spots).filter_map(move |(held, spot)| {
        let (on, sign) = match held.place? {
            Place::Inside(on) => (on, -1.0),
            Place::Outside { on: Some(on), .. } if on.distance < within => (on, 1.0),
            _ => return None,
        };
        let outward = (held.at - on.point).try_normalize(STILL)? * sign;
        Some(Near { spot, on: on.point, outward, depth: -sign * on.distance })
    })
}
