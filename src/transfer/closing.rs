//! Closes what the flow leaves between the moved skin and its target.
//!
//! The flow meets the skin in the mean over a cell; what it misses varies over less than that, and in
//! the space around dies off within as much. Finer cells would carry it at the price of all the rest.
//! Near a flat wall a harmonic field is known: at the distance `d` it is the mean of the wall's values
//! with Poisson's kernel, `d / (2 pi |x - y|^3)`. Without the factor that all points of the wall share
//! that is a mean with weights, which needs no side and no normal:
//!
//! ```text
//! u(x) = sum_y w(x - y) miss(y) / (sum_y w(x - y) + 2 pi / FAR)
//! w(r) = area(y) ((r^2 + NEAR^2)^-1.5 - (REACH^2 + NEAR^2)^-1.5)_+
//! ```
//!
//! Cloth that lies on the skin follows it, cloth a centimetre away what the skin does over a
//! centimetre (Shepard's interpolation [Shepard 1968] with the weights of a wall).

use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::model::Vec3;

/// What varies over less is not closed: it would turn the space around inside out [m].
const NEAR: f64 = 3e-3;
/// Skin farther away than this has no say [m].
const REACH: f64 = 0.03;
/// Where the pull of a wide patch of skin has halved [m].
const FAR: f64 = 0.06;

/// Skin and what it misses.
#[derive(Clone, Debug)]
pub(super) struct Closing {
    /// Points of the skin [m].
    pub places: Vec<Vec3>,
    /// Where each has to go from there [m].
    pub missing: Vec<Vec3>,
    /// Area of each [m^2].
    pub areas: Vec<f64>,
    bins: Bins,
}

impl Closing {
    /// Of skin at `places`, each worth its area, and what it misses.
    pub fn new(places: Vec<Vec3>, missing: Vec<Vec3>, areas: Vec<f64>) -> Closing {
        let bins = Bins::new(&places);
        Closing { places, missing, areas, bins }
    }

    /// Displacement [m] and its gradient at `p`; `None` beyond the reach of the skin.
    pub fn sample(&self, p: &Vec3) -> Option<(Vec3, Matrix3<f64>)> {
        let least = (REACH * REACH + NEAR * NEAR).powf(-1.5);
        let (mut sum, mut total) = (Vec3::zeros(), 0.0);
        let (mut sum_slope, mut total_slope) = (Matrix3::zeros(), Vec3::zeros());
        self.bins.around(p, |i| {
            let r = p - self.places[i];
            let square = r.norm_squared() + NEAR * NEAR;
            let power = 1.0 / (square * square.sqrt());
            if power > least {
                let weight = self.areas[i] * (power - least);
                let slope = r * (-3.0 * self.areas[i] * power / square);
                sum += self.missing[i] * weight;
                total += weight;
                sum_slope += self.missing[i] * slope.transpose();
                total_slope += slope;
            }
        });
        (total > 0.0).then(|| {
            let all = total + std::f64::consts::TAU / FAR;
            let u = sum / all;
            (u, (sum_slope - u * total_slope.transpose()) / all)
        })
    }

    /// As [`Closing::sample`], at many points.
    pub fn sample_all(&self, points: &[Vec3]) -> Vec<Option<(Vec3, Matrix3<f64>)>> {
        points.par_iter().map(|p| self.sample(p)).collect()
    }
}

/// Points sorted into cubes of [`REACH`] an edge.
#[derive(Clone, Debug)]
struct Bins {
    /// Cubes that hold points, ascending, and where their points begin.
    cubes: Vec<([i32; 3], u32)>,
    points: Vec<u32>,
}

impl Bins {
    fn new(places: &[Vec3]) -> Bins {
        let mut of_point: Vec<([i32; 3], u32)> =
            places.iter().enumerate().map(|(i, p)| (cube(p), i as u32)).collect();
        of_point.sort_unstable();
        let mut cubes: Vec<([i32; 3], u32)> = Vec::new();
        for (k, (cube, _)) in of_point.iter().enumerate() {
            if cubes.last().is_none_or(|last| last.0 != *cube) {
                cubes.push((*cube, k as u32));
            }
        }
        Bins { cubes, points: of_point.into_iter().map(|(_, i)| i).collect() }
    }

    /// Calls `f` for all points within [`REACH`] of `p`, and for some beyond.
    fn around(&self, p: &Vec3, mut f: impl FnMut(usize)) {
        let [i, j, k] = cube(p);
        for (x, y) in (0..9).map(|o| (i + o / 3 - 1, j + o % 3 - 1)) {
            // The three cubes along z follow one another.
            let first = self.cubes.partition_point(|c| c.0 < [x, y, k - 1]);
            let last = self.cubes.partition_point(|c| c.0 <= [x, y, k + 1]);
            let start = |at: usize| self.cubes.get(at).map_or(self.points.len(), |c| c.1 as usize);
            self.points[start(first)..start(last)].iter().for_each(|&i| f(i as usize));
        }
    }
}

fn cube(p: &Vec3) -> [i32; 3] {
    (p / REACH).map(|c| c.floor() as i32).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 20 cm in points 4 mm apart that misses `missing(x)` along it.
    fn wall(missing: impl Fn(f64) -> f64) -> Closing {
        let step = 4e-3;
        let places: Vec<Vec3> = (0..51 * 51)
            .map(|k| Vec3::new(f64::from(k / 51 - 25), f64::from(k % 51 - 25), 0.0) * step)
            .collect();
        let missing = places.iter().map(|p| Vec3::new(0.0, 0.0, missing(p.x))).collect();
        let areas = vec![step * step; places.len()];
        Closing::new(places, missing, areas)
    }

    #[test]
    fn above_a_wall_waves_die_off_as_a_harmonic_field_does() {
        let number = std::f64::consts::TAU / 0.03;
        let closing = wall(|x| 1e-3 * (number * x).cos());
        for distance in [0.003, 0.006, 0.01] {
            let (u, _) = closing.sample(&Vec3::new(0.0, 0.0, distance)).unwrap();
            let exact = 1e-3 * (-number * distance).exp();
            // The kernel's reach and what is close to the skin take a part of it.
            assert!(u.z > 0.5 * exact && u.z < 1.6 * exact, "{} for {exact} at {distance}", u.z);
        }
        assert!(closing.sample(&Vec3::new(0.0, 0.0, REACH)).is_none());
    }

    #[test]
    fn what_lies_on_the_skin_goes_along() {
        let closing = wall(|_| 1e-3);
        let at = |distance: f64| closing.sample(&Vec3::new(1e-3, 2e-3, distance)).unwrap().0.z;
        assert!(at(0.0) > 0.93e-3 && at(0.0) < 1e-3, "{}", at(0.0));
        assert!(at(0.01) < at(0.005) && at(0.005) < at(0.0) && at(0.029) < 2e-5, "{}", at(0.029));
    }

    #[test]
    fn its_gradient_is_that_of_finite_differences() {
        let closing = wall(|x| 1e-3 * (100.0 * x).sin());
        let (p, e) = (Vec3::new(0.004, 0.001, 0.005), 1e-6);
        let (_, slope) = closing.sample(&p).unwrap();
        for d in 0..3 {
            let step = Vec3::ith(d, e);
            let (up, down) = (closing.sample(&(p + step)).unwrap().0, closing.sample(&(p - step)).unwrap().0);
            assert!(((up - down) / (2.0 * e) - slope.column(d)).norm() < 1e-7);
        }
    }
}
