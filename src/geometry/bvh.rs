//! A bounding volume hierarchy over triangles, flattened.
//!
//! parry builds the tree; it is laid out depth first, so that a subtree is a contiguous range and a
//! traversal needs no stack: from node `i` go to `i + 1` to descend, or to `skip` to leave the
//! subtree out. That is what a kernel can walk. [`find_best`] walks it nearest first.

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

    /// Squared distance of a point from the box [m^2].
    #[inline]
    pub fn distance_squared(&self, p: &Vec3) -> f64 {
        // Plain comparisons: `f64::max` also looks for what is no number.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let x = larger(larger(self.lo[0] - p.x, p.x - self.hi[0]), 0.0);
        let y = larger(larger(self.lo[1] - p.y, p.y - self.hi[1]), 0.0);
        let z = larger(larger(self.lo[2] - p.z, p.z - self.hi[2]), 0.0);
        x * x + y * y + z * z
    }

    /// How far along a ray the box begins, with `inverse` one over the components of its direction;
    /// infinite if the ray misses it.
    pub fn along_ray(&self, origin: &Vec3, inverse: &Vec3) -> f64 {
        let (mut enter, mut leave) = (0.0, f64::INFINITY);
        for k in 0..3 {
            if inverse[k].is_infinite() {
                if origin[k] < self.lo[k] || self.hi[k] < origin[k] {
                    return f64::INFINITY;
                }
                continue;
            }
            let (a, b) = ((self.lo[k] - origin[k]) * inverse[k], (self.hi[k] - origin[k]) * inverse[k]);
            (enter, leave) = (f64::max(enter, a.min(b)), f64::min(leave, a.max(b)));
        }
        // Rounding must not part a box from what touches its side.
        if enter <= leave * (1.0 + 8.0 * f64::EPSILON) { enter } else { f64::INFINITY }
    }

    /// Whether the box and `[lo, hi]` have a point in common.
    pub fn overlaps(&self, lo: &Vec3, hi: &Vec3) -> bool {
        (0..3).all(|k| self.lo[k] <= hi[k] && lo[k] <= self.hi[k])
    }
}

/// The tree over the boxes of a mesh's triangles, one leaf each, in depth-first order with the root first.
pub(crate) fn build(mesh: &TriMesh) -> Vec<Node> {
    let to_parry = |v: [f64; 3]| Vector::new(v[0], v[1], v[2]);
    let bounds = |t| {
        let (lo, hi) = bounds(mesh, t);
        Aabb::new(to_parry(lo), to_parry(hi))
    };
    let boxes: Vec<Aabb> = (0..mesh.triangles.len()).map(bounds).collect();
    flatten(&Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes))
}

/// The same tree over triangles that have moved: each leaf has its new box, and so has what is above.
pub(crate) fn refit(nodes: &mut [Node], mesh: &TriMesh) {
    for i in (0..nodes.len()).rev() {
        (nodes[i].lo, nodes[i].hi) = if nodes[i].is_leaf() {
            bounds(mesh, nodes[i].triangle as usize)
        } else {
            let (left, right) = (&nodes[i + 1], &nodes[nodes[i + 1].skip as usize]);
            let (lo, hi) =
                (|k: usize| f64::min(left.lo[k], right.lo[k]), |k: usize| f64::max(left.hi[k], right.hi[k]));
            ([0, 1, 2].map(lo), [0, 1, 2].map(hi))
        };
    }
}

fn bounds(mesh: &TriMesh, t: usize) -> ([f64; 3], [f64; 3]) {
    let [a, b, c] = mesh.corners(t);
    (a.inf(&b).inf(&c).into(), a.sup(&b).sup(&c).into())
}

/// The leaf of least cost below `bound`: its triangle, its cost, and what `leaf` said of it.
///
/// `cost` bounds the cost of all below a node from below; `leaf` gives a triangle's, if it counts.
pub(crate) fn find_best<T>(
    nodes: &[Node],
    bound: f64,
    cost: impl Fn(&Node) -> f64,
    leaf: impl Fn(u32) -> Option<(f64, T)>,
) -> Option<(u32, f64, T)> {
    let mut best = (bound, None);
    let mut pending = Pending::new();
    let root = nodes.first().filter(|root| cost(root) < bound);
    let mut at = root.map(|_| 0);
    while let Some(i) = at {
        let node = &nodes[i as usize];
        at = if node.is_leaf() {
            if let Some((own, found)) = leaf(node.triangle).filter(|(own, _)| *own < best.0) {
                best = (own, Some((node.triangle, own, found)));
            }
            None
        } else {
            let (left, right) = (i + 1, nodes[i as usize + 1].skip);
            let (to_left, to_right) = (cost(&nodes[left as usize]), cost(&nodes[right as usize]));
            let ((near, to_near), (far, to_far)) = if to_right < to_left {
                ((right, to_right), (left, to_left))
            } else {
                ((left, to_left), (right, to_right))
            };
            if to_far < best.0 {
                pending.push(far, to_far);
            }
            (to_near < best.0).then_some(near)
        };
        at = at.or_else(|| pending.pop_below(best.0));
    }
    best.1
}

