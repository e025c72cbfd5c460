//! Broad phase: the pairs of primitives that can come into contact before the next search.

use std::collections::HashSet;

use rayon::prelude::*;

use super::ccd::Shape;
use super::crossing::Tangles;
use super::fixed::{Fixed, Hidden};
use super::sheet::Sheet;
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
/// Marks a corner that belongs to a collider.
pub const FIXED: u32 = u32::MAX;

/// Who the two primitives are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Contact point `a`, collider triangle `b`.
    OnCollider,
    /// Collider point `a`, cloth triangle `b`.
    UnderCloth,
    /// Cloth edge `a`, collider edge `b`.
    EdgeCollider,
    /// Contact point `a`, cloth triangle `b`.
    OwnFace,
    /// Cloth edges `a` and `b`.
    OwnEdges,
}

impl Role {
    /// Whether both are of the cloth.
    pub fn is_own(self) -> bool {
        matches!(self, Role::OwnFace | Role::OwnEdges)
    }

    /// Its closest-point problem.
    pub fn shape(self) -> Shape {
        match self {
            Role::EdgeCollider | Role::OwnEdges => Shape::SegmentSegment,
            _ => Shape::PointTriangle,
        }
    }
}

/// How a pair is treated during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// On its right side: barrier, never crossed.
    Clean,
    /// Starts tangled: spring along the signed distance, may pass. Pairs of one garment have
    /// the sign that the gap has on the source; colliders know theirs.
    Wrong {
        /// The sign that the gap is to have.
        sign: f64,
    },
}

/// A pair of primitives.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Who they are.
    pub role: Role,
    /// Collider, where there is one.
    pub collider: u16,
    /// See [`Role`].
    pub a: u32,
    /// See [`Role`].
    pub b: u32,
    /// Distance at which it resists [m].
    pub radius: f64,
    /// Distance where it was found [m].
    pub found_at: f64,
    /// Treatment.
    pub mode: Mode,
}

/// Everything that poses closest-point problems.
pub struct Scene<'a> {
    /// The cloth.
    pub sheet: Sheet,
    /// What does not move.
    pub colliders: Vec<Fixed<'a>>,
}

