//! How far a move may go, whatever its length: continuous collision detection over the boxes that
//! primitives sweep.

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::ccd;
use super::pairs::{Mode, Pair, Role, Scene};
use super::search::{GROUP, GROUPS};
use super::tree::{Bounds, BoxTree, bounds};
use crate::model::Vec3;

/// Primitives whose swept boxes are farther apart than this are not looked at [m].
const CLEARANCE: f64 = 2e-4;

impl Scene<'_> {
    /// The share of a move, at most `most`, that the pair permits: contact points by `dx`, the
    /// points of collider `c` by `colliders[c]` (none if there are none).
    pub fn free_share(
        &self,
        pair: &Pair,
        x: &[Vec3],
        (dx, colliders): (&[Vec3], &[Vec<Vec3>]),
        most: f64,
    ) -> f64 {
        let its = |i: u32| colliders.get(pair.collider as usize).map_or_else(Vec3::zeros, |m| m[i as usize]);
        let moves = self.of_corners(pair, |i| dx[i as usize], its);
        ccd::free_share(pair.role.shape(), self.corners(pair, x), moves, most)
    }

    /// As [`Scene::free_share`], at most 1, for clean cloth and all that is on its way.
    pub fn swept_share(&self, x: &[Vec3], dx: &[Vec3], colliders: &[Vec<Vec3>]) -> f64 {
        let path = Path { scene: self, x, dx, colliders, least: Least::new() };
        path.past_itself();
        (0..self.colliders.len()).for_each(|c| path.past_collider(c));
        path.least.get()
    }
}

/// The least share that any task has found: what permits as much need not be looked at closely.
/// The least of all does not depend on the order in which they are met.
struct Least(AtomicU64);

impl Least {
    fn new() -> Least {
        Least(AtomicU64::new(1.0_f64.to_bits()))
    }

    fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Relaxed))
    }

    fn lower(&self, share: f64) {
        // Bits of floats that are not negative are ordered as the floats are.
        self.0.fetch_min(share.to_bits(), Relaxed);
    }
}

/// The cloth on its way.
struct Path<'a> {
    scene: &'a Scene<'a>,
    x: &'a [Vec3],
    dx: &'a [Vec3],
    colliders: &'a [Vec<Vec3>],
    least: Least,
}

impl Path<'_> {
    fn swept<const N: usize>(&self, points: [u32; N]) -> Bounds {
        let ends = points.map(|p| [self.x[p as usize], self.x[p as usize] + self.dx[p as usize]]);
        bounds(ends.as_flattened(), 0.5 * CLEARANCE)
    }

    /// Looks at a pair.
    fn meet(&self, role: Role, collider: usize, a: u32, b: u32) {
        let (collider, mode) = (collider as u16, Mode::Clean);
        let pair = Pair { role, collider, a, b, radius: 0.0, found_at: 0.0, mode };
        let most = self.least.get();
        let share = self.scene.free_share(&pair, self.x, (self.dx, self.colliders), most);
        if share < most {
            self.least.lower(share);
        }
    }

    fn past_collider(&self, c: usize) {
        let (sheet, collider) = (&self.scene.sheet, &self.scene.colliders[c]);
        let trees = self.collider_trees(c);
        let swept = |v: u32| self.swept([v]);
        on_the_way(&sheet.near.points.order, swept, &trees.triangles, |v, t| {
            self.meet(Role::OnCollider, c, v, t);
        });
        let swept = |t: u32| self.swept(sheet.triangles[t as usize]);
        on_the_way(&sheet.near.triangles.order, swept, &trees.points, |t, p| {
            if collider.used[p as usize] {
                self.meet(Role::UnderCloth, c, p, t);
            }
        });
        let swept = |e: u32| self.swept(sheet.edges.ends[e as usize]);
        on_the_way(&sheet.near.edges.order, swept, &trees.edges, |e, f| {
            self.meet(Role::EdgeCollider, c, e, f);
        });
    }

    /// Over the boxes that the collider's primitives sweep.
    fn collider_trees(&self, c: usize) -> ColliderTrees<'_> {
        let collider = &self.scene.colliders[c];
        let Some(moves) = self.colliders.get(c) else {
            return ColliderTrees {
                triangles: Cow::Borrowed(&collider.triangle_tree),
                edges: Cow::Borrowed(&collider.edge_tree),
                points: Cow::Borrowed(&collider.point_tree),
            };
        };
        let mesh = collider.mesh();
        let ends = |p: u32| [mesh.points[p as usize], mesh.points[p as usize] + moves[p as usize]];
        let triangle = |t: u32| bounds(mesh.triangles[t as usize].map(ends).as_flattened(), 0.0);
        let edge = |e: u32| bounds(collider.edges.ends[e as usize].map(ends).as_flattened(), 0.0);
        ColliderTrees {
            triangles: Cow::Owned(collider.triangle_tree.fitted(triangle)),
            edges: Cow::Owned(collider.edge_tree.fitted(edge)),
            points: Cow::Owned(collider.point_tree.fitted(|p| bounds(&ends(p), 0.0))),
        }
    }

    fn past_itself(&self) {
        let (sheet, near) = (&self.scene.sheet, &self.scene.sheet.near);
        let faces = near.triangles.tree.fitted(|t| self.swept(sheet.triangles[t as usize]));
        let edges = near.edges.tree.fitted(|e| self.swept(sheet.edges.ends[e as usize]));
        let swept = |v: u32| self.swept([v]);
        on_the_way(&near.points.order, swept, &faces, |v, t| {
            if !sheet.share_node(&[v], &sheet.triangles[t as usize]) {
                self.meet(Role::OwnFace, 0, v, t);
            }
        });
        let ends = |e: u32| sheet.edges.ends[e as usize];
        let swept = |e: u32| self.swept(ends(e));
        on_the_way(&near.edges.order, swept, &edges, |e, f| {
            if f > e && !sheet.share_node(&ends(e), &ends(f)) {
                self.meet(Role::OwnEdges, 0, e, f);
            }
        });
    }
}

