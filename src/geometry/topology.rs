//! Which triangles meet at an edge and around a point.
//!
//! Edge `k` of triangle `t` is the one opposite to its corner `k`, and has the number `3 t + k`.
//! All of this stays as it is when points move, so that a surface and its moved copies share it.

use crate::model::{TriMesh, Vec3};

/// What is next to what in a mesh.
#[derive(Debug)]
pub struct Topology {
    /// The next of those that are the same edge, in a ring; itself for an open edge.
    next: Vec<u32>,
    /// Where each point's corners begin in `corners`.
    first: Vec<u32>,
    corners: Vec<u32>,
    /// Whether each edge of each triangle belongs to that triangle alone.
    pub open_edges: Vec<[bool; 3]>,
    /// Whether each point lies on an open edge.
    pub open_points: Vec<bool>,
    /// Whether every edge is passed as often one way as the other: then there is no border, and the
    /// winding number is a whole number that changes only across triangles.
    pub closed: bool,
}

impl Topology {
    /// Of a mesh.
    pub fn new(mesh: &TriMesh) -> Topology {
        let ends = |e: u32| {
            let (tri, k) = (mesh.triangles[e as usize / 3], e as usize % 3);
            (tri[(k + 1) % 3], tri[(k + 2) % 3])
        };
        let count = mesh.points.len();
        let edges = 3 * mesh.triangles.len() as u32;
        let (starts, mut by_point) = buckets(count, edges, |e| ends(e).0.min(ends(e).1));
        let (mut next, mut closed): (Vec<u32>, bool) = ((0..edges).collect(), true);
        let far = |e: u32| ends(e).0.max(ends(e).1);
        for bucket in starts.windows(2) {
            let own = &mut by_point[bucket[0] as usize..bucket[1] as usize];
            own.sort_unstable_by_key(|&e| (far(e), e));
            for same in own.chunk_by(|&a, &b| far(a) == far(b)) {
                for (i, &e) in same.iter().enumerate() {
                    next[e as usize] = same[(i + 1) % same.len()];
                }
                let way = |e: &u32| ends(*e).0.cmp(&ends(*e).1) as i32;
                closed &= same.iter().map(way).sum::<i32>() == 0;
            }
        }
        let mut open_points = vec![false; count];
        for e in (0..edges).filter(|&e| next[e as usize] == e) {
            let (a, b) = ends(e);
            (open_points[a as usize], open_points[b as usize]) = (true, true);
        }
        let open = |t: u32| [0, 1, 2].map(|k| next[(3 * t + k) as usize] == 3 * t + k);
        let open_edges = (0..edges / 3).map(open).collect();
        let (first, corners) = buckets(count, edges, |c| mesh.triangles[c as usize / 3][c as usize % 3]);
        Topology { next, first, corners, open_edges, open_points, closed }
    }

    /// The corners that a point is, ascending: corner `k` of triangle `t` has the number `3 t + k`.
    pub fn corners(&self, point: u32) -> &[u32] {
        &self.corners[self.first[point as usize] as usize..self.first[point as usize + 1] as usize]
    }

    /// Pseudo-normal of edge `k` of triangle `t`: the unit sum of the adjacent faces' normals, zero
    /// where they cancel [Baerentzen 2005].
    pub fn edge_normal(&self, mesh: &TriMesh, t: u32, k: u32) -> Vec3 {
        let start = 3 * t + k;
        let mut sum = face_normal(mesh, t);
        let mut e = self.next[start as usize];
        while e != start {
            sum += face_normal(mesh, e / 3);
            e = self.next[e as usize];
        }
        sum.try_normalize(0.0).unwrap_or_else(Vec3::zeros)
    }

    /// Pseudo-normal of a point: unit, weighted by the faces' angles, as [`TriMesh::point_normals`].
    pub fn point_normal(&self, mesh: &TriMesh, point: u32) -> Vec3 {
        let share = |&c: &u32| face_normal(mesh, c / 3) * mesh.corner_angle(c as usize / 3, c as usize % 3);
        // A triangle without area has a zero normal and perhaps no angle.
        let sum: Vec3 = self.corners(point).iter().map(share).filter(|s| s.x.is_finite()).sum();
        sum.try_normalize(0.0).unwrap_or_else(Vec3::zeros)
    }
}

/// Unit normal of a triangle, zero for one without area.
fn face_normal(mesh: &TriMesh, t: u32) -> Vec3 {
    mesh.area_normal(t as usize).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}

/// The numbers below `items` sorted by `key`, ascending within one, and where each key's begin.
fn buckets(keys: usize, items: u32, key: impl Fn(u32) -> u32) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; keys + 1];
    (0..items).for_each(|i| starts[key(i) as usize + 1] += 1);
    (0..keys).for_each(|k| starts[k + 1] += starts[k]);
    let (mut next, mut sorted) = (starts.clone(), vec![0; items as usize]);
    for i in 0..items {
        let place = &mut next[key(i) as usize];
        sorted[*place as usize] = i;
        *place += 1;
    }
    (starts, sorted)
}

/// For each of so many `points` those that share a triangle's edge with it, ascending.
pub fn neighbours(points: usize, triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); points];
    for t in triangles {
        for k in 0..3 {
            around[t[k] as usize].extend([t[(k + 1) % 3], t[(k + 2) % 3]]);
        }
    }
    for list in &mut around {
        list.sort_unstable();
        list.dedup();
    }
    around
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::sphere;

    #[test]
    fn closed_means_no_border_and_one_orientation() {
        let ball = sphere(5, 6);
        assert!(Topology::new(&ball).closed);
        let mut holed = ball.clone();
        holed.triangles.pop();
        let open = Topology::new(&holed);
        assert!(!open.closed);
        assert_eq!(open.open_edges.iter().flatten().filter(|&&o| o).count(), 3);
        assert_eq!(open.open_points.iter().filter(|&&o| o).count(), 3);
        let mut turned = ball;
        turned.triangles[3].swap(0, 1);
        assert!(!Topology::new(&turned).closed);
    }

    #[test]
    fn normals_of_one_are_those_of_all() {
        let mut mesh = sphere(7, 9);
        mesh.triangles.extend([[3, 3, 9], [4, 12, 30]]); // no area; a third triangle on an edge or more
        let topology = Topology::new(&mesh);
        for (p, n) in mesh.point_normals().iter().enumerate() {
            assert_eq!(topology.point_normal(&mesh, p as u32), *n, "point {p}");
        }
        for t in 0..mesh.triangles.len() as u32 {
            for k in 0..3 {
                let tri = mesh.triangles[t as usize];
                let ends = [tri[(k + 1) % 3], tri[(k + 2) % 3]];
                let has = |u: &[u32; 3]| {
                    (0..3)
                        .filter(|&j| {
                            let own = [u[(j + 1) % 3], u[(j + 2) % 3]];
                            own == ends || [own[1], own[0]] == ends
                        })
                        .count()
                };
                let sum: Vec3 = (0..mesh.triangles.len() as u32)
                    .map(|u| face_normal(&mesh, u) * has(&mesh.triangles[u as usize]) as f64)
                    .sum();
                let expected = sum.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
                let found = topology.edge_normal(&mesh, t, k as u32);
                assert!((found - expected).norm() < 1e-12, "{t} {k}: {found:?} {expected:?}");
            }
        }
    }
}
