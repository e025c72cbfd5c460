//! Broad phase: the pairs of primitives that can come into contact before the next search.

use std::collections::HashSet;

use rayon::prelude::*;

use super::crossing::Tangles;
use super::fixed::Hidden;
use super::pairs::{Mode, Pair, Radii, Role, Scene, orientation};
use super::tree::{Bounds, BoxTree, bounds};
use crate::model::Vec3;

/// Share of the distance on the source at which a pair of one garment starts to resist.
const SOURCE_SHARE: f64 = 0.9;
/// Pairs of one garment closer than this on the source remember their sides [m].
const SIDE_REACH: f64 = 0.015;
/// While anything is tangled, pairs closer than this do not resist: one that all but touches
/// would hold up the whole garment, and if it crosses it is tangled itself [m].
const TOUCHING: f64 = 1e-5;
/// Primitives that share a walk through a tree.
pub(super) const GROUP: usize = 8;
/// Such groups that a CPU task takes at least: waking a thread costs tens of microseconds.
pub(super) const GROUPS: usize = 32;

/// The contact points whose pairs are searched; `None` for all.
#[derive(Clone, Copy, Debug)]
pub struct Among<'a>(pub Option<&'a [bool]>);

impl Among<'_> {
    /// Whether one of these contact points is among them.
    pub fn any(&self, points: &[u32]) -> bool {
        self.0.is_none_or(|among| points.iter().any(|&p| among[p as usize]))
    }

    /// The box within `reach` of a primitive's `points` at `x`, if one of them is among them.
    fn around<const N: usize>(&self, points: [u32; N], x: &[Vec3], reach: f64) -> Option<Bounds> {
        self.any(&points).then(|| bounds(&points.map(|i| x[i as usize]), reach))
    }
}