impl Scene<'_> {
    /// The four points of a pair, and which contact points they are ([`FIXED`] if none).
    pub fn corners(&self, pair: &Pair, x: &[Vec3]) -> ([Vec3; 4], [u32; 4]) {
        let (sheet, a, b) = (&self.sheet, pair.a as usize, pair.b as usize);
        let own = |ids: [u32; 4]| (ids.map(|i| x[i as usize]), ids);
        match pair.role {
            Role::OwnFace => {
                let t = sheet.triangles[b];
                own([pair.a, t[0], t[1], t[2]])
            }
            Role::OwnEdges => {
                let (p, q) = (sheet.edges.ends[a], sheet.edges.ends[b]);
                own([p[0], p[1], q[0], q[1]])
            }
            Role::OnCollider => {
                let [p, q, r] = self.colliders[pair.collider as usize].mesh().corners(b);
                ([x[a], p, q, r], [pair.a, FIXED, FIXED, FIXED])
            }
            Role::UnderCloth => {
                let t = sheet.triangles[b];
                let p = self.colliders[pair.collider as usize].mesh().points[a];
                let [t0, t1, t2] = t.map(|i| x[i as usize]);
                ([p, t0, t1, t2], [FIXED, t[0], t[1], t[2]])
            }
            Role::EdgeCollider => {
                let e = sheet.edges.ends[a];
                let collider = &self.colliders[pair.collider as usize];
                let [p, q] = collider.edges.ends[b].map(|i| collider.mesh().points[i as usize]);
                ([x[e[0] as usize], x[e[1] as usize], p, q], [e[0], e[1], FIXED, FIXED])
            }
        }
    }

    /// All pairs that are no farther apart than `beyond` their radius, in a fixed order.
    pub fn pairs(&self, x: &[Vec3], radii: &Radii, beyond: Beyond, tangles: &Tangles) -> Vec<Pair> {
        let mut pairs = Vec::new();
        let least = if tangles.is_clean() { 0.0 } else { TOUCHING };
        for (c, radius) in radii.collider.iter().enumerate() {
            pairs.extend(self.on_collider(c, x, *radius, radius + beyond.collider, tangles));
        }
        pairs.extend(self.own(x, radii.own, radii.own + beyond.own, tangles));
        pairs.retain(|pair| pair.found_at >= least || !matches!(pair.mode, Mode::Clean));
        pairs
    }

    /// The pair, with its distance, if that is below `reach`.
    fn within(&self, pair: Pair, x: &[Vec3], reach: f64) -> Option<Pair> {
        let found_at = pair.role.shape().gap(&self.corners(&pair, x).0).norm();
        (found_at < reach).then_some(Pair { found_at, ..pair })
    }

    fn on_collider(&self, c: usize, x: &[Vec3], radius: f64, reach: f64, tangles: &Tangles) -> Vec<Pair> {
        let (sheet, collider) = (&self.sheet, &self.colliders[c]);
        let (inside, crossed) = (&tangles.inside[c], &tangles.edges[c]);
        let wrong = Mode::Wrong { sign: 1.0 };
        // Skin inside of the body would hold up what has to leave it.
        let hidden = (collider.solid && inside.contains(&true)).then(|| collider.hidden());
        let shown = |list: fn(&Hidden) -> &[bool], i: u32| hidden.is_none_or(|h| !list(h)[i as usize]);
        let near = |role, a, b, mode| {
            self.within(Pair { role, collider: c as u16, a, b, radius, found_at: 0.0, mode }, x, reach)
        };
        let around = |v: u32| bounds(&[x[v as usize]], reach);
        // A point inside has one spring of its own, see `narrow`.
        let outside = |v: u32| (!inside[v as usize]).then(|| around(v));
        let points = gather(&sheet.order.points, outside, &collider.triangle_tree, |v, t| {
            if !shown(|h| &h.triangles, t) {
                return None;
            }
            near(Role::OnCollider, v, t, Mode::Clean)
        });
        let corners = |t: u32| sheet.triangles[t as usize];
        let around = |t: u32| Some(bounds(&corners(t).map(|i| x[i as usize]), reach));
        let faces = gather(&sheet.order.triangles, around, &collider.point_tree, |t, p| {
            if !collider.used[p as usize] || !shown(|h| &h.points, p) {
                return None;
            }
            let tangled = tangles.triangles[c][t as usize] || corners(t).iter().any(|&p| inside[p as usize]);
            near(Role::UnderCloth, p, t, if tangled { wrong } else { Mode::Clean })
        });
        let ends = |e: u32| sheet.edges.ends[e as usize];
        let around = |e: u32| Some(bounds(&ends(e).map(|i| x[i as usize]), reach));
        let edges = gather(&sheet.order.edges, around, &collider.edge_tree, |e, f| {
            if !shown(|h| &h.edges, f) {
                return None;
            }
            let tangled = crossed[e as usize] || ends(e).iter().any(|&p| inside[p as usize]);
            near(Role::EdgeCollider, e, f, if tangled { wrong } else { Mode::Clean })
        });
        [points, faces, edges].concat()
    }

    fn own(&self, x: &[Vec3], radius: f64, reach: f64, tangles: &Tangles) -> Vec<Pair> {
        let sheet = &self.sheet;
        let tangled = self.tangled(&tangles.own);
        let corners = |t: &[u32; 3]| bounds(&t.map(|i| x[i as usize]), 0.0);
        let ends = |e: &[u32; 2]| bounds(&e.map(|i| x[i as usize]), 0.0);
        let faces_tree = BoxTree::new(sheet.triangles.iter().map(corners));
        let edges_tree = BoxTree::new(sheet.edges.ends.iter().map(ends));
        let make = |role: Role, a: u32, b: u32| {
            let pair = Pair { role, collider: 0, a, b, radius, found_at: 0.0, mode: Mode::Clean };
            let mut pair = self.within(pair, x, reach)?;
            let (source, _) = self.corners(&pair, &sheet.source);
            let gap = role.shape().gap(&source);
            pair.radius = radius.min(SOURCE_SHARE * gap.norm());
            if pair.found_at > pair.radius + (reach - radius) {
                return None;
            }
            let near = gap.norm() < SIDE_REACH;
            if tangled.contains(&(role, a, b)) {
                let sign = if near { orientation(role, &source, &gap).signum() } else { 0.0 };
                pair.mode = Mode::Wrong { sign };
            } else if !near && self.must_pass(role, a, b, tangles) {
                return None;
            }
            Some(pair)
        };
        let around = |v: u32| Some(bounds(&[x[v as usize]], reach));
        let faces = gather(&sheet.order.points, around, &faces_tree, |v, t| {
            let apart = !sheet.share_node(&[v], &sheet.triangles[t as usize]);
            apart.then(|| make(Role::OwnFace, v, t)).flatten()
        });
        let ends = |e: u32| &sheet.edges.ends[e as usize];
        let around = |e: u32| Some(bounds(&ends(e).map(|i| x[i as usize]), reach));
        let edges = gather(&sheet.order.edges, around, &edges_tree, |e, f| {
            let apart = f > e && !sheet.share_node(ends(e), ends(f));
            apart.then(|| make(Role::OwnEdges, e, f)).flatten()
        });
        [faces, edges].concat()
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

/// The gap's component along the triangle's normal, or along the edges' cross product.
pub fn orientation(role: Role, x: &[Vec3; 4], gap: &Vec3) -> f64 {
    match role.shape() {
        Shape::PointTriangle => gap.dot(&(x[2] - x[1]).cross(&(x[3] - x[1]))),
        Shape::SegmentSegment => gap.dot(&(x[1] - x[0]).cross(&(x[3] - x[2]))),
    }
}

/// Distances at which pairs resist [m].
#[derive(Clone, Debug)]
pub struct Radii {
    /// For each collider.
    pub collider: Vec<f64>,
    /// Between parts of the garment.
    pub own: f64,
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
    let lists: Vec<Vec<Pair>> = order.par_chunks(GROUP).map(of_group).collect();
    lists.concat()
}
