//! Narrow-band signed distance grids (paper section 5.1).
//!
//! The distance to a surface's triangles, with a sign from the winding number: a point is
//! inside where the winding number exceeds a threshold, 0.5 for a closed surface and 0.25 for
//! a garment, which "seals" neck, cuffs and hem. Values are exact (to f32) at grid nodes and
//! trilinear between them, so for a point at distance d from the surface the value is off by
//! at most
//!
//!   sqrt(3) h  near the surface's medial axis (creases, the middle of thin parts), and
//!   3 h^2 / (8 R)  where the surface is smooth with radius of curvature R > h,
//!
//! with spacing h, since a distance changes by at most a step's length, and since its second
//! derivatives are at most 1/R and trilinear interpolation errs by at most h^2/8 of each.
//!
//! *Where we differ from the paper*: the level of 0.25 bulges over necks and hems like an
//! invisible cap. There the sign flips far from any triangle and the value jumps. Cells that
//! are cut by such a cap have no value, so that it pushes no cloth.
//!
//! The sign costs most. Around a closed surface the winding number changes only across
//! triangles, and none lies between two neighbouring nodes if one of them is farther than a step
//! from the surface: such nodes share one winding number. Around an open one every node asks.
//!
//! Storage: bricks of 8^3 cells that repeat the nodes on their faces, so that a sample reads
//! one brick; a dense table finds the brick. Only bricks within the band are there, and nodes
//! outside of it hold NaN.

use rayon::prelude::*;
use thiserror::Error;

use super::Surface;
use crate::model::Vec3;

/// Threshold of the winding number for closed surfaces.
pub const CLOSED: f64 = 0.5;
/// Threshold of the winding number for garments (paper section 5.1).
pub const OPEN: f64 = 0.25;

const CELLS: usize = 8;
const NODES: usize = CELLS + 1;
const BRICK: usize = NODES * NODES * NODES;
/// Largest number of entries in the table of bricks (4 bytes each).
const TABLE_MAX: f64 = 64e6;

/// Why a grid cannot be made.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SdfError {
    /// Spacing and band must be positive and finite.
    #[error("a distance grid needs a positive spacing and band, not {spacing} m and {band} m")]
    Size {
        /// Spacing [m].
        spacing: f64,
        /// Band [m].
        band: f64,
    },
    /// The surface is too large for the spacing, or not finite.
    #[error("a distance grid with a spacing of {spacing} m over {extent:?} m is too large")]
    TooLarge {
        /// Spacing [m].
        spacing: f64,
        /// Size of the surface with its band [m].
        extent: [f64; 3],
    },
}

/// Signed distance on the nodes of a sparse grid; negative inside.
#[derive(Clone, Debug)]
pub struct Sdf {
    origin: Vec3,
    spacing: f64,
    /// Number of bricks along each axis.
    bricks: [usize; 3],
    /// Index of each brick, `u32::MAX` outside of the band.
    table: Vec<u32>,
    values: Vec<f32>,
    expansion: f64,
}

impl Sdf {
    /// Samples `surface` on a grid of `spacing` [m] wherever a brick of cells comes within
    /// `band` [m] of it. Inside is where the winding number exceeds `threshold`.
    ///
    /// # Errors
    /// Sizes that make no grid, see [`SdfError`].
    pub fn new(surface: &Surface, threshold: f64, spacing: f64, band: f64) -> Result<Sdf, SdfError> {
        let good = |x: f64| x > 0.0 && x.is_finite();
        if !good(spacing) || !good(band) {
            return Err(SdfError::Size { spacing, band });
        }
        let (lo, hi) = surface.mesh().bounds().unwrap_or((Vec3::zeros(), Vec3::zeros()));
        let margin = Vec3::repeat(band + spacing);
        let (origin, extent) = (lo - margin, hi - lo + margin * 2.0);
        let side = spacing * CELLS as f64;
        let count = extent.map(|x| (x / side).floor() + 1.0);
        let cells = count.product();
        if cells.is_nan() || cells > TABLE_MAX {
            return Err(SdfError::TooLarge { spacing, extent: extent.into() });
        }
        let bricks = [count.x as usize, count.y as usize, count.z as usize];
        let mut sdf = Sdf { origin, spacing, bricks, table: Vec::new(), values: Vec::new(), expansion: 0.0 };
        let active = sdf.active_bricks(surface, band);
        sdf.table = vec![u32::MAX; bricks.iter().product()];
        for (n, &brick) in active.iter().enumerate() {
            sdf.table[brick] = n as u32;
        }
        let values: Vec<[f32; BRICK]> =
            active.par_iter().map(|&b| sdf.brick_values(surface, threshold, band, b)).collect();
        sdf.values = values.concat();
        Ok(sdf)
    }

