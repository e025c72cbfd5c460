//! The cloth as contact sees it: seams welded, offset vertices apart.

use std::collections::HashMap;

use super::fixed::Edges;
use super::tree::{BoxTree, bounds};
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
    /// What is near what on the source.
    pub near: Neighbours,
}

/// Contact points, triangles and edges by where they are on the source.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// Contact points.
    pub points: Nearby,
    /// Triangles.
    pub triangles: Nearby,
    /// Edges.
    pub edges: Nearby,
}

/// Primitives of one kind, for searches that neighbours share.
#[derive(Clone, Debug)]
pub struct Nearby {
    /// An order in which neighbours follow each other.
    pub order: Vec<u32>,
    /// A tree to be fitted to where they are.
    pub tree: BoxTree,
}

impl Nearby {
    fn new<const N: usize>(source: &[Vec3], primitives: impl Iterator<Item = [u32; N]>) -> Nearby {
        let tree = BoxTree::new(primitives.map(|p| bounds(&p.map(|i| source[i as usize]), 0.0)));
        Nearby { order: tree.order(), tree }
    }
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
        Sheet::of(node, vertex, triangles, source)
    }

    /// The sheet of these contact points and triangles, see the fields.
    pub(super) fn of(node: Vec<u32>, vertex: Vec<u32>, triangles: Vec<[u32; 3]>, source: Vec<Vec3>) -> Sheet {
        let edges = Edges::new(&triangles);
        let near = Neighbours {
            points: Nearby::new(&source, (0..source.len() as u32).map(|p| [p])),
            triangles: Nearby::new(&source, triangles.iter().copied()),
            edges: Nearby::new(&source, edges.ends.iter().copied()),
        };
        Sheet { node, vertex, triangles, edges, source, near }
    }

    /// Contact points from vertices.
    pub fn points(&self, vertices: &[Vec3]) -> Vec<Vec3> {
        self.vertex.iter().map(|&v| vertices[v as usize]).collect()
    }

    /// Unit normals of contact points at `x`, area-weighted and averaged once with their
    /// neighbours' (zero where there is none).
    pub fn normals(&self, x: &[Vec3]) -> Vec<Vec3> {
        let mut sums = vec![Vec3::zeros(); x.len()];
        for tri in &self.triangles {
            let [a, b, c] = tri.map(|p| x[p as usize]);
            let normal = (b - a).cross(&(c - a));
            tri.iter().for_each(|&p| sums[p as usize] += normal);
        }
        let mut smooth = sums.clone();
        for &[p, q] in &self.edges.ends {
            smooth[p as usize] += sums[q as usize];
            smooth[q as usize] += sums[p as usize];
        }
        smooth.iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros)).collect()
    }

    /// Whether two sets of contact points have a node in common.
    pub fn share_node(&self, a: &[u32], b: &[u32]) -> bool {
        let node = |p: &u32| self.node[*p as usize];
        a.iter().any(|p| b.iter().any(|q| node(p) == node(q)))
    }
}
