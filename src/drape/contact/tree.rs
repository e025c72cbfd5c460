//! A tree of bounding boxes in a flat array with skip links, for the broad phase.
//!
//! What moves keeps its tree: boxes are fitted anew, the hierarchy stays.

use crate::model::Vec3;

/// Boxes in a leaf.
const LEAF: usize = 4;

/// Lower and upper corner.
pub type Bounds = (Vec3, Vec3);

/// The box of some points, grown by `margin` on every side.
pub fn bounds(points: &[Vec3], margin: f64) -> Bounds {
    let m = Vec3::repeat(margin);
    let (lo, hi) = points[1..].iter().fold((points[0], points[0]), |(l, h), p| (l.inf(p), h.sup(p)));
    (lo - m, hi + m)
}

/// A box in `f32`, rounded outwards: half the memory to walk through, and never less than the box.
/// Of four lanes, the last zero, so that two boxes are compared by vectors.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
struct Small {
    lo: [f32; 4],
    hi: [f32; 4],
}

impl From<&Bounds> for Small {
    fn from((lo, hi): &Bounds) -> Small {
        let lanes = |v: &Vec3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
        // A step in the last place and more, without asking which way a number was rounded.
        let step = |v: f32| v.abs() * f32::EPSILON + f32::MIN_POSITIVE;
        Small { lo: lanes(lo).map(|v| v - step(v)), hi: lanes(hi).map(|v| v + step(v)) }
    }
}

impl Small {
    /// Without a branch for each axis, which would be mispredicted half of the time.
    fn meets(&self, other: &Small) -> bool {
        let mut apart = [false; 4];
        for k in 0..4 {
            apart[k] = (self.lo[k] > other.hi[k]) | (other.lo[k] > self.hi[k]);
        }
        apart == [false; 4]
    }

    fn with(&self, other: &Small) -> Small {
        let least = |a: f32, b: f32| if a < b { a } else { b };
        let most = |a: f32, b: f32| if a > b { a } else { b };
        Small {
            lo: std::array::from_fn(|k| least(self.lo[k], other.lo[k])),
            hi: std::array::from_fn(|k| most(self.hi[k], other.hi[k])),
        }
    }
}

/// An item and its box.
type Item = (u32, Small);

#[derive(Clone, Debug)]
struct Node {
    bounds: Small,
    /// Where to go on when the box is missed.
    skip: u32,
    /// First item and number of items (0 in an inner node).
    items: (u32, u32),
}

/// The tree: nodes in depth-first order.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    items: Vec<Item>,
}

impl BoxTree {
    /// A tree over `boxes`; items are their indices.
    pub fn new(boxes: impl Iterator<Item = Bounds>) -> BoxTree {
        let mut items: Vec<Item> = boxes.enumerate().map(|(i, b)| (i as u32, (&b).into())).collect();
        let mut nodes = Vec::with_capacity(items.len());
        if !items.is_empty() {
            let count = items.len();
            build(&mut items, 0, count, &mut nodes);
        }
        BoxTree { nodes, items }
    }

    /// The same hierarchy over other boxes of its items.
    pub fn fitted(&self, of: impl Fn(u32) -> Bounds) -> BoxTree {
        let mut tree = self.clone();
        tree.items.iter_mut().for_each(|(item, small)| *small = (&of(*item)).into());
        // Children follow their parents: the first at once, the second where the first is skipped to.
        for at in (0..tree.nodes.len()).rev() {
            let (first, count) = tree.nodes[at].items;
            tree.nodes[at].bounds = if count > 0 {
                around(&tree.items[first as usize..(first + count) as usize])
            } else {
                let second = tree.nodes[at + 1].skip as usize;
                tree.nodes[at + 1].bounds.with(&tree.nodes[second].bounds)
            };
        }
        tree
    }

    /// All items, neighbours in the tree next to each other.
    pub fn order(&self) -> Vec<u32> {
        self.items.iter().map(|(item, _)| *item).collect()
    }

    /// Calls `f` with every item whose box meets `query`.
    pub fn query(&self, query: &Bounds, f: &mut dyn FnMut(u32)) {
        let query = query.into();
        self.walk(&query, &mut |items| {
            items.iter().filter(|(_, bounds)| bounds.meets(&query)).for_each(|(item, _)| f(*item));
        });
    }

