//! Sewn chains: the runs of panel border that are sewn to one another.
//!
//! A chain is the longest run of border edges sewn between the same two panels, or within
//! one panel (a dart, a sleeve sewn to itself). It is found from seam groups and border
//! edges alone, so that garments whose seams are nothing but shared 3D points have chains
//! too. Method: two border edges are a *stitch* if their ends lie in the same seam groups;
//! a stitch joins two vertex pairs (one vertex from each side), and a chain is a maximal
//! path of stitches over vertex pairs. A side may have vertices of its own: an edge on one
//! side may face a short path of loose vertices on the other, and an edge whose two ends are
//! sewn to one vertex faces that vertex alone. Seams with an offset have no chain.

use std::collections::{BTreeMap, HashSet};

use super::{Garment, Vec2};

/// Longest path of loose vertices that may face one edge of the other side [edges].
const LONGEST_DETOUR: usize = 4;

/// Two runs of border vertices sewn to each other, in the same order.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Vertices of the first side.
    pub a: Vec<u32>,
    /// Vertices of the second side; the number may differ.
    pub b: Vec<u32>,
    /// Panel of the first side.
    pub panel_a: u32,
    /// Panel of the second side, possibly the same.
    pub panel_b: u32,
}

impl Chain {
    /// Lengths of the two sides in `pattern` [m].
    pub fn lengths(&self, pattern: &[Vec2]) -> [f64; 2] {
        [&self.a, &self.b].map(|side| {
            side.windows(2).map(|e| (pattern[e[1] as usize] - pattern[e[0] as usize]).norm()).sum()
        })
    }

    /// Difference of the two lengths over their mean, positive if the first side is longer.
    pub fn relative_difference(&self, pattern: &[Vec2]) -> f64 {
        let [a, b] = self.lengths(pattern);
        let mean = 0.5 * (a + b);
        if mean > 0.0 { (a - b) / mean } else { 0.0 }
    }
}

/// Largest change, over the garment's sewn chains, of the relative difference in length
/// between the two sides from the original pattern to `pattern`: ease and gathers stay.
pub fn seam_mismatch(garment: &Garment, pattern: &[Vec2]) -> f64 {
    chains_mismatch(&garment.chains(), &garment.pattern, pattern)
}

/// [`seam_mismatch`] of chains that are at hand.
pub fn chains_mismatch(chains: &[Chain], original: &[Vec2], pattern: &[Vec2]) -> f64 {
    chains
        .iter()
        .map(|c| (c.relative_difference(pattern) - c.relative_difference(original)).abs())
        .fold(0.0, f64::max)
}

/// A run of border vertices of one panel that acts as one edge of a stitch.
type Side = Vec<u32>;

/// Two facing sides, in the same order from group to group.
struct Stitch {
    sides: [Side; 2],
}

impl Stitch {
    /// The vertex pair at the start or the end.
    fn pair(&self, end: bool) -> [u32; 2] {
        let pick = |side: &Side| if end { side[side.len() - 1] } else { side[0] };
        [pick(&self.sides[0]), pick(&self.sides[1])]
    }
}

impl Garment {
    /// Border edges: those with one incident triangle, along that triangle's orientation.
    pub fn border_edges(&self) -> Vec<[u32; 2]> {
        let mut count: BTreeMap<[u32; 2], (u32, [u32; 2])> = BTreeMap::new();
        for tri in &self.triangles {
            for k in 0..3 {
                let edge = [tri[k], tri[(k + 1) % 3]];
                let key = [edge[0].min(edge[1]), edge[0].max(edge[1])];
                count.entry(key).or_insert((0, edge)).0 += 1;
            }
        }
        count.into_values().filter(|(n, _)| *n == 1).map(|(_, edge)| edge).collect()
    }

    /// The sewn chains, in a fixed order.
    pub fn chains(&self) -> Vec<Chain> {
        let edges: Vec<[u32; 2]> = self
            .border_edges()
            .into_iter()
            .filter(|e| !e.iter().any(|&v| self.groups.has_offset[v as usize]))
            .collect();
        let mut stitches = self.facing_edges(&edges);
        self.collapsed_edges(&edges, &mut stitches);
        self.join(&stitches)
    }

    fn node(&self, v: u32) -> u32 {
        self.groups.node_of_vertex[v as usize]
    }

