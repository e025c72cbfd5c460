//! Which panels mirror one another.
//!
//! Outlines alone do not tell: the front of a waistband is the mirror image of its back. So the
//! garment's middle is found first, the upright plane about which its shape in space comes
//! nearest to its own mirror image; mirrored runs must lie on either side of it.

use std::collections::BTreeMap;

use super::runs::Run;
use crate::model::{Garment, Vec2, Vec3};

/// Ends of mirrored runs agree to this part of their panel's size, middles to ten times it.
const MIRRORED: f64 = 2e-3;
/// Directions of the middle plane that are tried in half a turn.
const DIRECTIONS: usize = 36;
/// Points that are mirrored, and points that they are compared with.
const SAMPLES: [usize; 2] = [150, 3000];
/// A drape is not symmetric: mirrored runs may miss each other in space by this part of the
/// garment's size.
const ASKEW: f64 = 0.06;

/// The upright plane about which a garment is most symmetric.
#[derive(Clone, Copy, Debug)]
struct Middle {
    origin: Vec3,
    normal: Vec3,
    /// How far apart mirrored things may be [m].
    slack: f64,
}

impl Middle {
    fn find(points: &[Vec3]) -> Option<Middle> {
        let origin = points.iter().sum::<Vec3>() / points.len() as f64;
        let size = points.iter().map(|p| (p - origin).norm()).fold(0.0, f64::max);
        let [few, many] = SAMPLES.map(|count| points.iter().step_by(points.len().div_ceil(count)));
        let few: Vec<Vec3> = few.map(|p| p - origin).collect();
        let many: Vec<Vec3> = many.map(|p| p - origin).collect();
        let normals = (0..DIRECTIONS).map(|k| {
            let angle = std::f64::consts::PI * k as f64 / DIRECTIONS as f64;
            Vec3::new(angle.cos(), 0.0, angle.sin())
        });
        let miss = |normal: &Vec3| -> f64 {
            let nearest = |p: &Vec3| {
                let image = p - normal * (2.0 * p.dot(normal));
                many.iter().map(|q| (q - image).norm_squared()).fold(f64::MAX, f64::min)
            };
            few.iter().map(nearest).sum()
        };
        let best = normals.map(|n| (miss(&n), n)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Middle { origin, normal: best.1, slack: 2.0 * ASKEW * size })
    }

    /// Whether two points lie on either side of the plane as mirror images do.
    fn mirrors(&self, a: Vec3, b: Vec3) -> bool {
        let image = a - self.normal * (2.0 * (a - self.origin).dot(&self.normal));
        (image - b).norm() < self.slack
    }
}

/// Pairs of runs of panels whose outlines are mirror images, from panel to panel or within one,
/// and which the garment has on either side of its middle.
pub fn pairs(garment: &Garment, runs: &[Run]) -> Vec<[usize; 2]> {
    let Some(middle) = Middle::find(&garment.points) else { return Vec::new() };
    let mut of_panel: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (r, run) in runs.iter().enumerate() {
        of_panel.entry(run.panel).or_default().push(r);
    }
    let panels: Vec<(&Vec<usize>, Vec2, Vec2)> = of_panel
        .values()
        .map(|list| {
            let points = list.iter().flat_map(|&r| &runs[r].vertices).map(|&v| garment.pattern[v as usize]);
            let first = garment.pattern[runs[list[0]].vertices[0] as usize];
            let (low, high) = points.fold((first, first), |(l, h), p| (l.inf(&p), h.sup(&p)));
            (list, (low + high) * 0.5, high - low)
        })
        .collect();
    let worn = |run: &Run| -> Vec3 {
        run.vertices.iter().map(|&v| garment.points[v as usize]).sum::<Vec3>() / run.vertices.len() as f64
    };
    let mut pairs = Vec::new();
    for (p, (ours, centre, size)) in panels.iter().enumerate() {
        for (theirs, other_centre, other_size) in &panels[p..] {
            let tolerance = MIRRORED * size.norm();
            if ours.len() != theirs.len() || (size - other_size).norm() > tolerance {
                continue;
            }
            let image = |q: Vec2| Vec2::new(q.x - centre.x, centre.y - q.y) + other_centre;
            let partner = |&r: &usize| {
                let ([a, b], centre) = (runs[r].ends(&garment.pattern), runs[r].middle(&garment.pattern));
                theirs.iter().copied().find(|&s| {
                    let [c, d] = runs[s].ends(&garment.pattern);
                    let near = |x: Vec2, y: Vec2, slack: f64| (image(x) - y).norm() < slack * tolerance;
                    // The vertices along a mirrored run need not be images of one another.
                    near(a, d, 1.0)
                        && near(b, c, 1.0)
                        && near(centre, runs[s].middle(&garment.pattern), 10.0)
                        && middle.mirrors(worn(&runs[r]), worn(&runs[s]))
                })
            };
            let found: Option<Vec<[usize; 2]>> = ours.iter().map(|r| partner(r).map(|s| [*r, s])).collect();
            pairs.extend(
                found.into_iter().flatten().filter(|[r, s]| r != s).map(|[r, s]| [r.min(s), r.max(s)]),
            );
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
