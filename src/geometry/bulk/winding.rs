//! Hierarchical winding numbers; the theory stands in [`crate::geometry::winding`].
//!
//! Moments are `f32` about their own centres, so nothing cancels in them. The angle is
//! computed by a polynomial on both devices: a GPU's own `atan2` may be off by 4096 units
//! in the last place.

use std::f32::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::{GRAIN, Link, Point, Walk, point};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};
use crate::geometry::bvh::INNER;
use crate::geometry::winding::{Moments, OPENING};
use crate::model::Vec3;

/// Words of a node's moments; `MOMENTS` in winding.wgsl.
pub(super) const MOMENTS: usize = 23;

pub(super) static WINDING: Kernel = Kernel {
    name: "winding_number",
    wgsl: &[INDEX_WGSL, include_str!("winding.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write, Access::Write],
    host: winding,
};

/// Centre, squared radius of opening, N, F, C.
pub(super) fn pack(m: &Moments, origin: &Vec3) -> [f32; MOMENTS] {
    let center = Vec3::from(m.center) - origin;
    let reach = OPENING * m.radius;
    let all = center.iter().copied().chain([reach * reach]).chain(m.normal).chain(m.quadratic).chain(m.cubic);
    let mut packed = [0.0; MOMENTS];
    packed.iter_mut().zip(all).for_each(|(to, from)| *to = from as f32);
    packed
}

fn winding(args: &mut HostArgs<'_>) {
    let walk = args.params::<Walk>();
    let (links, moments) = (args.read::<Link>(0), args.read::<[f32; MOMENTS]>(1));
    let (corners, points) = (args.read::<[f32; 9]>(2), args.read::<[f32; 3]>(3));
    let (cursors, sums) = (args.write::<u32>(4), args.write::<f32>(5));
    let states = cursors.par_iter_mut().zip(sums).with_min_len(GRAIN);
    states.zip(points).for_each(|((cursor, total), p)| {
        let p = point(p);
        let (mut i, mut sum) = if walk.start == 1 { (0, 0.0) } else { (*cursor, *total) };
        let mut turn = 0;
        while turn < walk.turns && i < walk.nodes {
            let (m, link) = (&moments[i as usize], links[i as usize]);
            let r = point(m) - p;
            let square = r.norm_squared();
            if square > m[3] {
                sum += far(m, &r, square);
                i = link.skip;
            } else {
                if link.triangle != INNER {
                    sum += near(&corners[link.triangle as usize], &p);
                }
                i += 1;
            }
            turn += 1;
        }
        (*cursor, *total) = (i, sum);
    });
}

/// A cluster's share, expanded about its centre at `r`.
fn far(m: &[f32; MOMENTS], r: &Point, square: f32) -> f32 {
    let inv2 = 1.0 / square;
    let inv3 = inv2 * inv2.sqrt();
    let (n, f, c) = (point(&m[4..]), &m[7..13], &m[13..23]);
    let (xx, yy, zz) = (r.x * r.x, r.y * r.y, r.z * r.z);
    let quadratic =
        f[0] * xx + f[1] * yy + f[2] * zz + f[3] * r.x * r.y + f[4] * r.y * r.z + f[5] * r.z * r.x;
    let cubic = r.x * (c[0] * xx + c[5] * zz + c[6] * yy)
        + r.y * (c[1] * yy + c[3] * xx + c[7] * zz)
        + r.z * (c[2] * zz + c[4] * yy + c[8] * xx + c[9] * r.x * r.y);
    let half_laplacian = r.x * (3.0 * c[0] + c[5] + c[6])
        + r.y * (3.0 * c[1] + c[3] + c[7])
        + r.z * (3.0 * c[2] + c[4] + c[8]);
    let sum = n.dot(r) + f[0] + f[1] + f[2] - 3.0 * quadratic * inv2
        + (15.0 * cubic * inv2 - 3.0 * half_laplacian) * inv2;
    sum * inv3 / (4.0 * PI)
}

/// A triangle's share: its solid angle over 4 pi [Van Oosterom and Strackee 1983].
fn near(corners: &[f32; 9], p: &Point) -> f32 {
    let (a, b, c) = (point(corners) - p, point(&corners[3..]) - p, point(&corners[6..]) - p);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let num = a.dot(&b.cross(&c));
    let den = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    angle(num, den) / (2.0 * PI)
}

#[allow(clippy::excessive_precision, reason = "as printed")]
/// `atan2(y, x)` to 2e-7, by the polynomial [Abramowitz and Stegun 1964, 4.4.49].
fn angle(y: f32, x: f32) -> f32 {
    let (small, large) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    if large == 0.0 {
        return 0.0;
    }
    let t = small / large;
    let s = t * t;
    let mut series = 0.0028662257;
    for coefficient in [
        -0.0161657367,
        0.0429096138,
        -0.07528964,
        0.1065626393,
        -0.1420889944,
        0.1999355085,
        -0.3333314528,
        1.0,
    ] {
        series = series * s + coefficient;
    }
    let mut angle = series * t;
    if y.abs() > x.abs() {
        angle = FRAC_PI_2 - angle;
    }
    if x < 0.0 {
        angle = PI - angle;
    }
    if y < 0.0 { -angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_is_atan2() {
        for i in 0..=100_000 {
            let turn = f64::from(i) / 100_000.0 * std::f64::consts::TAU;
            let (y, x) = (turn.sin() as f32 * 3.0, turn.cos() as f32 * 3.0);
            let error = f64::from(angle(y, x)) - f64::from(y).atan2(f64::from(x));
            // Half a turn may be told from either side.
            let error = error.abs().min((error.abs() - std::f64::consts::TAU).abs());
            assert!(error < 5e-7, "{y} {x}: {error:e}");
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
        assert_eq!(angle(1.0, 0.0), FRAC_PI_2);
    }
}