    /// Stitches between edges (or one edge and a detour) over the same two groups.
    fn facing_edges(&self, edges: &[[u32; 2]]) -> Vec<Stitch> {
        let mut sides_of_groups: BTreeMap<[u32; 2], Vec<Side>> = BTreeMap::new();
        let mut file = |side: Side| {
            let (p, q) = (self.node(side[0]), self.node(side[side.len() - 1]));
            if p != q {
                let forward: Side = if p < q { side } else { side.into_iter().rev().collect() };
                sides_of_groups.entry([p.min(q), p.max(q)]).or_default().push(forward);
            }
        };
        for &[u, v] in edges {
            file(vec![u, v]);
        }
        for detour in self.detours(edges) {
            file(detour);
        }
        let mut stitches = Vec::new();
        for sides in sides_of_groups.values() {
            for (k, first) in sides.iter().enumerate() {
                for second in &sides[k + 1..] {
                    if first.len().min(second.len()) == 2 {
                        stitches.push(Stitch { sides: [first.clone(), second.clone()] });
                    }
                }
            }
        }
        stitches
    }

    /// Short border paths between sewn vertices whose inner vertices are sewn to nothing.
    fn detours(&self, edges: &[[u32; 2]]) -> Vec<Side> {
        let mut members = vec![0u32; self.groups.node_count];
        for &node in &self.groups.node_of_vertex {
            members[node as usize] += 1;
        }
        let sewn = |v: u32| members[self.node(v) as usize] > 1;
        let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &[u, v] in edges {
            next.entry(u).or_default().push(v);
        }
        let mut found = Vec::new();
        for &[u, v] in edges {
            let mut path = vec![u, v];
            while !sewn(path[path.len() - 1]) && path.len() <= LONGEST_DETOUR {
                match next.get(&path[path.len() - 1]).map(Vec::as_slice) {
                    Some(&[only]) if !path.contains(&only) => path.push(only),
                    _ => break,
                }
            }
            if path.len() > 2 && sewn(u) && sewn(path[path.len() - 1]) {
                found.push(path);
            }
        }
        found
    }

    /// Stitches of edges whose ends are sewn to one and the same vertex.
    fn collapsed_edges(&self, edges: &[[u32; 2]], stitches: &mut Vec<Stitch>) {
        let collapsed: Vec<[u32; 2]> =
            edges.iter().copied().filter(|&[u, v]| self.node(u) == self.node(v)).collect();
        if collapsed.is_empty() {
            return;
        }
        let mut border_of_group: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let border: std::collections::BTreeSet<u32> = edges.iter().flatten().copied().collect();
        for v in border {
            border_of_group.entry(self.node(v)).or_default().push(v);
        }
        for [u, v] in collapsed {
            for &w in border_of_group[&self.node(u)].iter().filter(|&&w| w != u && w != v) {
                stitches.push(Stitch { sides: [vec![u, v], vec![w]] });
            }
        }
    }

    /// Walks stitches over vertex pairs into maximal chains.
    fn join(&self, stitches: &[Stitch]) -> Vec<Chain> {
        let key = |p: [u32; 2]| [p[0].min(p[1]), p[0].max(p[1])];
        let mut at_pair: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for (s, stitch) in stitches.iter().enumerate() {
            for end in [false, true] {
                at_pair.entry(key(stitch.pair(end))).or_default().push(s);
            }
        }
        let mut used = HashSet::new();
        let mut chains = Vec::new();
        // Open chains start at pairs with one stitch or a fork; what is left afterwards is closed.
        let starts = at_pair.iter().filter(|(_, list)| list.len() != 2).map(|(&pair, _)| pair);
        for start in starts.chain(at_pair.keys().copied()) {
            for &first in &at_pair[&start] {
                if !used.contains(&first) {
                    chains.push(self.walk(stitches, &at_pair, &mut used, start, first));
                }
            }
        }
        chains
    }

    fn walk(
        &self,
        stitches: &[Stitch],
        at_pair: &BTreeMap<[u32; 2], Vec<usize>>,
        used: &mut HashSet<usize>,
        start: [u32; 2],
        first: usize,
    ) -> Chain {
        let key = |p: [u32; 2]| [p[0].min(p[1]), p[0].max(p[1])];
        let stitch = &stitches[first];
        // The two sides keep their order from the first stitch on.
        let mut at = if key(stitch.pair(false)) == start { stitch.pair(false) } else { stitch.pair(true) };
        let (mut a, mut b) = (vec![at[0]], vec![at[1]]);
        let mut current = Some(first);
        while let Some(s) = current {
            used.insert(s);
            let mut sides = stitches[s].sides.clone();
            if key(stitches[s].pair(false)) != key(at) {
                sides.iter_mut().for_each(|side| side.reverse());
            }
            if sides[0][0] != at[0] {
                sides.swap(0, 1);
            }
            a.extend(&sides[0][1..]);
            b.extend(&sides[1][1..]);
            at = [a[a.len() - 1], b[b.len() - 1]];
            let here = &at_pair[&key(at)];
            current = match here.len() {
                2 => here.iter().copied().find(|next| !used.contains(next)),
                _ => None,
            };
        }
        let panel = |v: u32| self.panel_of_vertex[v as usize];
        Chain { panel_a: panel(a[0]), panel_b: panel(b[0]), a, b }
    }
}
