//! What the layout must obey, beside its energy: equal lengths of what is sewn, bounded changes
//! of shape, girths.
//!
//! What two sewn sides must share is their length; their shape is their own affair. The paper
//! buys equal lengths through shared scale factors, so that lengths cost shape and strain. Here
//! they are equations of their own, and so are the limits on what may happen to an outline:
//!
//! - sewn chains keep the relative difference in length that they had (ease, gathers): with the
//!   original's `r = 2 (l_a - l_b) / (l_a + l_b)`, `(1 - r/2) l_a(x) = (1 + r/2) l_b(x)`;
//! - runs of panels that mirror one another ([`super::mirror`]) keep mirrored chords, and equal
//!   lengths where they are curved, unless the target is so much wider on one side that it is
//!   not meant to be symmetric ([`LOPSIDED`]);
//! - a tape laid over the cloth has a given rest length ([`Wanted`]);
//! - an originally straight run stays within a strip about its chord;
//! - a corner keeps its angle within a bound.
//!
//! Each is a number that must lie in an interval, and is taken linearly about the current
//! layout ([`Row`]); [`super::bounded`] solves for all of them together.

use std::collections::BTreeSet;

use super::Wanted;
use super::runs::{Corner, Run, Runs};
use crate::model::{Chain, Vec2, chain};

/// Mirrored runs whose lengths the unconstrained layout makes differ by more than this are on
/// a lopsided target and keep their difference.
const LOPSIDED: f64 = 0.05;
/// A bound takes part once this much of it is used up.
const NEAR: f64 = 0.9;

/// Which demand a row belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Key {
    /// A sewn chain.
    Chain(usize),
    /// The lengths of a pair of mirrored runs.
    Mirror(usize),
    /// A coordinate of the chords of a pair of mirrored runs.
    MirrorChord(usize, usize),
    /// A tape.
    Tape(usize),
    /// A corner.
    Corner(usize),
    /// A vertex of a straight run.
    Straight(usize, usize),
}

/// A demand about a layout: `low <= value + coefficients . (x - layout) <= high`.
#[derive(Clone, Debug)]
pub struct Row {
    /// Whose it is.
    pub key: Key,
    /// Coefficients over the unknowns; an index may occur more than once.
    pub coefficients: Vec<(usize, f64)>,
    /// Value at the layout: relative lengths, or radians.
    pub value: f64,
    /// Least value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

/// By how much a layout misses its demands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Excess {
    /// Largest relative error of a length: chains, mirrored runs, tapes.
    pub length: f64,
    /// Largest excess over a bound of shape (relative deviation, or radians).
    pub shape: f64,
}

/// Everything that is demanded of a garment's layout.
pub struct Demands<'a> {
    /// Original pattern.
    pub original: &'a [Vec2],
    /// Sewn chains.
    pub chains: &'a [Chain],
    /// Tapes of given length.
    pub tapes: &'a [Wanted],
    /// The outline.
    pub runs: &'a Runs,
    /// Pairs of mirrored runs that take part.
    pub mirrored: Vec<[usize; 2]>,
    /// Largest change of a corner's angle [rad].
    pub corner: f64,
    /// Largest deviation of a straight run over its length.
    pub straight: f64,
}

