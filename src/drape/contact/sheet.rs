//! The cloth as contact sees it: seams welded, offset vertices apart.

use std::collections::HashMap;

use super::fixed::Edges;
use crate::model::{Garment, Vec3};

/// The garment's surface over *contact points*: one for each node, and one for each vertex
/// that is sewn with an offset from its node.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// Node of each contact point.
    pub node: Vec<u32>,
    /// A vertex of each contact point.
    pub vertex: Vec<u32>,
    /// Triangles over contact points.
    pub triangles: Vec<[u32; 3]>,
    /// Edges over contact points.
    pub edges: Edges,
    /// Contact points on the source body [m].
    pub source: Vec<Vec3>,
}

impl Sheet {
    /// The sheet of a garment.
    pub fn new(garment: &Garment) -> Sheet {
        let groups = &garment.groups;
        let mut of_key = HashMap::new();
        let (mut node, mut vertex) = (Vec::new(), Vec::new());
        let point_of_vertex: Vec<u32> = (0..garment.points.len())
            .map(|v| {
                let n = groups.node_of_vertex[v];
                let key = if groups.has_offset[v] { Some(garment.point_of_vertex[v]) } else { None };
                *of_key.entry((n, key)).or_insert_with(|| {
                    node.push(n);
                    vertex.push(v as u32);
                    node.len() as u32 - 1
                })
            })
            .collect();
        let triangles: Vec<[u32; 3]> =
            garment.triangles.iter().map(|t| t.map(|v| point_of_vertex[v as usize])).collect();
        let source = vertex.iter().map(|&v| garment.points[v as usize]).collect();
        Sheet { node, vertex, edges: Edges::new(&triangles), triangles, source }
    }

    /// Contact points from vertices.
    pub fn points(&self, vertices: &[Vec3]) -> Vec<Vec3> {
        self.vertex.iter().map(|&v| vertices[v as usize]).collect()
    }

    /// Whether two sets of contact points have a node in common.
    pub fn share_node(&self, a: &[u32], b: &[u32]) -> bool {
        let node = |p: &u32| self.node[*p as usize];
        a.iter().any(|p| b.iter().any(|q| node(p) == node(q)))
    }
}
