//! Closest points of a point and a triangle, and of two segments [Ericson 2005, 5.1.5 and 5.1.9].

use crate::model::Vec3;

/// Barycentric coordinates of the point of triangle `abc` that is closest to `p`.
pub fn point_triangle(p: &Vec3, a: &Vec3, b: &Vec3, c: &Vec3) -> [f64; 3] {
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
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 - d3 > 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 - d6 > 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    if sum <= 0.0 {
        return [1.0, 0.0, 0.0]; // no area: every case above failed by rounding alone
    }
    let (v, w) = (vb / sum, vc / sum);
    [1.0 - v - w, v, w]
}

/// Parameters `(s, t)` of the closest points `a0 + s (a1 - a0)` and `b0 + t (b1 - b0)`.
pub fn segment_segment(a0: &Vec3, a1: &Vec3, b0: &Vec3, b1: &Vec3) -> (f64, f64) {
    let (da, db, r) = (a1 - a0, b1 - b0, a0 - b0);
    let (aa, bb) = (da.norm_squared(), db.norm_squared());
    let (ar, br, ab) = (da.dot(&r), db.dot(&r), da.dot(&db));
    if aa == 0.0 && bb == 0.0 {
        return (0.0, 0.0);
    }
    if aa == 0.0 {
        return (0.0, (br / bb).clamp(0.0, 1.0));
    }
    if bb == 0.0 {
        return ((-ar / aa).clamp(0.0, 1.0), 0.0);
    }
    let denominator = aa * bb - ab * ab;
    let s =
        if denominator > 1e-14 * aa * bb { ((ab * br - ar * bb) / denominator).clamp(0.0, 1.0) } else { 0.5 };
    let t = (ab * s + br) / bb;
    if t < 0.0 {
        ((-ar / aa).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((ab - ar) / aa).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn halton(i: usize, base: usize) -> f64 {
        let (mut f, mut r, mut i) = (1.0, 0.0, i);
        while i > 0 {
            f /= base as f64;
            r += f * (i % base) as f64;
            i /= base;
        }
        2.0 * r - 1.0
    }

    fn point(i: usize) -> Vec3 {
        Vec3::new(halton(i + 1, 2), halton(i + 1, 3), halton(i + 1, 5))
    }

    #[test]
    fn no_sampled_point_is_closer() {
        for k in 0..200 {
            let [p, a, b, c] = std::array::from_fn(|j| point(4 * k + j));
            let w = point_triangle(&p, &a, &b, &c);
            let best = (p - (a * w[0] + b * w[1] + c * w[2])).norm();
            let (s, t) = segment_segment(&p, &a, &b, &c);
            let gap = (p.lerp(&a, s) - b.lerp(&c, t)).norm();
            for i in 0..=20 {
                for j in 0..=20 {
                    let (u, v) = (i as f64 / 20.0, j as f64 / 20.0);
                    if u + v <= 1.0 {
                        assert!((p - (a * (1.0 - u - v) + b * u + c * v)).norm() > best - 1e-12);
                    }
                    assert!((p.lerp(&a, u) - b.lerp(&c, v)).norm() > gap - 1e-12);
                }
            }
        }
    }
}