/// Trees over a collider's primitives.
struct ColliderTrees<'a> {
    triangles: Cow<'a, BoxTree>,
    edges: Cow<'a, BoxTree>,
    points: Cow<'a, BoxTree>,
}

/// Calls `meet` with all primitives in `order` and the items of `tree` on their way.
fn on_the_way(
    order: &[u32],
    swept: impl Fn(u32) -> Bounds + Sync,
    tree: &BoxTree,
    meet: impl Fn(u32, u32) + Sync,
) {
    let of_group = |group: &[u32]| {
        let queries: Vec<(u32, Bounds)> = group.iter().map(|&i| (i, swept(i))).collect();
        tree.query_all(&queries, &mut |i, item| meet(i, item));
    };
    order.par_chunks(GROUP).with_min_len(GROUPS).for_each(of_group);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::contact::fixed::Fixed;
    use crate::drape::contact::sheet::Sheet;
    use crate::drape::tests::{patches, sphere};

    /// Two patches 3 cm apart above a ball.
    fn scene(ball: &crate::geometry::Surface) -> (Scene<'_>, Vec<Vec3>) {
        let at = |height: f64| move |x: f64, y: f64| Vec3::new(x - 0.1, height, y - 0.1);
        let garment = patches(6, 0.2, &[&at(0.13), &at(0.16)]);
        let sheet = Sheet::new(&garment);
        let x = sheet.points(&garment.points);
        (Scene { sheet, colliders: vec![Fixed::new(ball, true)] }, x)
    }

    #[test]
    fn long_moves_stop_before_what_is_on_their_way() {
        let ball = sphere(0.1, 12);
        let (scene, x) = scene(&ball);
        // All goes down together: the lower patch meets the ball's top 3 cm below.
        let down = vec![Vec3::new(0.0, -0.3, 0.0); x.len()];
        let share = scene.swept_share(&x, &down, &[]);
        assert!(share > 0.05 && share < 0.1, "{share}");
        // Only the upper one goes down: it meets the lower.
        let upper: Vec<Vec3> = x.iter().map(|p| Vec3::y() * if p.y > 0.15 { -0.3 } else { 0.0 }).collect();
        let share = scene.swept_share(&x, &upper, &[]);
        assert!(share > 0.05 && share < 0.1, "{share}");
        // Aside and up there is nothing.
        assert_eq!(scene.swept_share(&x, &vec![Vec3::new(0.5, 0.1, 0.0); x.len()], &[]), 1.0);
    }

    #[test]
    fn a_collider_that_moves_stops_at_cloth_that_does_not_give_way() {
        let ball = sphere(0.1, 12);
        let (scene, x) = scene(&ball);
        let up = [vec![Vec3::new(0.0, 0.3, 0.0); ball.mesh().points.len()]];
        let share = scene.swept_share(&x, &vec![Vec3::zeros(); x.len()], &up);
        assert!(share > 0.05 && share < 0.1, "{share}");
        // With all going the same way nothing meets, and beside the cloth the ball passes.
        assert_eq!(scene.swept_share(&x, &vec![up[0][0]; x.len()], &up), 1.0);
        let aside = [vec![Vec3::new(0.5, 0.0, 0.0); ball.mesh().points.len()]];
        assert_eq!(scene.swept_share(&x, &vec![Vec3::zeros(); x.len()], &aside), 1.0);
    }
}
