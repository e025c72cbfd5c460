//! Which cells are active: a narrow band outside of the body and a thin layer inside.
//!
//! Towards its outer end the band *fades*: its stiffness goes smoothly to nothing. A band that ends
//! at once ends somewhere within a cell, and where two limbs part, the place where their bands part
//! is the tip of a crack, which coarse cells put elsewhere than fine ones do.
//!
//! Cells are sorted out in blocks of 8, 4 and 2 to an edge. One distance at a block's
//! centre bounds the distances in the whole block, and one winding number settles the sign
//! of a block that the surface does not enter, so few cells are asked one by one; eight cells
//! near the surface share a [`Patch`] of its triangles.

use rayon::prelude::*;

use super::boundary::{INSIDE, Sides};
use super::domain::{Coordinates, Domain, Kind, Lattice, TooLarge, WHOLE};
use crate::geometry::{Patch, Surface};
use crate::model::Vec3;

/// Depth of the layer of active cells inside of the body, in cells.
pub const DEPTH: f64 = 1.5;
/// Half a cell's diagonal, in cells: nearer than this the surface may cut the cell. The
/// excess is for rounding.
const CUT: f64 = 0.866_025_403_784_438_6 * (1.0 + 1e-9);
/// Farther away than so many radii of its points a patch holds more triangles than it is worth.
const PATCH: f64 = 3.0;
/// Cells along the edge of the largest block.
const BLOCK: i32 = 8;

/// An active cell.
#[derive(Clone, Copy, Debug)]
pub struct Active {
    /// Where it is.
    pub cell: Coordinates,
    /// What its volume does.
    pub kind: Kind,
    /// Whether the surface may cut it.
    pub cut: bool,
    /// Distance of its centre from the surface [m]; infinite where it was not asked.
    pub distance: f64,
    /// Winding number at its centre.
    pub winding: f64,
    /// How much its stiffness counts, in parts of [`WHOLE`].
    pub share: u8,
}

/// How far the active cells reach outside of the body.
#[derive(Clone, Copy, Debug)]
pub struct Band {
    /// Its width [m].
    pub width: f64,
    /// Within this of its outer end it fades out [m].
    pub fade: f64,
}

impl Band {
    /// What a cell counts whose centre is `distance` [m] away.
    fn share(&self, distance: f64) -> u8 {
        let t = ((self.width - distance) / self.fade).min(1.0);
        if t < 1.0 { (f64::from(WHOLE) * t * t * (3.0 - 2.0 * t)).ceil() as u8 } else { WHOLE }
    }
}

/// The domain of active cells.
///
/// # Errors
/// As [`Domain::new`].
pub fn domain(lattice: Lattice, active: &[Active]) -> Result<Domain, TooLarge> {
    let mut domain = Domain::new(lattice, active.iter().map(|a| (a.cell, a.kind)).collect())?;
    domain.shares = active.iter().map(|a| a.share).collect();
    Ok(domain)
}

struct Query<'a> {
    surface: &'a Surface,
    lattice: Lattice,
    band: Band,
}

/// The cells with a centre between [`DEPTH`] cells inside and the band's width outside of the
/// surface, in lexicographic order. The surface's bounding box is `lo`, `hi` [m].
pub fn narrow_band(surface: &Surface, lattice: Lattice, band: Band, lo: &Vec3, hi: &Vec3) -> Vec<Active> {
    let query = Query { surface, lattice, band };
    let block = |p: Vec3| lattice.cell_of(&p).map(|c| c.div_euclid(BLOCK));
    let (first, last) = (block(lo.add_scalar(-band.width)), block(hi.add_scalar(band.width)));
    let mut blocks = Vec::new();
    for i in first[0]..=last[0] {
        for j in first[1]..=last[1] {
            for k in first[2]..=last[2] {
                blocks.push([i * BLOCK, j * BLOCK, k * BLOCK]);
            }
        }
    }
    let found: Vec<Vec<Active>> = blocks
        .par_iter()
        .map(|&lo| {
            let mut out = Vec::new();
            query.sort_out(lo, BLOCK, None, &mut out);
            out
        })
        .collect();
    let mut cells = found.concat();
    cells.sort_unstable_by_key(|active| active.cell);
    cells
}