    /// Calls `f` with every query and item whose boxes meet. Queries that lie near each other
    /// share one walk through the tree.
    pub fn query_all(&self, queries: &[(u32, Bounds)], f: &mut dyn FnMut(u32, u32)) {
        let small: Vec<Item> = queries.iter().map(|(q, b)| (*q, b.into())).collect();
        let Some(all) = small.iter().map(|(_, b)| *b).reduce(|a, b| a.with(&b)) else { return };
        self.walk(&all, &mut |items| {
            for (item, bounds) in items.iter().filter(|(_, bounds)| bounds.meets(&all)) {
                small.iter().filter(|(_, b)| b.meets(bounds)).for_each(|(q, _)| f(*q, *item));
            }
        });
    }

    /// Calls `f` with the items of every leaf that meets `query`.
    fn walk(&self, query: &Small, f: &mut dyn FnMut(&[Item])) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.meets(query) {
                at = node.skip as usize;
                continue;
            }
            let (first, count) = (node.items.0 as usize, node.items.1 as usize);
            if count > 0 {
                f(&self.items[first..first + count]);
            }
            at += 1;
        }
    }
}

/// The box of some items, at least one.
fn around(items: &[Item]) -> Small {
    items[1..].iter().fold(items[0].1, |a, (_, b)| a.with(b))
}

fn build(items: &mut [Item], first: usize, count: usize, nodes: &mut Vec<Node>) {
    let slice = &mut items[first..first + count];
    let all = around(slice);
    let at = nodes.len();
    let leaf = count <= LEAF;
    nodes.push(Node { bounds: all, skip: 0, items: (first as u32, if leaf { count as u32 } else { 0 }) });
    if !leaf {
        let size = |k: usize| all.hi[k] - all.lo[k];
        let axis = (1..3).fold(0, |best, k| if size(k) > size(best) { k } else { best });
        let half = count / 2;
        let key = |i: &Item| i.1.lo[axis] + i.1.hi[axis];
        // Ties by index, so that the tree is the same in every run.
        slice.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.0.cmp(&b.0)));
        build(items, first, half, nodes);
        build(items, first + half, count - half, nodes);
    }
    nodes[at].skip = nodes.len() as u32;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_a_full_search_finds() {
        let boxes: Vec<Bounds> = (0..300)
            .map(|i| {
                let c = Vec3::new((i * 37 % 101) as f64, (i * 53 % 97) as f64, (i * 71 % 89) as f64);
                bounds(&[c], (i % 7) as f64)
            })
            .collect();
        // The second tree was made for others, far from where its items are now.
        let elsewhere = BoxTree::new(boxes.iter().rev().copied());
        for tree in [BoxTree::new(boxes.iter().copied()), elsewhere.fitted(|i| boxes[i as usize])] {
            for q in &boxes {
                let mut found = Vec::new();
                tree.query(q, &mut |i| found.push(i));
                found.sort_unstable();
                let overlap = |a: &Bounds| (0..3).all(|k| a.0[k] <= q.1[k] && q.0[k] <= a.1[k]);
                let expected: Vec<u32> = (0..300).filter(|&i| overlap(&boxes[i as usize])).collect();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn shared_walks_find_what_each_query_finds() {
        let at = |i: u32| Vec3::new(f64::from(i * 37 % 101), f64::from(i * 53 % 97), f64::from(i * 71 % 89));
        let boxes: Vec<Bounds> = (0..300).map(|i| bounds(&[at(i)], 4.0)).collect();
        let tree = BoxTree::new(boxes.iter().copied());
        let mut order = tree.order();
        let queries: Vec<(u32, Bounds)> = order.iter().map(|&i| (i, boxes[i as usize])).collect();
        let (mut together, mut apart) = (Vec::new(), Vec::new());
        for group in queries.chunks(8) {
            tree.query_all(group, &mut |q, i| together.push((q, i)));
            group.iter().for_each(|(q, b)| tree.query(b, &mut |i| apart.push((*q, i))));
        }
        together.sort_unstable();
        apart.sort_unstable();
        assert_eq!(together, apart);
        order.sort_unstable();
        assert_eq!(order, (0..300).collect::<Vec<u32>>());
    }

    #[test]
    fn boxes_only_grow_by_rounding() {
        for v in [0.1, -0.1, 1.0 + 1e-12, -1e-40, 12_345.678_912] {
            let small = Small::from(&(Vec3::repeat(v), Vec3::repeat(v)));
            assert!(f64::from(small.lo[0]) <= v && v <= f64::from(small.hi[0]), "{v}");
        }
    }
}
