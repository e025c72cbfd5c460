//! How far a pair may move before it touches: additive continuous collision detection
//! [Li et al. 2021, Codimensional IPC, alg. 1].
//!
//! Each advance is a lower bound of the time to contact, so the result never passes through.

use super::distance::segment_segment;
use crate::geometry::triangle;
use crate::model::Vec3;

/// Share of the lower bound that an advance takes.
const ADVANCE: f64 = 0.9;
/// Share of the starting distance at which a pair stops.
const KEEP: f64 = 0.1;
/// Most advances; a pair that needs more stops where it is.
const MOST_ADVANCES: usize = 200;

/// Which closest-point problem four points pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Shape {
    /// Point 0 and triangle 1, 2, 3.
    PointTriangle,
    /// Segments 0, 1 and 2, 3.
    SegmentSegment,
}

impl Shape {
    /// Coefficients whose weighted sum of the points is the vector between the closest points,
    /// from the second primitive to the first.
    pub fn coefficients(self, x: &[Vec3; 4]) -> [f64; 4] {
        match self {
            Shape::PointTriangle => {
                let w = triangle::closest(&x[0], &[x[1], x[2], x[3]]);
                [1.0, -w[0], -w[1], -w[2]]
            }
            Shape::SegmentSegment => {
                let (s, t) = segment_segment(&x[0], &x[1], &x[2], &x[3]);
                [1.0 - s, s, t - 1.0, -t]
            }
        }
    }

    /// The vector between the closest points, from the second primitive to the first.
    pub fn gap(self, x: &[Vec3; 4]) -> Vec3 {
        combine(&self.coefficients(x), x)
    }

    /// Points of the first primitive.
    pub fn first(self) -> usize {
        match self {
            Shape::PointTriangle => 1,
            Shape::SegmentSegment => 2,
        }
    }
}

/// The weighted sum of four points.
pub fn combine(w: &[f64; 4], x: &[Vec3; 4]) -> Vec3 {
    x[0] * w[0] + x[1] * w[1] + x[2] * w[2] + x[3] * w[3]
}

/// The share of the move `dx`, at most `most`, after which the pair still keeps a tenth of
/// its distance.
pub fn free_share(shape: Shape, mut x: [Vec3; 4], mut dx: [Vec3; 4], most: f64) -> f64 {
    let mean = combine(&[0.25; 4], &dx);
    dx.iter_mut().for_each(|d| *d -= mean);
    let longest = |d: &[Vec3]| d.iter().map(Vec3::norm).fold(0.0, f64::max);
    let speed = longest(&dx[..shape.first()]) + longest(&dx[shape.first()..]);
    if speed == 0.0 {
        return most;
    }
    let start = shape.gap(&x).norm();
    if speed * most <= (1.0 - KEEP) * start {
        return most;
    }
    let mut share = 0.0;
    let mut advance = ADVANCE * start / speed;
    for _ in 0..MOST_ADVANCES {
        x.iter_mut().zip(&dx).for_each(|(x, d)| *x += d * advance);
        let d = shape.gap(&x).norm();
        // The first advance keeps a tenth of the distance by itself, up to rounding; refusing it
        // would freeze a pair that approaches head-on.
        if share > 0.0 && d < KEEP * start {
            break;
        }
        share += advance;
        if share >= most {
            return most;
        }
        advance = ADVANCE * d / speed;
    }
    share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_before_a_wall_and_lets_a_miss_pass() {
        let wall = [Vec3::new(-1.0, 0.0, -1.0), Vec3::new(1.0, 0.0, -1.0), Vec3::new(0.0, 0.0, 2.0)];
        let x = [Vec3::new(0.0, 0.01, 0.0), wall[0], wall[1], wall[2]];
        let down = [Vec3::new(0.0, -0.1, 0.0), Vec3::zeros(), Vec3::zeros(), Vec3::zeros()];
        let share = free_share(Shape::PointTriangle, x, down, 1.0);
        assert!((share - 0.09).abs() < 1e-12, "{share}");
        let aside = [Vec3::new(0.3, 0.0, 0.2), Vec3::zeros(), Vec3::zeros(), Vec3::zeros()];
        assert_eq!(free_share(Shape::PointTriangle, x, aside, 1.0), 1.0);
    }

    #[test]
    fn edges_do_not_cross() {
        let x = [
            Vec3::new(-1.0, 1e-3, 0.0),
            Vec3::new(1.0, 1e-3, 0.0),
            Vec3::new(0.0, 0.0, -1.0),
            Vec3::new(0.0, 0.0, 1.0),
        ];
        let d = Vec3::new(0.0, -0.5, 0.0);
        let dx = [d, d, Vec3::zeros(), Vec3::zeros()];
        let share = free_share(Shape::SegmentSegment, x, dx, 1.0);
        assert!(share > 1e-3 && share * 0.5 < 1e-3, "{share}");
    }
}