/// Subtrees that are yet to be walked, with their costs: on the stack, or beyond that on the heap.
struct Pending {
    first: [(u32, f64); Pending::FIRST],
    count: usize,
    more: Vec<(u32, f64)>,
}

impl Pending {
    const FIRST: usize = 24;

    fn new() -> Pending {
        Pending { first: [(0, 0.0); Pending::FIRST], count: 0, more: Vec::new() }
    }

    fn push(&mut self, node: u32, cost: f64) {
        match self.first.get_mut(self.count) {
            Some(place) => {
                *place = (node, cost);
                self.count += 1;
            }
            None => self.more.push((node, cost)),
        }
    }

    /// The last one pushed whose cost is below a bound; the others after it are forgotten.
    fn pop_below(&mut self, bound: f64) -> Option<u32> {
        while let Some((node, cost)) = self.more.pop() {
            if cost < bound {
                return Some(node);
            }
        }
        while self.count > 0 {
            self.count -= 1;
            let (node, cost) = self.first[self.count];
            if cost < bound {
                return Some(node);
            }
        }
        None
    }
}

/// The tree's nodes in depth-first order, the root first.
fn flatten(tree: &Bvh) -> Vec<Node> {
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
            let nodes = build(&mesh);
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

    /// Triangles that halve in distance from one another make a tree as deep as they are many.
    #[test]
    fn the_best_is_found_in_a_deep_tree() {
        let mut mesh = TriMesh::default();
        for i in 0..300u32 {
            let x = 0.5f64.powi(i as i32);
            mesh.points.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, x, 0.0), Vec3::new(x, 0.0, x)]);
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        let nodes = build(&mesh);
        for i in [0, 7, 60, 299] {
            let p = Vec3::new(-1.0, 0.0, 0.0) * 0.5f64.powi(i);
            // The farthest of all within 1.5 of the origin, so that every subtree is entered.
            let cost = |t: u32| -(mesh.points[3 * t as usize] - p).norm();
            let (t, _, ()) = find_best(&nodes, 0.0, |_| f64::MIN, |t| Some((cost(t), ()))).unwrap();
            assert_eq!(t, 0);
            let near = |t: u32| Some(((mesh.points[3 * t as usize] - p).norm_squared(), ()));
            let (t, _, ()) = find_best(&nodes, f64::MAX, |n| n.distance_squared(&p), near).unwrap();
            assert_eq!(t, 299);
        }
    }

    #[test]
    fn a_ray_in_the_plane_of_a_side_meets_the_box() {
        let node = Node { lo: [0.0; 3], hi: [1.0; 3], skip: 1, triangle: 0 };
        let along = |origin: [f64; 3], way: [f64; 3]| {
            node.along_ray(&origin.into(), &Vec3::from(way).map(|x| 1.0 / x))
        };
        assert_eq!(along([0.0, 0.5, -2.0], [0.0, 0.0, 1.0]), 2.0);
        assert_eq!(along([1.0, 1.0, -2.0], [-0.0, 0.0, 1.0]), 2.0);
        assert_eq!(along([0.5, 0.5, 0.5], [0.0, -1.0, 0.0]), 0.0);
        assert_eq!(along([1.1, 0.5, -2.0], [0.0, 0.0, 1.0]), f64::INFINITY);
        assert_eq!(along([0.5, 0.5, 2.0], [0.0, 0.0, 1.0]), f64::INFINITY);
    }

    #[test]
    fn no_triangle_and_one_triangle() {
        assert!(build(&TriMesh::default()).is_empty());
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let nodes = build(&TriMesh { points, triangles: vec![[0, 1, 2]] });
        assert_eq!(nodes.len(), 1);
        assert_eq!((nodes[0].triangle, nodes[0].skip), (0, 1));
    }
}