impl Query<'_> {
    /// Sorts out the block of `size` cells an edge at `lo`; `winding` is the number that it
    /// has all over, where known.
    fn sort_out(&self, lo: Coordinates, size: i32, winding: Option<f64>, out: &mut Vec<Active>) {
        let h = self.lattice.cell;
        let half = 0.5 * h * f64::from(size - 1);
        let centre = self.lattice.centre(lo) + Vec3::repeat(half);
        let reach = half * 3.0_f64.sqrt();
        let nearest = self.surface.closest_within(&centre, self.band.width.max(DEPTH * h) + reach);
        let Some(distance) = nearest.map(|c| c.distance) else {
            return; // beyond the band, or deep inside
        };
        // The surface does not enter a block that is farther from it than the block reaches.
        let apart = distance > reach;
        let winding = winding.or_else(|| apart.then(|| self.surface.winding_number(&centre)));
        if let (Some(winding), true) = (winding, distance > reach + DEPTH * h) {
            if winding.abs() > INSIDE {
                return;
            }
            if distance + reach < self.band.width - self.band.fade {
                let distance = f64::INFINITY;
                let active =
                    |cell| Active { cell, kind: Kind::Open, cut: false, distance, winding, share: WHOLE };
                for_block(lo, size, 1, |cell| out.push(active(cell)));
                return;
            }
        }
        if size == 2 {
            self.sort_out_eight(lo, &centre, distance, winding, out);
        } else {
            for_block(lo, size, size / 2, |lo| self.sort_out(lo, size / 2, winding, out));
        }
    }

    /// Sorts out the cells of a block of two an edge, `distance` away at its `centre`.
    fn sort_out_eight(
        &self,
        lo: Coordinates,
        centre: &Vec3,
        distance: f64,
        winding: Option<f64>,
        out: &mut Vec<Active>,
    ) {
        let (surface, radius) = (self.surface, CUT * self.lattice.cell);
        let mut push = |cell, distance, winding: f64| {
            if let Some((kind, cut)) = self.judge(distance, winding.abs() > INSIDE) {
                let share = if kind == Kind::Open { self.band.share(distance) } else { WHOLE };
                out.push(Active { cell, kind, cut, distance, winding, share });
            }
        };
        if let (Some(winding), true) = (winding, distance > PATCH * radius) {
            for_block(lo, 2, 1, |cell| {
                push(cell, surface.closest(&self.lattice.centre(cell)).distance, winding);
            });
            return;
        }
        let patch = Patch::new(surface, centre, distance, radius);
        let sides = match winding {
            Some(_) => None,
            None => Some(Sides {
                surface,
                patch: &patch,
                centre: *centre,
                winding: surface.winding_number(centre),
            }),
        };
        for_block(lo, 2, 1, |cell| {
            let p = self.lattice.centre(cell);
            let found = sides.as_ref().map_or_else(|| winding.unwrap_or(0.0), |sides| sides.winding(&p));
            push(cell, patch.closest(&p).distance, found);
        });
    }

    /// Kind of the cell with its centre `distance` away and whether it is cut, if it is active.
    fn judge(&self, distance: f64, inside: bool) -> Option<(Kind, bool)> {
        let h = self.lattice.cell;
        match inside {
            _ if distance <= CUT * h => Some((Kind::Open, true)),
            true if distance < DEPTH * h => Some((Kind::Deep, false)),
            false if distance < self.band.width => Some((Kind::Open, false)),
            _ => None,
        }
    }
}

/// Calls `f` for the corners of the parts of `step` cells an edge that make up a block.
pub(super) fn for_block(lo: Coordinates, size: i32, step: i32, mut f: impl FnMut(Coordinates)) {
    for i in (0..size).step_by(step as usize) {
        for j in (0..size).step_by(step as usize) {
            for k in (0..size).step_by(step as usize) {
                f([lo[0] + i, lo[1] + j, lo[2] + k]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::tests::sphere;

    #[test]
    fn the_band_fades_towards_its_end() {
        let surface = Surface::new(sphere(24, 36)); // of radius 1 m
        let (lo, hi) = surface.mesh().bounds().unwrap();
        let lattice = Lattice { origin: lo, cell: 0.05 };
        let cells = |fade: f64| narrow_band(&surface, lattice, Band { width: 0.4, fade }, &lo, &hi);
        let (sharp, faded) = (cells(0.0), cells(0.3));
        assert!(sharp.iter().all(|a| a.share == WHOLE));
        let place = |active: &[Active]| active.iter().map(|a| (a.cell, a.kind)).collect::<Vec<_>>();
        assert_eq!(place(&sharp), place(&faded));
        let (mut whole, mut least) = (0, 0);
        for active in &faded {
            let distance = surface.closest(&lattice.centre(active.cell)).distance;
            let expected = match active.kind {
                Kind::Deep => WHOLE,
                Kind::Open => Band { width: 0.4, fade: 0.3 }.share(distance),
            };
            assert_eq!(active.share, expected);
            whole += usize::from(expected == WHOLE);
            least += usize::from(expected == 1);
        }
        assert!(whole > 1000 && least > 1000 && faded.iter().all(|a| a.share > 0));
    }
}
