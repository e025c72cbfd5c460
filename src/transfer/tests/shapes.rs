//! Bodies to carry things between.

use crate::model::{TriMesh, Vec3};

/// A subdivided octahedron of radius `r` around `centre`.
pub fn sphere(centre: Vec3, r: f64, divisions: usize) -> TriMesh {
    let mut mesh = TriMesh {
        points: [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
            .map(|p| Vec3::from(p.map(f64::from)))
            .to_vec(),
        triangles: vec![
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ],
    };
    for _ in 0..divisions {
        let mut middle = std::collections::HashMap::new();
        let mut triangles = Vec::new();
        for &[a, b, c] in &mesh.triangles {
            let mut halfway = |i: u32, j: u32| {
                *middle.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    mesh.points.push((mesh.points[i as usize] + mesh.points[j as usize]).normalize());
                    mesh.points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (halfway(a, b), halfway(b, c), halfway(c, a));
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        mesh.triangles = triangles;
    }
    mesh.points.iter_mut().for_each(|p| *p = centre + *p * r);
    mesh
}

/// An axis-aligned box whose faces are grids of `n` by `n` squares.
pub fn block(lo: Vec3, hi: Vec3, n: usize) -> TriMesh {
    let mut mesh = TriMesh::default();
    for axis in 0..3 {
        for side in 0..2 {
            let first = mesh.points.len() as u32;
            for i in 0..=n {
                for j in 0..=n {
                    let mut t = Vec3::zeros();
                    t[axis] = side as f64;
                    t[(axis + 1) % 3] = i as f64 / n as f64;
                    t[(axis + 2) % 3] = j as f64 / n as f64;
                    mesh.points.push(lo + (hi - lo).component_mul(&t));
                }
            }
            let at = |i: usize, j: usize| first + (i * (n + 1) + j) as u32;
            for i in 0..n {
                for j in 0..n {
                    let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                    let faces = if side == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                    mesh.triangles.extend(faces);
                }
            }
        }
    }
    mesh
}

pub fn joined(a: TriMesh, b: TriMesh) -> TriMesh {
    let first = a.points.len() as u32;
    let mut mesh = a;
    mesh.points.extend(b.points);
    mesh.triangles.extend(b.triangles.iter().map(|t| t.map(|i| i + first)));
    mesh
}

pub fn mapped(mesh: &TriMesh, f: impl Fn(&Vec3) -> Vec3) -> TriMesh {
    TriMesh { points: mesh.points.iter().map(f).collect(), triangles: mesh.triangles.clone() }
}
