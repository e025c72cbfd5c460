//! Closest points of two segments [Ericson 2005, 5.1.9]; those of a point and a triangle are
//! [`crate::geometry::triangle::closest`].

use crate::model::Vec3;

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
    use crate::geometry::triangle::{at, closest};

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
            let best = (p - at(&[a, b, c], &closest(&p, &[a, b, c]))).norm();
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
