//! Which part of a body something outside can touch.
//!
//! Bodies come with eyes, teeth and tongue as components of their own. They need not be inside
//! in the sense of the winding number (a mouth or an eye socket is a fold of the skin), so we
//! ask what can be seen: from a component's points rays go out to all sides, and a component of
//! which few rays escape the other components is enclosed.

use rayon::prelude::*;

use super::{Surface, intersect};
use crate::model::seam::DisjointSets;
use crate::model::{TriMesh, Vec3};

/// A component is enclosed if less than this fraction of its rays escapes. Of the eyes of our
/// bodies, which look out between open lids, an eighth escape, of mouth parts less than one in
/// a hundred; a shoe or a ring, worn on the outside, lets about half escape.
const ESCAPING: f64 = 0.35;

/// How far outside of a triangle it is asked whether that is inside of the body [m].
const ABOVE: f64 = 1e-4;

/// A body without its inner parts and without skin that lies inside of it, where it crosses
/// itself: what cloth can lie on.
#[derive(Clone, Debug)]
pub struct OuterSkin {
    /// Its surface.
    pub surface: Surface,
    /// Index in the body of each point of the surface.
    pub point_of: Vec<u32>,
}

impl OuterSkin {
    /// Leaves out what [`outer_skin`] calls enclosed and [`buried`] finds.
    pub fn new(body: &TriMesh) -> OuterSkin {
        let (mut mesh, point_of) = submesh(body, &outer_skin(body));
        let surface = Surface::new(mesh.clone());
        let buried = buried(&surface);
        if !buried.contains(&true) {
            return OuterSkin { surface, point_of };
        }
        let mut keep = buried.iter().map(|buried| !buried);
        mesh.triangles.retain(|_| keep.next() == Some(true));
        OuterSkin { surface: Surface::new(mesh), point_of }
    }
}

/// Whether each triangle lies inside of the body that it belongs to: skin beyond the curve where
/// a body crosses itself (an arm in the flank, one flap of a fold in another). Triangles that
/// the curve passes are not buried.
///
/// The winding number just outside of the skin changes only across that curve, so that it is
/// asked once for each part that the curve cuts off.
pub fn buried(surface: &Surface) -> Vec<bool> {
    let mesh = surface.mesh();
    let crossing = intersect::self_intersections(surface);
    if crossing.is_empty() {
        return vec![false; mesh.triangles.len()];
    }
    let mut cut = vec![false; mesh.triangles.len()];
    crossing.iter().flatten().for_each(|&t| cut[t as usize] = true);
    let (part, count) = parts(mesh, &cut);
    let mut largest: Vec<Option<(f64, usize)>> = vec![None; count];
    for t in (0..cut.len()).filter(|&t| !cut[t]) {
        let area = mesh.area_normal(t).norm();
        let best = &mut largest[part[t] as usize];
        if best.is_none_or(|(most, _)| area > most) {
            *best = Some((area, t));
        }
    }
    let inside: Vec<bool> = largest
        .par_iter()
        .map(|best| {
            let Some((_, t)) = *best else { return false };
            let [a, b, c] = mesh.corners(t);
            let normal = mesh.area_normal(t).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            surface.winding_number(&((a + b + c) / 3.0 + normal * ABOVE)) > 0.5
        })
        .collect();
    (0..cut.len()).map(|t| !cut[t] && inside[part[t] as usize]).collect()
}

/// Parts of a mesh that are joined over edges between triangles that are not `cut`, and their
/// number.
fn parts(mesh: &TriMesh, cut: &[bool]) -> (Vec<u32>, usize) {
    let mut sets = DisjointSets::new(mesh.triangles.len());
    let mut first = std::collections::HashMap::new();
    for (t, tri) in mesh.triangles.iter().enumerate().filter(|(t, _)| !cut[*t]) {
        for k in 0..3 {
            let (a, b) = (tri[k], tri[(k + 1) % 3]);
            let other = *first.entry((a.min(b), a.max(b))).or_insert(t as u32);
            sets.union(other, t as u32);
        }
    }
    sets.labels()
}

/// Whether each point belongs to the outer skin: false for the components that others enclose
/// (eyes, teeth, tongue). Points without a triangle count as outer.
pub fn outer_skin(mesh: &TriMesh) -> Vec<bool> {
    let (component, count) = mesh.components();
    let mut areas = vec![0.0; count];
    for (t, tri) in mesh.triangles.iter().enumerate() {
        areas[component[tri[0] as usize] as usize] += mesh.area_normal(t).norm();
    }
    if areas.iter().filter(|&&area| area > 0.0).count() < 2 {
        return vec![true; mesh.points.len()];
    }
    let largest = (0..count).max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
    let asked: Vec<usize> =
        (0..mesh.points.len()).filter(|&i| Some(component[i] as usize) != largest).collect();
    let surface = Surface::new(mesh.clone());
    let escaped: Vec<(u32, u32)> =
        asked.par_iter().map(|&i| escaping_rays(&surface, &component, i)).collect();
    let mut rays = vec![(0u32, 0u32); count];
    for (&i, (free, all)) in asked.iter().zip(escaped) {
        let sum = &mut rays[component[i] as usize];
        *sum = (sum.0 + free, sum.1 + all);
    }
    let outer: Vec<bool> = (0..count)
        .map(|c| Some(c) == largest || f64::from(rays[c].0) >= ESCAPING * f64::from(rays[c].1))
        .collect();
    component.iter().map(|&c| outer[c as usize]).collect()
}

