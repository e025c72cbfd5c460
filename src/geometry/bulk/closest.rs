//! Closest triangles: the walk leaves out subtrees whose box is not nearer than the best so
//! far. A first descent into the nearer child of every node finds a bound that prunes most
//! of it.

use rayon::prelude::*;

use super::{GRAIN, Link, Point, Walk, point};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};
use crate::geometry::bvh::INNER;

pub(super) static CLOSEST: Kernel = Kernel {
    name: "closest_point",
    wgsl: &[INDEX_WGSL, include_str!("closest.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write, Access::Write],
    host: closest,
};

fn closest(args: &mut HostArgs<'_>) {
    let walk = args.params::<Walk>();
    let tree = Tree { walk, links: args.read(0), boxes: args.read(1), corners: args.read(2) };
    let points = args.read::<[f32; 3]>(3);
    let (found, squares) = (args.write::<[u32; 2]>(4), args.write::<f32>(5));
    let states = found.par_iter_mut().zip(squares).with_min_len(GRAIN);
    states.zip(points).for_each(|((found, square), p)| tree.query(&point(p), found, square));
}

struct Tree<'a> {
    walk: Walk,
    links: &'a [Link],
    boxes: &'a [[f32; 6]],
    corners: &'a [[f32; 9]],
}

impl Tree<'_> {
    fn query(&self, p: &Point, [cursor, triangle]: &mut [u32; 2], square: &mut f32) {
        if self.walk.start == 1 {
            (*cursor, *triangle, *square) = (0, INNER, f32::MAX);
            if self.walk.nodes > 0 {
                self.visit(self.descend(p), p, triangle, square);
            }
        }
        let mut i = *cursor;
        let mut turn = 0;
        while turn < self.walk.turns && i < self.walk.nodes {
            if self.box_square(i, p) < *square {
                self.visit(i, p, triangle, square);
                i += 1;
            } else {
                i = self.links[i as usize].skip;
            }
            turn += 1;
        }
        *cursor = i;
    }

    /// The leaf that is reached by always entering the nearer child.
    fn descend(&self, p: &Point) -> u32 {
        let mut i = 0;
        while self.links[i as usize].triangle == INNER {
            let (left, right) = (i + 1, self.links[i as usize + 1].skip);
            i = if self.box_square(left, p) <= self.box_square(right, p) { left } else { right };
        }
        i
    }

    /// Keeps a leaf's triangle if it is nearer.
    fn visit(&self, i: u32, p: &Point, triangle: &mut u32, square: &mut f32) {
        let t = self.links[i as usize].triangle;
        if t == INNER {
            return;
        }
        let c = &self.corners[t as usize];
        let found = triangle_square(&(point(c) - p), &(point(&c[3..]) - p), &(point(&c[6..]) - p));
        if found < *square {
            (*triangle, *square) = (t, found);
        }
    }

    fn box_square(&self, i: u32, p: &Point) -> f32 {
        let b = &self.boxes[i as usize];
        let out = (point(b) - p).sup(&(p - point(&b[3..]))).sup(&Point::zeros());
        out.norm_squared()
    }
}

/// Squared distance of a triangle from the origin [Ericson 2005, 5.1.5].
fn triangle_square(a: &Point, b: &Point, c: &Point) -> f32 {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (-ab.dot(a), -ac.dot(a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a.norm_squared();
    }
    let (d3, d4) = (-ab.dot(b), -ac.dot(b));
    if d3 >= 0.0 && d4 <= d3 {
        return b.norm_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * ratio(d1, d1 - d3)).norm_squared();
    }
    let (d5, d6) = (-ab.dot(c), -ac.dot(c));
    if d6 >= 0.0 && d5 <= d6 {
        return c.norm_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * ratio(d2, d2 - d6)).norm_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (b + (c - b) * ratio(d4 - d3, (d4 - d3) + (d5 - d6))).norm_squared();
    }
    let sum = va + vb + vc;
    (a + ab * ratio(vb, sum) + ac * ratio(vc, sum)).norm_squared()
}

fn ratio(num: f32, den: f32) -> f32 {
    if den > 0.0 { num / den } else { 0.0 }
}
