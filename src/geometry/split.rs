//! Splits long edges of a mesh, so that its points follow what happens along them.

use std::collections::HashMap;

use crate::model::Vec3;

/// Rounds of halving, more than any edge of a body needs.
const ROUNDS: usize = 16;

/// A mesh with edges split in the middle. Its points are those of the mesh that it was made from, then
/// the middles.
#[derive(Clone, Debug)]
pub struct Split {
    /// Triangles over all points; they cover what the mesh's triangles cover.
    pub triangles: Vec<[u32; 3]>,
    /// For each further point the two earlier ones that it lies between.
    pub middles: Vec<[u32; 2]>,
}

impl Split {
    /// Splits edges until none is longer than `longest` [m] with the mesh's points at any of
    /// `placements`, of which there is at least one.
    pub fn new(triangles: &[[u32; 3]], placements: &[&[Vec3]], longest: f64) -> Split {
        let mut places: Vec<Vec<Vec3>> = placements.iter().map(|points| points.to_vec()).collect();
        let mut split = Split { triangles: triangles.to_vec(), middles: Vec::new() };
        for _ in 0..ROUNDS {
            let halves = split.halve(&mut places, longest);
            if halves.is_empty() {
                break;
            }
            split.triangles = split.triangles.iter().flat_map(|&t| parts(t, &halves, &places[0])).collect();
        }
        split
    }

    /// All points with the mesh's own at `points`.
    pub fn points(&self, points: &[Vec3]) -> Vec<Vec3> {
        let mut all = points.to_vec();
        all.reserve(self.middles.len());
        for &[a, b] in &self.middles {
            all.push((all[a as usize] + all[b as usize]) * 0.5);
        }
        all
    }

    /// Adds the middles of the edges that are too long: the new point of each.
    fn halve(&mut self, places: &mut [Vec<Vec3>], longest: f64) -> HashMap<[u32; 2], u32> {
        let mut halves = HashMap::new();
        let too_long = |places: &[Vec<Vec3>], [a, b]: [u32; 2]| {
            places.iter().any(|p| (p[a as usize] - p[b as usize]).norm() > longest)
        };
        for edge in self.triangles.iter().flat_map(|t| [edge(t[1], t[2]), edge(t[2], t[0]), edge(t[0], t[1])])
        {
            if !halves.contains_key(&edge) && too_long(places, edge) {
                halves.insert(edge, places[0].len() as u32);
                self.middles.push(edge);
                let [a, b] = edge.map(|i| i as usize);
                places.iter_mut().for_each(|p| p.push((p[a] + p[b]) * 0.5));
            }
        }
        halves
    }
}

fn edge(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// The parts of a triangle some of whose edges have a middle; of two ways to part it the one with the
/// shorter edge, with the points at `places`.
fn parts(t: [u32; 3], halves: &HashMap<[u32; 2], u32>, places: &[Vec3]) -> Vec<[u32; 3]> {
    // `m[k]` is the middle of the edge opposite to corner k.
    let m = [0, 1, 2].map(|k| halves.get(&edge(t[(k + 1) % 3], t[(k + 2) % 3])).copied());
    let turned = |k: usize| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
    match m {
        [None, None, None] => vec![t],
        [Some(a), Some(b), Some(c)] => vec![[t[0], c, b], [c, t[1], a], [b, a, t[2]], [a, b, c]],
        _ if m.iter().flatten().count() == 1 => {
            let k = m.iter().position(Option::is_some).expect("one of three");
            let ([p, q, r], middle) = (turned(k), m[k].expect("it has one"));
            vec![[p, q, middle], [p, middle, r]]
        }
        _ => {
            // Corner p is the one between the two edges that have a middle.
            let k = m.iter().position(Option::is_none).expect("one of three");
            let [p, q, r] = turned(k);
            let (on_rp, on_pq) = (m[(k + 1) % 3].expect("it has one"), m[(k + 2) % 3].expect("it has one"));
            let length = |a: u32, b: u32| (places[a as usize] - places[b as usize]).norm_squared();
            match length(q, on_rp) < length(r, on_pq) {
                true => vec![[p, on_pq, on_rp], [on_pq, q, on_rp], [q, r, on_rp]],
                false => vec![[p, on_pq, on_rp], [on_pq, q, r], [on_pq, r, on_rp]],
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Surface;
    use crate::geometry::surface::tests::sphere;
    use crate::model::TriMesh;

    #[test]
    fn long_edges_are_split_and_the_surface_stays() {
        let mesh = sphere(8, 12); // of radius 1 m
        let longest = 0.2;
        let split = Split::new(&mesh.triangles, &[&mesh.points], longest);
        let fine = TriMesh { points: split.points(&mesh.points), triangles: split.triangles.clone() };
        assert_eq!(fine.points[..mesh.points.len()], mesh.points);
        let area = |mesh: &TriMesh| mesh.point_areas().iter().sum::<f64>();
        assert!((area(&fine) - area(&mesh)).abs() < 1e-12 * area(&mesh));
        for t in &fine.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                assert!((fine.points[a as usize] - fine.points[b as usize]).norm() <= longest);
            }
        }
        let (coarse, surface) = (Surface::new(mesh), Surface::new(fine.clone()));
        assert!(surface.is_closed(), "edges are split for both of their triangles");
        for t in 0..fine.triangles.len() {
            let middle = fine.corners(t).iter().sum::<Vec3>() / 3.0;
            let closest = coarse.closest(&middle);
            assert!(closest.distance < 1e-12);
            let normal = coarse.mesh().area_normal(closest.triangle as usize);
            assert!(fine.area_normal(t).dot(&normal) > 0.0, "the side is kept");
        }
    }

    #[test]
    fn every_placement_counts_and_short_edges_stay() {
        let mesh = sphere(8, 12);
        let whole = Split::new(&mesh.triangles, &[&mesh.points], 10.0);
        assert!(whole.middles.is_empty() && whole.triangles == mesh.triangles);
        let stretched: Vec<Vec3> = mesh.points.iter().map(|p| Vec3::new(20.0 * p.x, p.y, p.z)).collect();
        let split = Split::new(&mesh.triangles, &[&mesh.points, &stretched], 10.0);
        assert!(!split.middles.is_empty());
        let [a, b] = split.middles[0].map(|i| stretched[i as usize]);
        assert!((a - b).norm() > 10.0);
        assert_eq!(split.points(&stretched)[mesh.points.len()], (a + b) * 0.5);
    }
}