impl Scene<'_> {
    /// All pairs with a contact point `among` those given that are no farther apart than `beyond`
    /// their radius, in a fixed order.
    pub fn pairs(
        &self,
        x: &[Vec3],
        radii: &Radii,
        beyond: Beyond,
        tangles: &Tangles,
        among: Among<'_>,
    ) -> Vec<Pair> {
        let mut pairs = Vec::new();
        let least = if tangles.is_clean() { 0.0 } else { TOUCHING };
        for (c, radius) in radii.collider.iter().enumerate() {
            pairs.extend(self.on_collider(c, x, (*radius, radius + beyond.collider), tangles, among));
        }
        pairs.extend(self.own(x, (radii.own, radii.own + beyond.own), tangles, among));
        pairs.retain(|pair| pair.found_at >= least || !matches!(pair.mode, Mode::Clean));
        pairs
    }

    /// The pair, with its distance, if that is below `reach`.
    fn within(&self, pair: Pair, x: &[Vec3], reach: f64) -> Option<Pair> {
        let found_at = pair.role.shape().gap(&self.corners(&pair, x)).norm();
        (found_at < reach).then_some(Pair { found_at, ..pair })
    }

    fn on_collider(
        &self,
        c: usize,
        x: &[Vec3],
        (radius, reach): (f64, f64),
        tangles: &Tangles,
        among: Among<'_>,
    ) -> Vec<Pair> {
        let (sheet, collider) = (&self.sheet, &self.colliders[c]);
        let (inside, crossed) = (&tangles.inside[c], &tangles.edges[c]);
        let wrong = Mode::Wrong { sign: 1.0 };
        // Skin inside of the body would hold up what has to leave it.
        let hidden = (collider.solid && inside.contains(&true)).then(|| collider.hidden());
        let shown = |list: fn(&Hidden) -> &[bool], i: u32| hidden.is_none_or(|h| !list(h)[i as usize]);
        let near = |role, a, b, mode| {
            self.within(Pair { role, collider: c as u16, a, b, radius, found_at: 0.0, mode }, x, reach)
        };
        // A point inside has one spring of its own, see `narrow`.
        let around = |v: u32| if inside[v as usize] { None } else { among.around([v], x, reach) };
        let points = gather(&sheet.near.points.order, around, &collider.triangle_tree, |v, t| {
            if !shown(|h| &h.triangles, t) {
                return None;
            }
            near(Role::OnCollider, v, t, Mode::Clean)
        });
        let corners = |t: u32| sheet.triangles[t as usize];
        let around = |t: u32| among.around(corners(t), x, reach);
        let faces = gather(&sheet.near.triangles.order, around, &collider.point_tree, |t, p| {
            if !collider.used[p as usize] || !shown(|h| &h.points, p) {
                return None;
            }
            let tangled = tangles.triangles[c][t as usize] || corners(t).iter().any(|&p| inside[p as usize]);
            near(Role::UnderCloth, p, t, if tangled { wrong } else { Mode::Clean })
        });
        let ends = |e: u32| sheet.edges.ends[e as usize];
        let around = |e: u32| among.around(ends(e), x, reach);
        let edges = gather(&sheet.near.edges.order, around, &collider.edge_tree, |e, f| {
            if !shown(|h| &h.edges, f) {
                return None;
            }
            let tangled = crossed[e as usize] || ends(e).iter().any(|&p| inside[p as usize]);
            near(Role::EdgeCollider, e, f, if tangled { wrong } else { Mode::Clean })
        });
        [points, faces, edges].concat()
    }

    fn own(&self, x: &[Vec3], (radius, reach): (f64, f64), tangles: &Tangles, among: Among<'_>) -> Vec<Pair> {
        let (sheet, near) = (&self.sheet, &self.sheet.near);
        let tangled = self.tangled(&tangles.own);
        let at = |i: u32| x[i as usize];
        let faces_tree = near.triangles.tree.fitted(|t| bounds(&sheet.triangles[t as usize].map(at), 0.0));
        let edges_tree = near.edges.tree.fitted(|e| bounds(&sheet.edges.ends[e as usize].map(at), 0.0));
        let make = |role: Role, a: u32, b: u32| {
            let pair = Pair { role, collider: 0, a, b, radius, found_at: 0.0, mode: Mode::Clean };
            let mut pair = self.within(pair, x, reach)?;
            let source = self.corners(&pair, &sheet.source);
            let gap = role.shape().gap(&source);
            pair.radius = radius.min(SOURCE_SHARE * gap.norm());
            if pair.found_at > pair.radius + (reach - radius) {
                return None;
            }
            let beside = gap.norm() < SIDE_REACH;
            if tangled.contains(&(role, a, b)) {
                let sign = if beside { orientation(role, &source, &gap).signum() } else { 0.0 };
                pair.mode = Mode::Wrong { sign };
            } else if !beside && self.must_pass(role, a, b, tangles) {
                return None;
            }
            Some(pair)
        };
        let apart = |a: &[u32], b: &[u32]| !sheet.share_node(a, b);
        let corners = |t: u32| &sheet.triangles[t as usize];
        let around = |v: u32| among.around([v], x, reach);
        let mut pairs = gather(&sheet.near.points.order, around, &faces_tree, |v, t| {
            apart(&[v], corners(t)).then(|| make(Role::OwnFace, v, t)).flatten()
        });
        if among.0.is_some() {
            // Their triangles with all other points.
            let points_tree = near.points.tree.fitted(|p| (at(p), at(p)));
            let around = |t: u32| among.around(*corners(t), x, reach);
            pairs.extend(gather(&sheet.near.triangles.order, around, &points_tree, |t, v| {
                let other = !among.any(&[v]) && apart(&[v], corners(t));
                other.then(|| make(Role::OwnFace, v, t)).flatten()
            }));
        }
        let ends = |e: u32| &sheet.edges.ends[e as usize];
        let around = |e: u32| among.around(*ends(e), x, reach);
        pairs.extend(gather(&sheet.near.edges.order, around, &edges_tree, |e, f| {
            let first = f > e || !among.any(ends(f));
            (first && apart(ends(e), ends(f))).then(|| make(Role::OwnEdges, e.min(f), e.max(f))).flatten()
        }));
        pairs
    }

    /// Whether one of the primitives lies in a region that has to go through the other.
    fn must_pass(&self, role: Role, a: u32, b: u32, tangles: &Tangles) -> bool {
        let sheet = &self.sheet;
        match role {
            Role::OwnFace => tangles.regions.must_pass(&[a], &sheet.triangles[b as usize]),
            _ => {
                let ends = |e: u32| sheet.edges.ends[e as usize];
                tangles.regions.must_pass(&ends(a), &ends(b))
            }
        }
    }

    /// Pairs that take part in a crossing of an edge and a triangle.
    fn tangled(&self, own: &[[u32; 2]]) -> HashSet<(Role, u32, u32)> {
        let edges = &self.sheet.edges;
        let mut set = HashSet::new();
        for &[e, t] in own {
            for f in edges.of_triangle[t as usize] {
                set.insert((Role::OwnEdges, e.min(f), e.max(f)));
            }
            for p in edges.ends[e as usize] {
                set.insert((Role::OwnFace, p, t));
            }
            for &s in &edges.triangles[e as usize] {
                for p in self.sheet.triangles[t as usize] {
                    set.insert((Role::OwnFace, p, s));
                }
                for f in edges.of_triangle[s as usize] {
                    for g in edges.of_triangle[t as usize] {
                        set.insert((Role::OwnEdges, f.min(g), f.max(g)));
                    }
                }
            }
        }
        set
    }
}