    /// The same field with the surface moved outwards by `eps` [m] (epsilon_sdf in the paper).
    pub fn expanded(mut self, eps: f64) -> Sdf {
        self.expansion += eps;
        self
    }

    /// Grid spacing [m].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Number of grid nodes that are stored, those outside of the band included.
    pub fn node_count(&self) -> usize {
        self.values.len()
    }

    /// Signed distance [m] and its gradient at `p`, trilinear; `None` outside of the band and
    /// where the cap of an open surface cuts the cell.
    pub fn sample(&self, p: &Vec3) -> Option<(f64, Vec3)> {
        let at = (p - self.origin) / self.spacing;
        let mut brick = 0;
        let (mut local, mut frac) = ([0; 3], [0.0; 3]);
        for k in (0..3).rev() {
            let cell = at[k].floor();
            // Not `<`: a point that is not a number must not pass.
            if !(cell >= 0.0 && cell < (self.bricks[k] * CELLS) as f64) {
                return None;
            }
            let index = cell as usize;
            brick = brick * self.bricks[k] + index / CELLS;
            local[k] = index % CELLS;
            frac[k] = at[k] - cell;
        }
        let n = self.table[brick];
        if n == u32::MAX {
            return None;
        }
        let values = &self.values[n as usize * BRICK..][..BRICK];
        let first = node_index(local[0], local[1], local[2]);
        let corner: [f64; 8] =
            std::array::from_fn(|c| f64::from(values[first + node_index(c & 1, c >> 1 & 1, c >> 2)]));
        let (value, slope) = trilinear(&corner, &frac);
        if value.is_nan() || self.is_cap(&corner) {
            return None;
        }
        Some((value - self.expansion, slope / self.spacing))
    }

    /// Whether the sign flips in a cell that no triangle comes near: a distance differs by at
    /// most a step's length from one corner of the cell to the next.
    fn is_cap(&self, corner: &[f64; 8]) -> bool {
        let reach = self.spacing * (1.0 + 1e-3);
        (0..8).any(|c| {
            [1, 2, 4].into_iter().filter(|k| c & k == 0).any(|k| (corner[c] - corner[c | k]).abs() > reach)
        })
    }

