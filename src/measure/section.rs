//! Plane sections of triangle meshes.

use std::collections::HashMap;

use crate::model::seam::DisjointSets;
use crate::model::{ClothPoint, Tape, Vec2, Vec3};

/// A plane with two axes in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of it [m].
    pub origin: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    axes: [Vec3; 2],
}

impl Plane {
    /// Through `origin`, at right angles to `normal` (of any length but zero).
    pub fn new(origin: Vec3, normal: Vec3) -> Plane {
        let normal = normal.normalize();
        let other = if normal.x.abs() < 0.6 { Vec3::x() } else { Vec3::z() };
        let u = normal.cross(&other).normalize();
        Plane { origin, normal, axes: [u, normal.cross(&u)] }
    }

    /// At `height` across the Y axis.
    pub fn level(height: f64) -> Plane {
        Plane::new(Vec3::new(0.0, height, 0.0), Vec3::y())
    }

    /// Signed distance from the plane [m].
    pub fn height(&self, p: &Vec3) -> f64 {
        (p - self.origin).dot(&self.normal)
    }

    /// In the plane's own axes [m].
    pub fn flat(&self, p: &Vec3) -> Vec2 {
        let d = p - self.origin;
        Vec2::new(d.dot(&self.axes[0]), d.dot(&self.axes[1]))
    }

    /// Where a polyline first passes through the plane.
    pub fn crossing(&self, line: &[Vec3]) -> Option<Vec3> {
        line.windows(2).find_map(|e| {
            let (a, b) = (self.height(&e[0]), self.height(&e[1]));
            ((a >= 0.0) != (b >= 0.0)).then(|| e[0] + (e[1] - e[0]) * (a / (a - b)))
        })
    }
}

/// A connected piece of a section.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// The way across the mesh.
    pub tape: Tape,
    /// Its straight pieces in the plane's axes, all in one sense of turning [m].
    pub lines: Vec<[Vec2; 2]>,
}

impl Piece {
    /// How often the piece goes round a point of the plane (in turns, unsigned; less than one
    /// if it is open).
    pub fn turns_around(&self, centre: &Vec2) -> f64 {
        let angle = |[a, b]: &[Vec2; 2]| {
            let (p, q) = (a - centre, b - centre);
            p.perp(&q).atan2(p.dot(&q))
        };
        (self.lines.iter().map(angle).sum::<f64>() / std::f64::consts::TAU).abs()
    }

    /// Length of the convex hull's outline [m].
    pub fn hull_length(&self) -> f64 {
        hull_length(self.lines.iter().flatten().copied().collect())
    }
}

/// The section of the triangles with their vertices at `points`; vertices with the same `weld`
/// are one point. Triangles for which `skip` holds are left out. Pieces come in the order of
/// their first triangle.
pub fn cut(
    points: &[Vec3],
    triangles: &[[u32; 3]],
    weld: &dyn Fn(u32) -> u32,
    skip: &dyn Fn(usize) -> bool,
    plane: &Plane,
) -> Vec<Piece> {
    let heights: Vec<f64> = points.iter().map(|p| plane.height(p)).collect();
    let above = |v: u32| heights[v as usize] >= 0.0;
    let mut number: HashMap<[u32; 2], u32> = HashMap::new();
    let mut cuts = Vec::new();
    for (t, tri) in triangles.iter().enumerate() {
        if tri.iter().all(|&v| above(v)) || !tri.iter().any(|&v| above(v)) || skip(t) {
            continue;
        }
        let (mut ends, mut ids) = (Vec::new(), Vec::new());
        for k in 0..3 {
            let (a, b) = (tri[k], tri[(k + 1) % 3]);
            if above(a) != above(b) {
                let along = heights[a as usize] / (heights[a as usize] - heights[b as usize]);
                ends.push(ClothPoint { a, b, along });
                let next = number.len() as u32;
                let (p, q) = (weld(a), weld(b));
                ids.push(*number.entry([p.min(q), p.max(q)]).or_insert(next));
                // Downwards through the first end: one sense of turning for all triangles.
                if ends.len() == 2 && above(a) {
                    ends.reverse();
                    ids.reverse();
                }
            }
        }
        cuts.push((t as u32, [ends[0], ends[1]], [ids[0], ids[1]]));
    }
    let mut sets = DisjointSets::new(number.len());
    cuts.iter().for_each(|(_, _, ids)| sets.union(ids[0], ids[1]));
    let (label, _) = sets.labels();
    let mut piece_of_label: HashMap<u32, usize> = HashMap::new();
    let mut pieces: Vec<Piece> = Vec::new();
    let at = |p: &ClothPoint| points[p.a as usize] * (1.0 - p.along) + points[p.b as usize] * p.along;
    for (t, ends, ids) in cuts {
        let next = pieces.len();
        let k = *piece_of_label.entry(label[ids[0] as usize]).or_insert(next);
        if k == next {
            pieces.push(Piece::default());
        }
        pieces[k].tape.triangles.push(t);
        pieces[k].tape.segments.push(ends);
        pieces[k].lines.push(ends.map(|p| plane.flat(&at(&p))));
    }
    pieces
}

/// Length of the convex hull's outline [Andrew 1979].
pub fn hull_length(mut points: Vec<Vec2>) -> f64 {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let mut length = 0.0;
    for turn in 0..2 {
        let mut side: Vec<Vec2> = Vec::new();
        for &p in &points {
            while let [.., a, b] = side[..] {
                if (b - a).perp(&(p - b)) > 0.0 {
                    break;
                }
                side.pop();
            }
            side.push(p);
        }
        length += side.windows(2).map(|e| (e[1] - e[0]).norm()).sum::<f64>();
        if turn == 0 {
            points.reverse();
        }
    }
    length
}
