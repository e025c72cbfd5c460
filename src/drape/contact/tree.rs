//! A tree of bounding boxes in a flat array with skip links, for the broad phase.

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

fn overlap(a: &Bounds, b: &Bounds) -> bool {
    (0..3).all(|k| a.0[k] <= b.1[k] && b.0[k] <= a.1[k])
}

#[derive(Clone, Debug)]
struct Node {
    bounds: Bounds,
    /// Where to go on when the box is missed.
    skip: u32,
    /// First item and number of items (0 in an inner node).
    items: (u32, u32),
}

/// The tree: nodes in depth-first order.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    items: Vec<(u32, Bounds)>,
}

impl BoxTree {
    /// A tree over `boxes`; items are their indices.
    pub fn new(boxes: impl Iterator<Item = Bounds>) -> BoxTree {
        let mut items: Vec<(u32, Bounds)> = boxes.enumerate().map(|(i, b)| (i as u32, b)).collect();
        let mut nodes = Vec::with_capacity(items.len());
        if !items.is_empty() {
            let count = items.len();
            build(&mut items, 0, count, &mut nodes);
        }
        BoxTree { nodes, items }
    }

    /// Calls `f` with every item whose box meets `query`.
    pub fn query(&self, query: &Bounds, f: &mut dyn FnMut(u32)) {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !overlap(&node.bounds, query) {
                at = node.skip as usize;
                continue;
            }
            let (first, count) = (node.items.0 as usize, node.items.1 as usize);
            for (item, bounds) in &self.items[first..first + count] {
                if overlap(bounds, query) {
                    f(*item);
                }
            }
            at += 1;
        }
    }
}

fn build(items: &mut [(u32, Bounds)], first: usize, count: usize, nodes: &mut Vec<Node>) {
    let slice = &mut items[first..first + count];
    let all = slice[1..].iter().fold(slice[0].1, |a, (_, b)| (a.0.inf(&b.0), a.1.sup(&b.1)));
    let at = nodes.len();
    let leaf = count <= LEAF;
    nodes.push(Node { bounds: all, skip: 0, items: (first as u32, if leaf { count as u32 } else { 0 }) });
    if !leaf {
        let axis = (all.1 - all.0).imax();
        let half = count / 2;
        let key = |i: &(u32, Bounds)| i.1.0[axis] + i.1.1[axis];
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
        let tree = BoxTree::new(boxes.iter().copied());
        for q in &boxes {
            let mut found = Vec::new();
            tree.query(q, &mut |i| found.push(i));
            found.sort_unstable();
            let expected: Vec<u32> = (0..300).filter(|&i| overlap(&boxes[i as usize], q)).collect();
            assert_eq!(found, expected);
        }
    }
}
