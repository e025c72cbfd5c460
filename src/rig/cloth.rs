//! The cloth as the rig sees it: nodes, pieces, and who is whose neighbour.

use super::Sewn;
use crate::model::TriMesh;

/// Smallest share of the mean area that a point counts with: slivers would stiffen all.
const LEAST_AREA: f64 = 1e-3;
/// Cotangents beyond this are those of slivers.
const MOST_COTANGENT: f64 = 50.0;

/// A neighbour of a node.
#[derive(Clone, Copy)]
pub(super) struct Neighbour {
    pub node: u32,
    /// Half the sum of the cotangents opposite to the edge.
    pub cotangent: f64,
}

/// Cloth over its nodes (seam groups).
pub(super) struct Cloth {
    pub mesh: TriMesh,
    /// Area of each node, not below a share of the mean [m^2].
    pub areas: Vec<f64>,
    /// Connected piece of each node.
    pub piece: Vec<u32>,
    pub piece_count: usize,
    first: Vec<u32>,
    neighbours: Vec<Neighbour>,
}

impl Cloth {
    /// The nodes of what is sewn together.
    pub fn new(sewn: &Sewn<'_>) -> Cloth {
        Cloth::of_mesh(node_mesh(sewn))
    }

    fn of_mesh(mesh: TriMesh) -> Cloth {
        let (piece, piece_count) = mesh.components();
        let mut areas = mesh.point_areas();
        let least = LEAST_AREA * areas.iter().sum::<f64>() / areas.len().max(1) as f64;
        areas.iter_mut().for_each(|a| *a = a.max(least));
        let (first, neighbours) = neighbours(&mesh);
        Cloth { mesh, areas, piece, piece_count, first, neighbours }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.mesh.points.len()
    }

    /// Nodes that share an edge with `node`, ascending.
    pub fn around(&self, node: usize) -> &[Neighbour] {
        &self.neighbours[self.first[node] as usize..self.first[node + 1] as usize]
    }
}

/// The cloth over its nodes; triangles that a seam has closed up are left out.
pub(super) fn node_mesh(sewn: &Sewn<'_>) -> TriMesh {
    let node = &sewn.groups.node_of_vertex;
    let triangles = sewn.triangles.iter().map(|t| t.map(|v| node[v as usize]));
    TriMesh {
        points: sewn.groups.node_points(sewn.points),
        triangles: triangles.filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect(),
    }
}

/// Each node's neighbours, and where each node's begin.
fn neighbours(mesh: &TriMesh) -> (Vec<u32>, Vec<Neighbour>) {
    let mut first = vec![0u32; mesh.points.len() + 1];
    for &i in mesh.triangles.iter().flatten() {
        first[i as usize + 1] += 2;
    }
    for i in 1..first.len() {
        first[i] += first[i - 1];
    }
    let none = Neighbour { node: 0, cotangent: 0.0 };
    let mut all = vec![none; first[mesh.points.len()] as usize];
    let mut next = first.clone();
    for (t, tri) in mesh.triangles.iter().enumerate() {
        let p = mesh.corners(t);
        for k in 0..3 {
            let (i, j) = (tri[(k + 1) % 3], tri[(k + 2) % 3]);
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let cotangent = a.dot(&b) / a.cross(&b).norm().max(f64::MIN_POSITIVE);
            let cotangent = 0.5 * cotangent.clamp(-MOST_COTANGENT, MOST_COTANGENT);
            for (r, node) in [(i, j), (j, i)] {
                all[next[r as usize] as usize] = Neighbour { node, cotangent };
                next[r as usize] += 1;
            }
        }
    }
    merge(&first, &mut all)
}

/// Sorts each node's entries and adds up those of the triangles of an edge.
fn merge(first: &[u32], all: &mut [Neighbour]) -> (Vec<u32>, Vec<Neighbour>) {
    let mut merged: Vec<Neighbour> = Vec::with_capacity(all.len() / 2 + first.len());
    let mut starts = vec![0];
    for window in first.windows(2) {
        let start = merged.len();
        let own = &mut all[window[0] as usize..window[1] as usize];
        own.sort_unstable_by_key(|e| e.node);
        for entry in own {
            match merged[start..].last_mut() {
                Some(last) if last.node == entry.node => last.cotangent += entry.cotangent,
                _ => merged.push(*entry),
            }
        }
        starts.push(merged.len() as u32);
    }
    (starts, merged)
}
