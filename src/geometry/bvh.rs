//! A bounding volume hierarchy over triangles, flattened.
//!
//! parry builds the tree; [`flatten`] lays it out depth first, so that a subtree is a
//! contiguous range and a traversal needs no stack: from node `i` go to `i + 1` to descend, or
//! to `skip` to leave the subtree out. That is what a kernel can walk.

use bytemuck::{Pod, Zeroable};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, TraversalAction};

use crate::model::{TriMesh, Vec3};

/// [`Node::triangle`] of a node that is not a leaf.
pub const INNER: u32 = u32::MAX;

/// A node of the flattened tree; 56 bytes without padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Node {
    /// Lower corner of the box [m].
    pub lo: [f64; 3],
    /// Upper corner of the box [m].
    pub hi: [f64; 3],
    /// Index of the first node after this subtree; the number of nodes ends the walk.
    pub skip: u32,
    /// The triangle of a leaf, else [`INNER`].
    pub triangle: u32,
}

impl Node {
    /// Whether this is a leaf.
    pub fn is_leaf(&self) -> bool {
        self.triangle != INNER
    }

    /// Whether the box and `[lo, hi]` have a point in common.
    pub fn overlaps(&self, lo: &Vec3, hi: &Vec3) -> bool {
        (0..3).all(|k| self.lo[k] <= hi[k] && lo[k] <= self.hi[k])
    }
}

pub(crate) fn to_parry(v: &Vec3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// parry's tree over the boxes of a mesh's triangles, one leaf each.
pub(crate) fn build(mesh: &TriMesh) -> Bvh {
    let boxes: Vec<Aabb> = (0..mesh.triangles.len()).map(|t| bounds(mesh, t)).collect();
    Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes)
}

/// The same tree over triangles that have moved: each leaf has its new box, and so has what is above.
pub(crate) fn refit(tree: &mut Bvh, mesh: &TriMesh) {
    for t in 0..mesh.triangles.len() {
        tree.insert_or_update_partially(bounds(mesh, t), t as u32, 0.0);
    }
    tree.refit_without_opt();
}

fn bounds(mesh: &TriMesh, t: usize) -> Aabb {
    let [a, b, c] = mesh.corners(t);
    Aabb::new(to_parry(&a.inf(&b).inf(&c)), to_parry(&a.sup(&b).sup(&c)))
}

/// The tree's nodes in depth-first order, the root first.
pub(crate) fn flatten(tree: &Bvh) -> Vec<Node> {
    // parry visits both children of a node before it descends into the left one.
    let mut visited = Vec::new();
    tree.traverse(|node| {
        visited.push(flat(node.mins(), node.maxs(), node.leaf_data()));
        TraversalAction::Continue
    });
    let mut nodes: Vec<Node> = Vec::with_capacity(visited.len() + 1);
    if visited.len() > 1 {
        let bounds = tree.root_aabb();
        nodes.push(flat(bounds.mins, bounds.maxs, None));
    }
    let mut pending: Vec<Node> = Vec::new();
    let mut siblings = visited.chunks(2);
    let mut descend = true;
    loop {
        if descend {
            let Some(pair) = siblings.next() else { break };
            pending.extend(pair.iter().rev());
        }
        let Some(node) = pending.pop() else { break };
        descend = !node.is_leaf();
        nodes.push(node);
    }
    for i in (0..nodes.len()).rev() {
        nodes[i].skip = if nodes[i].is_leaf() {
            i as u32 + 1
        } else {
            let right = nodes[i + 1].skip;
            nodes[right as usize].skip
        };
    }
    nodes
}

fn flat(lo: Vector, hi: Vector, triangle: Option<u32>) -> Node {
    let triangle = triangle.unwrap_or(INNER);
    Node { lo: [lo.x, lo.y, lo.z], hi: [hi.x, hi.y, hi.z], skip: 0, triangle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::sphere;

    #[test]
    fn subtrees_are_contiguous_and_boxes_nest() {
        for mesh in [sphere(12, 17), sphere(2, 3)] {
            let nodes = flatten(&build(&mesh));
            assert_eq!(nodes.len(), 2 * mesh.triangles.len() - 1);
            let mut seen = vec![0; mesh.triangles.len()];
            for (i, node) in nodes.iter().enumerate() {
                assert!(node.skip as usize > i && node.skip as usize <= nodes.len());
                if node.is_leaf() {
                    seen[node.triangle as usize] += 1;
                    assert_eq!(node.skip as usize, i + 1);
                    continue;
                }
                let right = nodes[i + 1].skip as usize;
                assert_eq!(nodes[right].skip, node.skip);
                for child in [&nodes[i + 1], &nodes[right]] {
                    assert!((0..3).all(|k| node.lo[k] <= child.lo[k] && child.hi[k] <= node.hi[k]));
                }
            }
            assert!(seen.iter().all(|&n| n == 1));
        }
    }

    #[test]
    fn no_triangle_and_one_triangle() {
        assert!(flatten(&build(&TriMesh::default())).is_empty());
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let nodes = flatten(&build(&TriMesh { points, triangles: vec![[0, 1, 2]] }));
        assert_eq!(nodes.len(), 1);
        assert_eq!((nodes[0].triangle, nodes[0].skip), (0, 1));
    }
}
