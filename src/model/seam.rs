//! Seams: what ties the vertices of an unwelded garment together.
//!
//! Seams are vertex pairs; a *seam group* is the set that they tie together (paper section
//! 5, Seams Handling). A group is one node of the cloth. Vertices sewn with an offset (a
//! pocket laid on a front) belong to the group of the vertex that they are sewn onto.

use serde::{Deserialize, Serialize};

use super::Vec3;

/// Union-find over dense indices.
#[derive(Clone, Debug)]
pub struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// `n` sets of one.
    pub fn new(n: usize) -> Self {
        DisjointSets { parent: (0..n as u32).collect() }
    }

    /// The representative of `i`: the smallest index in its set.
    pub fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    /// Joins the sets of `a` and `b`.
    pub fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Dense set labels in order of first index, and their number.
    pub fn labels(mut self) -> (Vec<u32>, usize) {
        let n = self.parent.len();
        let mut label_of_root = vec![u32::MAX; n];
        let mut labels = Vec::with_capacity(n);
        let mut count = 0;
        for i in 0..n as u32 {
            let root = self.find(i) as usize;
            if label_of_root[root] == u32::MAX {
                label_of_root[root] = count;
                count += 1;
            }
            labels.push(label_of_root[root]);
        }
        (labels, count as usize)
    }
}

/// Vertices tied together by seams, as nodes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamGroups {
    /// Node of each vertex, shape `[vertices]`.
    pub node_of_vertex: Vec<u32>,
    /// Number of nodes.
    pub node_count: usize,
    /// Vertices that lie on one another share this, shape `[vertices]`: as `node_of_vertex`,
    /// but vertices sewn with an offset are apart from what they are sewn onto.
    pub weld_of_vertex: Vec<u32>,
    /// Number of distinct welds.
    pub weld_count: usize,
    /// A vertex without offset for each node, shape `[nodes]`: the node's position is its.
    pub anchor_of_node: Vec<u32>,
    /// Whether the vertex is sewn with an offset from its node, shape `[vertices]`.
    pub has_offset: Vec<bool>,
}

impl SeamGroups {
    /// Groups from ties without offset and ties with offset (`[laid on top, sewn onto]`).
    ///
    /// Of several offset ties of one vertex the first counts.
    pub fn new(vertex_count: usize, ties: &[[u32; 2]], offset_ties: &[[u32; 2]]) -> Self {
        let mut flat = DisjointSets::new(vertex_count);
        for &[a, b] in ties {
            flat.union(a, b);
        }
        let mut all = flat.clone();
        let mut has_offset = vec![false; vertex_count];
        let mut offset_roots = std::collections::BTreeSet::new();
        for &[a, b] in offset_ties {
            let (ra, rb) = (flat.find(a), flat.find(b));
            if ra != rb && !offset_roots.contains(&rb) && offset_roots.insert(ra) {
                all.union(ra, rb);
            }
        }
        for v in 0..vertex_count as u32 {
            has_offset[v as usize] = offset_roots.contains(&flat.find(v));
        }
        let (node_of_vertex, node_count) = all.labels();
        let mut anchor_of_node = vec![u32::MAX; node_count];
        for v in 0..vertex_count {
            let anchor = &mut anchor_of_node[node_of_vertex[v] as usize];
            if *anchor == u32::MAX && !has_offset[v] {
                *anchor = v as u32;
            }
        }
        let (weld_of_vertex, weld_count) = flat.labels();
        SeamGroups { node_of_vertex, node_count, weld_of_vertex, weld_count, anchor_of_node, has_offset }
    }

    /// Node positions from vertex positions.
    pub fn node_points(&self, vertex_points: &[Vec3]) -> Vec<Vec3> {
        self.anchor_of_node.iter().map(|&v| vertex_points[v as usize]).collect()
    }

    /// The vector from each vertex's node to the vertex, shape `[vertices]` [m].
    pub fn offsets(&self, vertex_points: &[Vec3]) -> Vec<Vec3> {
        (0..vertex_points.len())
            .map(|v| {
                let anchor = self.anchor_of_node[self.node_of_vertex[v] as usize];
                vertex_points[v] - vertex_points[anchor as usize]
            })
            .collect()
    }
}
