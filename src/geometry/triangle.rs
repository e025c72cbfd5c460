//! One triangle: closest point, ray, solid angle.

use std::f64::consts::PI;

use crate::model::Vec3;

/// The point of triangle `corners` closest to `p`, as barycentric coordinates.
///
/// [Ericson 2005, 5.1.5]. A coordinate is exactly zero where the closest feature is an edge
/// or a vertex.
#[inline]
pub fn closest(p: &Vec3, corners: &[Vec3; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = ratio(d1, d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = ratio(d2, d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    if sum <= 0.0 {
        return [1.0, 0.0, 0.0]; // no area: every case above failed by rounding alone
    }
    let (v, w) = (vb / sum, vc / sum);
    [1.0 - v - w, v, w]
}

/// `num / den`, and 0 for an edge without length.
fn ratio(num: f64, den: f64) -> f64 {
    if den > 0.0 { num / den } else { 0.0 }
}

/// The point with barycentric coordinates `b`.
pub fn at(corners: &[Vec3; 3], b: &[f64; 3]) -> Vec3 {
    corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2]
}

/// Where the ray from `origin` along the unit vector `direction` meets the triangle, from
/// either side: distance and barycentric coordinates. [Moeller and Trumbore 1997]
pub fn ray(origin: &Vec3, direction: &Vec3, corners: &[Vec3; 3]) -> Option<(f64, [f64; 3])> {
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let p = direction.cross(&e2);
    let det = e1.dot(&p);
    if det == 0.0 {
        return None;
    }
    let s = origin - corners[0];
    let v = s.dot(&p) / det;
    let q = s.cross(&e1);
    let w = direction.dot(&q) / det;
    let distance = e2.dot(&q) / det;
    let inside = v >= 0.0 && w >= 0.0 && v + w <= 1.0 && distance >= 0.0;
    inside.then_some((distance, [1.0 - v - w, v, w]))
}

/// The triangle's share of the winding number around `p`: its signed solid angle over 4 pi.
/// [Van Oosterom and Strackee 1983]
pub fn winding(p: &Vec3, corners: &[Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|x| x - p);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let num = a.dot(&b.cross(&c));
    let den = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    num.atan2(den) / (2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closest_point_beats_every_sample_of_the_triangle() {
        let corners = [Vec3::new(0.1, 0.0, 0.2), Vec3::new(1.0, 0.2, 0.0), Vec3::new(0.3, 0.9, -0.4)];
        for i in 0..200 {
            let t = i as f64;
            let p = Vec3::new((t * 1.3).sin(), (t * 0.7).cos(), (t * 2.1).sin()) * 1.5;
            let found = (at(&corners, &closest(&p, &corners)) - p).norm();
            let mut best = f64::MAX;
            for j in 0..=100 {
                for k in 0..=100 - j {
                    let b = [(100 - j - k) as f64 / 100.0, j as f64 / 100.0, k as f64 / 100.0];
                    best = best.min((at(&corners, &b) - p).norm());
                }
            }
            assert!(found <= best + 1e-12 && found >= best - 0.02, "{found} {best}");
        }
    }

    #[test]
    fn degenerate_triangles_have_finite_answers() {
        let (a, b) = (Vec3::zeros(), Vec3::x());
        for corners in [[a, a, a], [a, b, a], [a, b, b], [a, b, b * 2.0]] {
            for p in [Vec3::y(), Vec3::x() * 3.0, -Vec3::x(), Vec3::new(0.5, 0.1, 0.0)] {
                let bary = closest(&p, &corners);
                assert!(bary.iter().all(|x| x.is_finite()), "{corners:?} {p:?} {bary:?}");
            }
            assert_eq!(winding(&Vec3::y(), &corners), 0.0);
            assert!(ray(&Vec3::y(), &-Vec3::y(), &corners).is_none());
        }
    }
}