/// Of the rays that leave point `i` on its normal's side: how many meet no triangle, and how
/// many there are.
fn escaping_rays(surface: &Surface, component: &[u32], i: usize) -> (u32, u32) {
    let (p, normal) = (surface.mesh().points[i], surface.point_normals()[i]);
    let (mut free, mut all) = (0, 0);
    for direction in directions().filter(|d| d.dot(&normal) > 0.1) {
        all += 1;
        // A convex component does not meet its own rays; one that does hides itself, which
        // says nothing about others.
        let own = |t: u32| component[surface.mesh().triangles[t as usize][0] as usize] == component[i];
        let start = p + direction * 1e-9;
        match surface.ray(&start, &direction, f64::MAX) {
            None => free += 1,
            Some(hit) if own(hit.triangle) => all -= 1,
            Some(_) => {}
        }
    }
    (free, all)
}

/// To the faces, edges and corners of a cube.
fn directions() -> impl Iterator<Item = Vec3> {
    (0..27).filter(|&i| i != 13).map(|i| {
        let step = |n: i32| f64::from(n % 3 - 1);
        Vec3::new(step(i), step(i / 3), step(i / 9)).normalize()
    })
}

/// The mesh of the points kept and the triangles between them, and the old index of each new
/// point.
///
/// # Panics
/// If `keep_point` is not as long as the mesh has points.
pub fn submesh(mesh: &TriMesh, keep_point: &[bool]) -> (TriMesh, Vec<u32>) {
    assert_eq!(keep_point.len(), mesh.points.len(), "one flag for each point");
    let old: Vec<u32> = (0..mesh.points.len() as u32).filter(|&i| keep_point[i as usize]).collect();
    let mut new = vec![u32::MAX; mesh.points.len()];
    for (n, &i) in old.iter().enumerate() {
        new[i as usize] = n as u32;
    }
    let triangles = mesh
        .triangles
        .iter()
        .map(|tri| tri.map(|i| new[i as usize]))
        .filter(|tri| !tri.contains(&u32::MAX))
        .collect();
    let points = old.iter().map(|&i| mesh.points[i as usize]).collect();
    (TriMesh { points, triangles }, old)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::sphere;

    fn joined(parts: &[TriMesh]) -> TriMesh {
        let mut all = TriMesh::default();
        for part in parts {
            let n = all.points.len() as u32;
            all.points.extend(&part.points);
            all.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + n)));
        }
        all
    }

    fn ball(center: Vec3, radius: f64) -> TriMesh {
        let mut mesh = sphere(12, 16);
        mesh.points.iter_mut().for_each(|p| *p = center + *p * radius);
        mesh
    }

    #[test]
    fn skin_inside_of_crossing_balls_is_buried() {
        let mesh = joined(&[ball(Vec3::zeros(), 1.0), ball(Vec3::new(1.1, 0.02, 0.03), 0.6)]);
        let buried = buried(&Surface::new(mesh.clone()));
        let half = mesh.triangles.len() / 2;
        let within = |t: usize| {
            let (center, radius) =
                if t < half { (Vec3::new(1.1, 0.02, 0.03), 0.6) } else { (Vec3::zeros(), 1.0) };
            mesh.corners(t).map(|p| (p - center).norm() / radius)
        };
        for t in 0..mesh.triangles.len() {
            let far = within(t);
            if far.iter().all(|&d| d < 0.9) {
                assert!(buried[t], "{t} {far:?}");
            }
            assert!(!buried[t] || far.iter().all(|&d| d < 1.0), "{t} {far:?}");
        }
        assert!(!super::buried(&Surface::new(ball(Vec3::zeros(), 1.0))).contains(&true));
        let skin = OuterSkin::new(&mesh);
        let gone = buried.iter().filter(|b| **b).count();
        assert_eq!(skin.surface.mesh().triangles.len(), mesh.triangles.len() - gone);
    }

    #[test]
    fn balls_inside_are_not_skin_and_balls_outside_are() {
        let n = ball(Vec3::zeros(), 1.0).points.len();
        let mesh = joined(&[
            ball(Vec3::zeros(), 1.0),
            ball(Vec3::new(0.3, 0.0, 0.0), 0.1),
            ball(Vec3::new(1.2, 0.0, 0.0), 0.2),
            ball(Vec3::new(0.0, 0.92, 0.0), 0.1), // an eye: a little of it looks out
        ]);
        let skin = outer_skin(&mesh);
        for (part, expected) in [true, false, true, false].into_iter().enumerate() {
            assert!(skin[part * n..(part + 1) * n].iter().all(|&s| s == expected), "part {part}");
        }
        let (kept, old) = submesh(&mesh, &skin);
        assert_eq!(kept.points.len(), 2 * n);
        assert_eq!(kept.triangles.len(), mesh.triangles.len() / 2);
        for (new, &i) in old.iter().enumerate() {
            assert_eq!(kept.points[new], mesh.points[i as usize]);
        }
    }
}