    /// Bricks that come within `band` of the surface, ascending.
    fn active_bricks(&self, surface: &Surface, band: f64) -> Vec<usize> {
        let side = self.spacing * CELLS as f64;
        let mut near = vec![false; self.bricks.iter().product()];
        for t in 0..surface.mesh().triangles.len() {
            let [a, b, c] = surface.mesh().corners(t);
            let range = |k: usize| {
                let cell = |x: f64| ((x - self.origin[k]) / side).max(0.0) as usize;
                let (lo, hi) = (a[k].min(b[k]).min(c[k]) - band, a[k].max(b[k]).max(c[k]) + band);
                cell(lo)..=cell(hi).min(self.bricks[k] - 1)
            };
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        near[x + self.bricks[0] * (y + self.bricks[1] * z)] = true;
                    }
                }
            }
        }
        let reach = band + side * 0.75f64.sqrt();
        (0..near.len())
            .into_par_iter()
            .filter(|&b| near[b])
            .filter(|&b| {
                let middle = self.brick_origin(b) + Vec3::repeat(side / 2.0);
                surface.closest_within(&middle, reach).is_some()
            })
            .collect()
    }

    fn brick_origin(&self, brick: usize) -> Vec3 {
        let [nx, ny, _] = self.bricks;
        let at = Vec3::new((brick % nx) as f64, (brick / nx % ny) as f64, (brick / nx / ny) as f64);
        self.origin + at * (self.spacing * CELLS as f64)
    }

    fn brick_values(&self, surface: &Surface, threshold: f64, band: f64, brick: usize) -> [f32; BRICK] {
        let corner = self.brick_origin(brick);
        let point = |n: usize| {
            let at = Vec3::new((n % NODES) as f64, (n / NODES % NODES) as f64, (n / NODES / NODES) as f64);
            corner + at * self.spacing
        };
        // All corners of a cell that the band touches have a distance.
        let reach = band + self.spacing * 3f64.sqrt();
        let mut distance = [f64::INFINITY; BRICK];
        let mut bound = reach;
        for n in 0..BRICK {
            if n % NODES == 0 {
                bound = reach; // a new row
            }
            distance[n] = surface.closest_within(&point(n), bound).map_or(f64::INFINITY, |c| c.distance);
            // The next node is a step away, and so is no farther from the surface than this.
            bound = reach.min(distance[n] + self.spacing * (1.0 + 1e-6));
        }
        let inside = |n: usize| surface.winding_number(&point(n)) > threshold;
        let mut sign = [0i8; BRICK];
        for n in 0..BRICK {
            if sign[n] == 0 && distance[n].is_finite() {
                sign[n] = if inside(n) { -1 } else { 1 };
                if surface.is_closed() {
                    self.spread(n, &distance, &mut sign);
                }
            }
        }
        std::array::from_fn(|n| match distance[n].is_finite() {
            true => distance[n] as f32 * f32::from(sign[n]),
            false => f32::NAN,
        })
    }

    /// Gives the sign of node `start` to all that are joined to it by steps without a triangle.
    fn spread(&self, start: usize, distance: &[f64; BRICK], sign: &mut [i8; BRICK]) {
        let mut pending = vec![start];
        while let Some(n) = pending.pop() {
            let mut visit = |m: usize| {
                if sign[m] == 0 && distance[n].max(distance[m]) > self.spacing * (1.0 + 1e-6) {
                    sign[m] = sign[n];
                    pending.push(m);
                }
            };
            for (place, stride) in
                [(n % NODES, 1), (n / NODES % NODES, NODES), (n / NODES / NODES, NODES * NODES)]
            {
                if place > 0 {
                    visit(n - stride);
                }
                if place < CELLS {
                    visit(n + stride);
                }
            }
        }
    }
}

fn node_index(x: usize, y: usize, z: usize) -> usize {
    x + NODES * (y + NODES * z)
}

/// Value and gradient in units of the cell; corner `c` stands at (c & 1, c >> 1 & 1, c >> 2).
fn trilinear(corner: &[f64; 8], f: &[f64; 3]) -> (f64, Vec3) {
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let x: [f64; 4] = std::array::from_fn(|i| mix(corner[2 * i], corner[2 * i + 1], f[0]));
    let y = [mix(x[0], x[1], f[1]), mix(x[2], x[3], f[1])];
    let dx: [f64; 4] = std::array::from_fn(|i| corner[2 * i + 1] - corner[2 * i]);
    let slope = Vec3::new(
        mix(mix(dx[0], dx[1], f[1]), mix(dx[2], dx[3], f[1]), f[2]),
        mix(x[1] - x[0], x[3] - x[2], f[2]),
        y[1] - y[0],
    );
    (mix(y[0], y[1], f[2]), slope)
}

/// The union of fields: their minimum (paper section 5.1).
#[derive(Clone, Debug, Default)]
pub struct SdfUnion {
    /// The fields; grids may differ.
    pub parts: Vec<Sdf>,
}

