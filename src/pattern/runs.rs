//! The outline as a tailor sees it: runs between corners, and which of them mirror one another.
//!
//! A run is a piece of a panel's border from one corner to the next, in the orientation of the
//! panel's triangles. What the shape of an outline must keep is said in terms of runs: straight
//! ones stay straight, corners keep their angle, and the runs of panels that mirror one another
//! stay equally long.

use std::collections::{BTreeMap, BTreeSet};

use super::outline::CORNER;
use crate::model::{Garment, Vec2};

/// A run that deviates from its chord by less than this part of its length is straight.
const STRAIGHT: f64 = 2e-3;

/// A piece of a panel's border between two corners.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Panel.
    pub panel: u32,
    /// Vertices in order; the first again at the end of a border without corners.
    pub vertices: Vec<u32>,
    /// Whether the original pattern has it straight.
    pub straight: bool,
}

/// A vertex where the border turns, with its neighbours along the border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corner {
    /// The vertex.
    pub vertex: u32,
    /// The vertex before it along the border.
    pub before: u32,
    /// The vertex after it.
    pub after: u32,
}

/// The whole outline of a garment.
#[derive(Clone, Debug, Default)]
pub struct Runs {
    /// Runs in a fixed order.
    pub runs: Vec<Run>,
    /// Corners of borders that pass each vertex once.
    pub corners: Vec<Corner>,
    /// Pairs of runs that mirror one another (the weft axis turned over).
    pub mirrored: Vec<[usize; 2]>,
}

impl Run {
    /// Length along the border [m].
    pub fn length(&self, pattern: &[Vec2]) -> f64 {
        self.vertices.windows(2).map(|e| (pattern[e[1] as usize] - pattern[e[0] as usize]).norm()).sum()
    }

    /// The run's vertex that is farthest from the chord: its index in the run and its signed
    /// distance over the chord's length.
    pub fn deviation(&self, pattern: &[Vec2]) -> (usize, f64) {
        let at = |k: usize| pattern[self.vertices[k] as usize];
        let chord = at(self.vertices.len() - 1) - at(0);
        let size = chord.norm_squared();
        (1..self.vertices.len() - 1).map(|k| (k, chord.perp(&(at(k) - at(0))) / size)).fold(
            (0, 0.0),
            |worst: (usize, f64), here| if here.1.abs() > worst.1.abs() { here } else { worst },
        )
    }

    pub(super) fn ends(&self, pattern: &[Vec2]) -> [Vec2; 2] {
        [self.vertices[0], self.vertices[self.vertices.len() - 1]].map(|v| pattern[v as usize])
    }

    pub(super) fn middle(&self, pattern: &[Vec2]) -> Vec2 {
        self.vertices.iter().map(|&v| pattern[v as usize]).sum::<Vec2>() / self.vertices.len() as f64
    }
}

impl Corner {
    /// The interior angle [rad], counter-clockwise from the edge ahead to the edge behind.
    pub fn angle(&self, pattern: &[Vec2]) -> f64 {
        let at = |v: u32| pattern[v as usize] - pattern[self.vertex as usize];
        let (a, b) = (at(self.after), at(self.before));
        a.perp(&b).atan2(a.dot(&b))
    }

    /// Change of the angle against the original pattern, within half a turn [rad].
    pub fn turned(&self, original: &[Vec2], pattern: &[Vec2]) -> f64 {
        let change = self.angle(pattern) - self.angle(original);
        change.sin().atan2(change.cos())
    }
}

impl Runs {
    /// The outline of the garment's original pattern.
    pub fn new(garment: &Garment) -> Runs {
        let mut after: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let mut before: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for [u, v] in garment.border_edges() {
            after.entry(u).or_default().push(v);
            before.entry(v).or_default().push(u);
        }
        let mut corners = Vec::new();
        let mut stops = BTreeSet::new();
        for (&vertex, ahead) in &after {
            let behind = before.get(&vertex).map_or(&[][..], Vec::as_slice);
            let (&[ahead], &[behind]) = (&ahead[..], behind) else {
                stops.insert(vertex); // two borders touch here
                continue;
            };
            let at = |v: u32| garment.pattern[v as usize] - garment.pattern[vertex as usize];
            let (a, b) = (at(ahead), at(behind));
            if -a.dot(&b) < CORNER.cos() * a.norm() * b.norm() {
                stops.insert(vertex);
                corners.push(Corner { vertex, before: behind, after: ahead });
            }
        }
        let mut runs = walk(garment, &after, &stops);
        for run in &mut runs {
            let [a, b] = run.ends(&garment.pattern);
            run.straight = a != b && run.deviation(&garment.pattern).1.abs() < STRAIGHT;
        }
        let mirrored = super::mirror::pairs(garment, &runs);
        Runs { runs, corners, mirrored }
    }
}

/// Runs from stop to stop, then what goes round without any.
fn walk(garment: &Garment, after: &BTreeMap<u32, Vec<u32>>, stops: &BTreeSet<u32>) -> Vec<Run> {
    let mut used = BTreeSet::new();
    let mut runs = Vec::new();
    let starts = stops.iter().chain(after.keys());
    for &start in starts {
        for &first in after.get(&start).map_or(&[][..], Vec::as_slice) {
            if !used.insert([start, first]) {
                continue;
            }
            let mut vertices = vec![start, first];
            loop {
                let last = vertices[vertices.len() - 1];
                if stops.contains(&last) || last == start {
                    break;
                }
                let Some(&next) = after.get(&last).and_then(|list| list.first()) else { break };
                if !used.insert([last, next]) {
                    break;
                }
                vertices.push(next);
            }
            runs.push(Run { panel: garment.panel_of_vertex[start as usize], vertices, straight: false });
        }
    }
    runs
}