/// How much farther apart than their radius pairs are looked for [m].
#[derive(Clone, Copy, Debug)]
pub struct Beyond {
    /// Pairs with a collider.
    pub collider: f64,
    /// Pairs of the garment's own.
    pub own: f64,
}

/// The pairs that `make` makes of primitives in `order` and the items of `tree` that are near
/// them; always in the same order. Neighbours in `order` share a walk through the tree.
fn gather(
    order: &[u32],
    around: impl Fn(u32) -> Option<Bounds> + Sync,
    tree: &BoxTree,
    make: impl Fn(u32, u32) -> Option<Pair> + Sync,
) -> Vec<Pair> {
    let of_group = |group: &[u32]| {
        let queries: Vec<(u32, Bounds)> = group.iter().filter_map(|&i| Some((i, around(i)?))).collect();
        let mut list = Vec::new();
        tree.query_all(&queries, &mut |i, item| list.extend(make(i, item)));
        list.sort_unstable_by_key(|p: &Pair| (p.a, p.b));
        list
    };
    let lists: Vec<Vec<Pair>> = order.par_chunks(GROUP).with_min_len(GROUPS).map(of_group).collect();
    lists.concat()
}

#[cfg(test)]
mod tests {
    use crate::drape::contact::Contact;
    use crate::drape::contact::fixed::Fixed;
    use crate::drape::contact::sheet::Sheet;
    use crate::drape::tests::{patches, sphere};

    use super::*;

    #[test]
    fn what_is_near_is_found_whatever_moves_and_however_far() {
        let ball = sphere(0.1, 12);
        let at = |height: f64| move |x: f64, y: f64| Vec3::new(x - 0.1, height, y - 0.1);
        let garment = patches(9, 0.2, &[&at(0.1035), &at(0.108)]);
        let sheet = Sheet::new(&garment);
        let mut x = sheet.points(&garment.points);
        let radii = Radii { collider: vec![2e-3], own: 2e-3 };
        let scene = Scene { sheet, colliders: vec![Fixed::new(&ball, true)] };
        let mut contact = Contact::new(scene, radii.clone(), 1.0, &x);
        let mut found = 0;
        for round in 0..40u32 {
            // A wave over a part of the cloth, of a different length each time.
            let size = 4e-4 * f64::from(1 + round % 7);
            for (i, p) in x.iter_mut().enumerate() {
                let phase = f64::from(i as u32 * 7 + round * 13);
                if phase.sin() > 0.3 {
                    p.y += size * (1.7 * phase).cos();
                    p.x += 0.5 * size * (2.3 * phase).sin();
                }
            }
            contact.refresh(&x, size);
            contact.keep_up(&x);
            let near = Beyond { collider: 0.0, own: 0.0 };
            let key = |p: &Pair| (p.role, p.a, p.b);
            let known: HashSet<_> = contact.pairs.iter().map(key).collect();
            assert_eq!(known.len(), contact.pairs.len(), "a pair twice");
            for pair in contact.scene.pairs(&x, &radii, near, &contact.tangles, Among(None)) {
                assert!(known.contains(&key(&pair)), "round {round}: {pair:?}");
                found += 1;
            }
        }
        assert!(found > 100, "{found}");
    }
}
