//! A measuring tape laid over the cloth of a garment.

use serde::{Deserialize, Serialize};

use super::{Vec2, Vec3};

/// A point on an edge of the cloth: `(1 - along) * a + along * b`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClothPoint {
    /// First vertex of the edge.
    pub a: u32,
    /// Second vertex.
    pub b: u32,
    /// Place between them, 0 to 1.
    pub along: f64,
}

impl ClothPoint {
    /// Vertices with their weights.
    pub fn weights(&self) -> [(u32, f64); 2] {
        [(self.a, 1.0 - self.along), (self.b, self.along)]
    }
}

/// Straight pieces across triangles, from edge to edge.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tape {
    /// The triangle of each piece.
    pub triangles: Vec<u32>,
    /// Its two ends.
    pub segments: Vec<[ClothPoint; 2]>,
}

impl Tape {
    /// Length in the flat pattern: what the cloth measures at rest [m].
    pub fn rest_length(&self, pattern: &[Vec2]) -> f64 {
        let at = |p: &ClothPoint| p.weights().iter().map(|&(v, w)| pattern[v as usize] * w).sum::<Vec2>();
        self.segments.iter().map(|[a, b]| (at(b) - at(a)).norm()).sum()
    }

    /// Length in space, as worn [m].
    pub fn worn_length(&self, points: &[Vec3]) -> f64 {
        let at = |p: &ClothPoint| p.weights().iter().map(|&(v, w)| points[v as usize] * w).sum::<Vec3>();
        self.segments.iter().map(|[a, b]| (at(b) - at(a)).norm()).sum()
    }
}
