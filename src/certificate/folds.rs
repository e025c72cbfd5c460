//! How crumpled a garment is, to compare with its source: the mesh is the same.

use std::collections::BTreeMap;

use crate::model::Vec3;

/// Root mean square of the angles between triangles that share an edge inside of a panel [rad]; 0
/// where there are none. Triangles without a normal are left out.
///
/// `triangles` index the vertices `points` [m], which panels do not share.
pub fn angle_rms(triangles: &[[u32; 3]], points: &[Vec3]) -> f64 {
    let normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        (b - a).cross(&(c - a)).try_normalize(0.0)
    };
    let mut normals_of_edge: BTreeMap<[u32; 2], Vec<Vec3>> = BTreeMap::new();
    for t in triangles {
        let Some(normal) = normal(t) else { continue };
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            normals_of_edge.entry([a.min(b), a.max(b)]).or_default().push(normal);
        }
    }
    let angles = normals_of_edge.values().filter_map(|normals| match normals[..] {
        [a, b] => Some(a.cross(&b).norm().atan2(a.dot(&b))),
        _ => None,
    });
    let (sum, count) = angles.fold((0.0, 0.0), |(sum, count), angle| (sum + angle * angle, count + 1.0));
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}