impl Demands<'_> {
    /// Leaves out mirrored runs that differ too much in `free`.
    pub fn without_lopsided(mut self, free: &[Vec2]) -> Self {
        let runs = &self.runs.runs;
        self.mirrored.retain(|[r, s]| {
            let [a, b] = [r, s].map(|&i| runs[i].length(free));
            (a - b).abs() < LOPSIDED * (a + b) / 2.0
        });
        self
    }

    /// How far `layout` is from obeying.
    pub fn excess(&self, layout: &[Vec2]) -> Excess {
        let lengths = (self.equations(layout).iter()).fold(0.0, |worst: f64, row| worst.max(row.value.abs()));
        let chains = chain::chains_mismatch(self.chains, self.original, layout);
        let corners = self.runs.corners.iter().map(|c| c.turned(self.original, layout).abs() - self.corner);
        let straight = self.straight_runs().map(|(_, run)| run.deviation(layout).1.abs() - self.straight);
        Excess { length: lengths.max(chains), shape: corners.chain(straight).fold(0.0, f64::max) }
    }

    /// All equations, the bounds in `active`, and those that are nearly used up.
    pub fn rows(&self, layout: &[Vec2], active: &BTreeSet<Key>) -> Vec<Row> {
        let mut rows = self.equations(layout);
        for (k, corner) in self.runs.corners.iter().enumerate() {
            let key = Key::Corner(k);
            let value = corner.turned(self.original, layout);
            if value.abs() > NEAR * self.corner || active.contains(&key) {
                let coefficients = corner_coefficients(corner, layout);
                rows.push(Row { key, coefficients, value, low: -self.corner, high: self.corner });
            }
        }
        for (k, run) in self.straight_runs() {
            let (worst, value) = run.deviation(layout);
            let kept = active.range(Key::Straight(k, 0)..Key::Straight(k + 1, 0));
            let mut places: BTreeSet<usize> = kept
                .filter_map(|key| if let Key::Straight(_, at) = key { Some(*at) } else { None })
                .collect();
            if value.abs() > NEAR * self.straight {
                places.insert(worst);
            }
            for at in places {
                let (coefficients, value) = straight_coefficients(run, at, layout);
                let key = Key::Straight(k, at);
                rows.push(Row { key, coefficients, value, low: -self.straight, high: self.straight });
            }
        }
        rows
    }

    fn straight_runs(&self) -> impl Iterator<Item = (usize, &Run)> {
        self.runs.runs.iter().enumerate().filter(|(_, run)| run.straight && run.vertices.len() > 2)
    }

    /// Lengths; their values are relative.
    fn equations(&self, layout: &[Vec2]) -> Vec<Row> {
        let chains = self.chains.iter().enumerate().map(|(k, chain)| {
            let ease = 0.5 * chain.relative_difference(self.original);
            let sides = [(&chain.a[..], 1.0 - ease), (&chain.b[..], -1.0 - ease)];
            (Key::Chain(k), sides, chain.lengths(self.original))
        });
        let curved = |pair: &[usize; 2]| !self.runs.runs[pair[0]].straight;
        let mirrored = self.mirrored.iter().enumerate().filter(|(_, pair)| curved(pair)).map(|(k, pair)| {
            let [a, b] = pair.map(|r| &self.runs.runs[r]);
            let lengths = [a.length(self.original), b.length(self.original)];
            let difference = (lengths[0] - lengths[1]) / (lengths[0] + lengths[1]);
            let sides = [(&a.vertices[..], 1.0 - difference), (&b.vertices[..], -1.0 - difference)];
            (Key::Mirror(k), sides, lengths)
        });
        let pairs = chains.chain(mirrored).map(|(key, sides, lengths)| {
            let mean = 0.5 * (lengths[0] + lengths[1]);
            let mut row = Row { key, coefficients: Vec::new(), value: 0.0, low: 0.0, high: 0.0 };
            for (side, factor) in sides {
                for edge in side.windows(2) {
                    let ends = [edge[0], edge[1]].map(|v| [(v, 1.0)]);
                    add_length(&mut row, [&ends[0], &ends[1]], factor / mean, layout);
                }
            }
            row
        });
        let tapes = self.tapes.iter().enumerate().map(|(k, tape)| {
            let key = Key::Tape(k);
            let mut row = Row { key, coefficients: Vec::new(), value: -1.0, low: 0.0, high: 0.0 };
            for [a, b] in &tape.tape.segments {
                add_length(&mut row, [&a.weights(), &b.weights()], 1.0 / tape.length, layout);
            }
            row
        });
        pairs.chain(tapes).chain(self.mirrored_chords(layout)).collect()
    }
}

