//! Which cells are active: a narrow band outside of the body and a thin layer inside.
//!
//! Cells are sorted out in blocks of 8, 4, 2 and 1 to an edge. One distance at a block's
//! centre bounds the distances in the whole block, and one winding number settles the sign
//! of a block that the surface does not enter, so few cells are asked one by one.

use rayon::prelude::*;

use super::boundary::is_inside;
use super::domain::{Coordinates, Kind, Lattice};
use crate::geometry::Surface;
use crate::model::Vec3;

/// Depth of the layer of active cells inside of the body, in cells.
pub const DEPTH: f64 = 1.5;
/// Half a cell's diagonal, in cells: nearer than this the surface may cut the cell. The
/// excess is for rounding.
const CUT: f64 = 0.866_025_403_784_438_6 * (1.0 + 1e-9);
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
}

struct Query<'a> {
    surface: &'a Surface,
    lattice: Lattice,
    band: f64,
}

/// The cells with a centre between [`DEPTH`] cells inside and `band` [m] outside of the
/// surface, in lexicographic order. The surface's bounding box is `lo`, `hi` [m].
pub fn narrow_band(surface: &Surface, lattice: Lattice, band: f64, lo: &Vec3, hi: &Vec3) -> Vec<Active> {
    let query = Query { surface, lattice, band };
    let block = |p: Vec3| lattice.cell_of(&p).map(|c| c.div_euclid(BLOCK));
    let (first, last) = (block(lo.add_scalar(-band)), block(hi.add_scalar(band)));
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
    /// Sorts out the block of `size` cells an edge at `lo`; `inside` is its sign where known.
    fn sort_out(&self, lo: Coordinates, size: i32, inside: Option<bool>, out: &mut Vec<Active>) {
        let h = self.lattice.cell;
        let half = 0.5 * h * f64::from(size - 1);
        let centre = self.lattice.centre(lo) + Vec3::repeat(half);
        let reach = half * 3.0_f64.sqrt();
        let Some(distance) = self.surface.closest_within(&centre, self.band + reach).map(|c| c.distance)
        else {
            return; // beyond the band, or deep inside
        };
        if size == 1 {
            return self.single(lo, &centre, distance, inside, out);
        }
        // The surface does not enter a block that is farther from it than the block reaches.
        let sign = inside.or_else(|| (distance > reach).then(|| is_inside(self.surface, &centre)));
        if distance > reach + DEPTH * h {
            if sign == Some(true) {
                return;
            }
            if distance + reach < self.band {
                for_block(lo, size, 1, |cell| out.push(Active { cell, kind: Kind::Open, cut: false }));
                return;
            }
        }
        for_block(lo, size, size / 2, |lo| self.sort_out(lo, size / 2, sign, out));
    }

    fn single(
        &self,
        cell: Coordinates,
        centre: &Vec3,
        distance: f64,
        inside: Option<bool>,
        out: &mut Vec<Active>,
    ) {
        let h = self.lattice.cell;
        if distance <= CUT * h {
            out.push(Active { cell, kind: Kind::Open, cut: true });
            return;
        }
        let inside = inside.unwrap_or_else(|| is_inside(self.surface, centre));
        if inside && distance < DEPTH * h {
            out.push(Active { cell, kind: Kind::Deep, cut: false });
        } else if !inside && distance < self.band {
            out.push(Active { cell, kind: Kind::Open, cut: false });
        }
    }
}

/// Calls `f` for the corners of the parts of `step` cells an edge that make up a block.
fn for_block(lo: Coordinates, size: i32, step: i32, mut f: impl FnMut(Coordinates)) {
    for i in (0..size).step_by(step as usize) {
        for j in (0..size).step_by(step as usize) {
            for k in (0..size).step_by(step as usize) {
                f([lo[0] + i, lo[1] + j, lo[2] + k]);
            }
        }
    }
}
