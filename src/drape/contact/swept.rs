//! How far a move may go, whatever its length: continuous collision detection over the boxes that
//! primitives sweep.

use rayon::prelude::*;

use super::ccd;
use super::pairs::{Mode, Pair, Role, Scene};
use super::search::GROUP;
use super::tree::{Bounds, BoxTree, bounds};
use crate::model::Vec3;

/// Primitives whose swept boxes are farther apart than this are not looked at [m].
const CLEARANCE: f64 = 2e-4;

impl Scene<'_> {
    /// The share of the move `dx`, at most 1, that the pair permits.
    pub fn free_share(&self, pair: &Pair, x: &[Vec3], dx: &[Vec3]) -> f64 {
        let (corners, ids) = self.corners(pair, x);
        let moves = ids.map(|i| dx.get(i as usize).copied().unwrap_or_else(Vec3::zeros));
        ccd::free_share(pair.role.shape(), corners, moves, 1.0)
    }

    /// The share of the move `dx` of clean cloth, at most 1, that nothing on its way forbids.
    pub fn swept_share(&self, x: &[Vec3], dx: &[Vec3]) -> f64 {
        let path = Path { scene: self, x, dx };
        (0..self.colliders.len()).map(|c| path.past_collider(c)).fold(path.past_itself(), f64::min)
    }
}

/// The cloth on its way.
struct Path<'a> {
    scene: &'a Scene<'a>,
    x: &'a [Vec3],
    dx: &'a [Vec3],
}

impl Path<'_> {
    fn swept<const N: usize>(&self, points: [u32; N]) -> Bounds {
        let ends = points.map(|p| [self.x[p as usize], self.x[p as usize] + self.dx[p as usize]]);
        bounds(ends.as_flattened(), 0.5 * CLEARANCE)
    }

    fn share(&self, role: Role, collider: usize, a: u32, b: u32) -> f64 {
        let (collider, mode) = (collider as u16, Mode::Clean);
        let pair = Pair { role, collider, a, b, radius: 0.0, found_at: 0.0, mode };
        self.scene.free_share(&pair, self.x, self.dx)
    }

    fn past_collider(&self, c: usize) -> f64 {
        let (sheet, collider) = (&self.scene.sheet, &self.scene.colliders[c]);
        let swept = |v: u32| self.swept([v]);
        let points = least(&sheet.order.points, swept, &collider.triangle_tree, |v, t| {
            self.share(Role::OnCollider, c, v, t)
        });
        let swept = |t: u32| self.swept(sheet.triangles[t as usize]);
        let faces = least(&sheet.order.triangles, swept, &collider.point_tree, |t, p| {
            if collider.used[p as usize] { self.share(Role::UnderCloth, c, p, t) } else { 1.0 }
        });
        let swept = |e: u32| self.swept(sheet.edges.ends[e as usize]);
        let edges = least(&sheet.order.edges, swept, &collider.edge_tree, |e, f| {
            self.share(Role::EdgeCollider, c, e, f)
        });
        points.min(faces).min(edges)
    }

    fn past_itself(&self) -> f64 {
        let sheet = &self.scene.sheet;
        let faces = BoxTree::new(sheet.triangles.iter().map(|&t| self.swept(t)));
        let edges = BoxTree::new(sheet.edges.ends.iter().map(|&e| self.swept(e)));
        let swept = |v: u32| self.swept([v]);
        let by_points = least(&sheet.order.points, swept, &faces, |v, t| {
            let apart = !sheet.share_node(&[v], &sheet.triangles[t as usize]);
            if apart { self.share(Role::OwnFace, 0, v, t) } else { 1.0 }
        });
        let ends = |e: u32| sheet.edges.ends[e as usize];
        let by_edges = least(
            &sheet.order.edges,
            |e| self.swept(ends(e)),
            &edges,
            |e, f| {
                let apart = f > e && !sheet.share_node(&ends(e), &ends(f));
                if apart { self.share(Role::OwnEdges, 0, e, f) } else { 1.0 }
            },
        );
        by_points.min(by_edges)
    }
}

/// The least share, at most 1, of all primitives in `order` and the items of `tree` on their way.
fn least(
    order: &[u32],
    swept: impl Fn(u32) -> Bounds + Sync,
    tree: &BoxTree,
    share: impl Fn(u32, u32) -> f64 + Sync,
) -> f64 {
    let of_group = |group: &[u32]| {
        let queries: Vec<(u32, Bounds)> = group.iter().map(|&i| (i, swept(i))).collect();
        let mut least = 1.0_f64;
        tree.query_all(&queries, &mut |i, item| least = least.min(share(i, item)));
        least
    };
    order.par_chunks(GROUP).map(of_group).reduce(|| 1.0, f64::min)
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
        let share = scene.swept_share(&x, &down);
        assert!(share > 0.05 && share < 0.1, "{share}");
        // Only the upper one goes down: it meets the lower.
        let upper: Vec<Vec3> = x.iter().map(|p| Vec3::y() * if p.y > 0.15 { -0.3 } else { 0.0 }).collect();
        let share = scene.swept_share(&x, &upper);
        assert!(share > 0.05 && share < 0.1, "{share}");
        // Aside and up there is nothing.
        assert_eq!(scene.swept_share(&x, &vec![Vec3::new(0.5, 0.1, 0.0); x.len()]), 1.0);
    }
}