impl SdfUnion {
    /// Signed distance [m] and its gradient: those of the field with the smallest value among
    /// the ones that have one at `p`.
    pub fn sample(&self, p: &Vec3) -> Option<(f64, Vec3)> {
        self.parts.iter().filter_map(|sdf| sdf.sample(p)).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::{scatter, sphere};

    const SPACING: f64 = 0.04;

    #[test]
    fn values_near_a_ball_are_within_the_stated_error() {
        let surface = Surface::new(sphere(40, 60));
        let sdf = Sdf::new(&surface, CLOSED, SPACING, 0.1).expect("fits");
        let mut sampled = 0;
        for p in scatter(4000) {
            let exact = surface.closest(&p).distance;
            let Some((value, gradient)) = sdf.sample(&p) else {
                assert!(exact > 0.1, "{p:?} is in the band");
                continue;
            };
            sampled += 1;
            if exact > 2e-3 {
                assert_eq!(value < 0.0, surface.winding_number(&p) > 0.5);
            }
            // The polyhedron's creases are blunt: 3 h^2 / 8 R, and the facets' own sagitta.
            assert!((value.abs() - exact).abs() < 2e-3, "{value} {exact}");
            assert!((gradient - p.normalize()).norm() < 0.1, "{gradient:?}");
        }
        assert!(sampled > 400, "{sampled}");
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        let sdf = Sdf::new(&Surface::new(sphere(20, 30)), CLOSED, 0.05, 0.2).expect("fits");
        let step = 1e-7;
        for p in scatter(500).filter(|p| (0.9..1.1).contains(&p.norm())) {
            let (Some((_, gradient)), Some(ahead), Some(behind)) = (
                sdf.sample(&p),
                sdf.sample(&(p + Vec3::new(1.0, 2.0, 3.0) * step)),
                sdf.sample(&(p - Vec3::new(1.0, 2.0, 3.0) * step)),
            ) else {
                panic!("{p:?} is in the band");
            };
            let slope = (ahead.0 - behind.0) / (2.0 * step);
            assert!((slope - gradient.dot(&Vec3::new(1.0, 2.0, 3.0))).abs() < 1e-2);
        }
    }

    #[test]
    fn union_is_the_minimum_and_expansion_moves_the_surface() {
        let ball = |x: f64| {
            let mut mesh = sphere(24, 32);
            mesh.points.iter_mut().for_each(|p| p.x += x);
            Sdf::new(&Surface::new(mesh), CLOSED, 0.05, 0.4).expect("fits")
        };
        let (a, b) = (ball(0.0), ball(1.1));
        let both = SdfUnion { parts: vec![a.clone().expanded(0.03), b.clone().expanded(0.03)] };
        let p = Vec3::new(0.95, 0.05, 0.02);
        let (va, vb) = (a.sample(&p).expect("in the band").0, b.sample(&p).map(|s| s.0));
        let (value, _) = both.sample(&p).expect("in the band");
        assert!((value - (vb.map_or(va, |v| v.min(va)) - 0.03)).abs() < 1e-15);
        assert!(both.sample(&Vec3::new(9.0, 0.0, 0.0)).is_none());
        assert!(both.sample(&Vec3::new(f64::NAN, 0.0, 0.0)).is_none());
    }

    #[test]
    fn the_cap_of_an_open_surface_has_no_value() {
        // A ball without its top, a neck hole of radius 0.6.
        let mut mesh = sphere(40, 60);
        let points = mesh.points.clone();
        mesh.triangles.retain(|t| t.iter().all(|&i| points[i as usize].y < 0.8));
        let surface = Surface::new(mesh);
        let sdf = Sdf::new(&surface, OPEN, 0.08, 0.7).expect("fits");
        assert!(sdf.sample(&Vec3::new(0.0, -0.9, 0.0)).expect("in the band").0 < -0.05);
        // On the axis the winding number falls through 0.25 in the middle of the hole.
        let inside = |y: f64| surface.winding_number(&Vec3::new(0.01, y, 0.01)) > OPEN;
        assert!(inside(0.5) && !inside(1.3));
        let cap = (0..800).map(|i| 0.5 + f64::from(i) * 1e-3).find(|&y| !inside(y)).expect("a cap");
        assert!(sdf.sample(&Vec3::new(0.01, cap, 0.01)).is_none());
        let near = |y: f64| sdf.sample(&Vec3::new(0.01, y, 0.01));
        assert!(near(cap - 0.17).is_some_and(|s| s.0 < 0.0));
    }

    #[test]
    fn sizes_that_make_no_grid_are_errors() {
        let surface = Surface::new(sphere(6, 8));
        for (spacing, band) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert!(matches!(Sdf::new(&surface, CLOSED, spacing, band), Err(SdfError::Size { .. })));
        }
        assert!(matches!(Sdf::new(&surface, CLOSED, 1e-5, 0.1), Err(SdfError::TooLarge { .. })));
    }
}