impl Demands<'_> {
    /// The chord of a run is the mirror image of its partner's, which is run the other way; up
    /// to what the original pattern misses by.
    fn mirrored_chords(&self, layout: &[Vec2]) -> impl Iterator<Item = Row> {
        let n = layout.len();
        self.mirrored.iter().enumerate().flat_map(move |(k, pair)| {
            let [run, other] = pair.map(|r| &self.runs.runs[r].vertices);
            let [a, b] = [run[0], run[run.len() - 1]].map(|v| v as usize);
            let [c, d] = [other[0], other[other.len() - 1]].map(|v| v as usize);
            let size = self.runs.runs[pair[0]].length(self.original);
            [(0, -1.0), (1, 1.0)].map(|(axis, sign)| {
                // The warp axis stays and the weft axis turns over; (b - a) against (c - d).
                let miss = |p: &[Vec2]| (p[b][axis] - p[a][axis] + sign * (p[c][axis] - p[d][axis])) / size;
                let at = |vertex: usize| axis * n + vertex;
                let w = 1.0 / size;
                let coefficients = vec![(at(b), w), (at(a), -w), (at(c), sign * w), (at(d), -sign * w)];
                let value = miss(layout) - miss(self.original);
                Row { key: Key::MirrorChord(k, axis), coefficients, value, low: 0.0, high: 0.0 }
            })
        })
    }
}

/// A point of the cloth as vertices with weights.
type Mixture<'a> = &'a [(u32, f64)];

/// Adds `factor` times the length of the segment between two points of the cloth.
fn add_length(row: &mut Row, [a, b]: [Mixture<'_>; 2], factor: f64, layout: &[Vec2]) {
    let n = layout.len();
    let at = |point: Mixture<'_>| point.iter().map(|&(v, w)| layout[v as usize] * w).sum::<Vec2>();
    let between = at(b) - at(a);
    let length = between.norm();
    row.value += factor * length;
    let Some(direction) = between.try_normalize(0.0) else { return };
    for (point, sign) in [(b, factor), (a, -factor)] {
        for &(v, w) in point {
            for axis in 0..2 {
                row.coefficients.push((axis * n + v as usize, sign * w * direction[axis]));
            }
        }
    }
}

/// The slope of a corner's angle: each arm turns by its end's sideways move over its length.
fn corner_coefficients(corner: &Corner, layout: &[Vec2]) -> Vec<(usize, f64)> {
    let (n, i) = (layout.len(), corner.vertex as usize);
    let mut coefficients = Vec::new();
    for (arm, sign) in [(corner.before as usize, 1.0), (corner.after as usize, -1.0)] {
        let z = layout[arm] - layout[i];
        let turn = Vec2::new(-z.y, z.x) * (sign / z.norm_squared().max(f64::MIN_POSITIVE));
        for axis in 0..2 {
            coefficients.push((axis * n + arm, turn[axis]));
            coefficients.push((axis * n + i, -turn[axis]));
        }
    }
    coefficients
}

/// The slope of a vertex's distance from its run's chord over the chord's length, the length
/// taken as it is; and its value.
fn straight_coefficients(run: &Run, at: usize, layout: &[Vec2]) -> (Vec<(usize, f64)>, f64) {
    let n = layout.len();
    let [a, v, b] =
        [run.vertices[0], run.vertices[at], run.vertices[run.vertices.len() - 1]].map(|v| v as usize);
    let chord = layout[b] - layout[a];
    let size = chord.norm_squared().max(f64::MIN_POSITIVE);
    let along = chord.dot(&(layout[v] - layout[a])) / size;
    let normal = Vec2::new(-chord.y, chord.x) / size;
    let mut coefficients = Vec::new();
    for (vertex, weight) in [(v, 1.0), (a, along - 1.0), (b, -along)] {
        for axis in 0..2 {
            coefficients.push((axis * n + vertex, weight * normal[axis]));
        }
    }
    (coefficients, normal.dot(&(layout[v] - layout[a])))
}
