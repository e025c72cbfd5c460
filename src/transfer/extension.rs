//! Cells beyond the narrow band, for points that lie outside of it.
//!
//! The band depends on the body pair alone. A point outside of it (a wide hem, a hood; also
//! a tongue, deep inside of the body) gets cells of its own: those along the straight line
//! to its closest point of the body, with a ring of [`RING`] around, so that they hang together
//! with the band. They are solved after the band, whose nodes keep their displacement: what
//! is there does not change, and one garment's extension cannot alter another's.
//!
//! Extensions have no volume term: nothing is pinched so far from the body, and thin strands
//! of cells, free on most sides, buckle under the pressure of a strong compression (trousers
//! between the legs of a child's body turned inside out).

use std::collections::BTreeSet;

use super::activity::for_block;
use super::boundary::Boundary;
use super::domain::{Coordinates, Domain, Kind};
use super::field::{Field, InnerInfo, Problem};
use super::{Error, Params};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::Vec3;

/// Width of the ring of cells around a line [m]: what is solved does not shrink with the cells.
const RING: f64 = 0.02;

/// The field beyond the band, for those of `points` that the band does not hold; `None` if
/// it holds all of them (then the body's `surface` is not asked for).
///
/// # Errors
/// A point farther from the body than `reach` [m], or a device's failure.
pub fn extend<'a>(
    device: &Device,
    params: &Params,
    band: &Field,
    surface: impl Fn() -> &'a Surface,
    points: &[Vec3],
    reach: f64,
) -> Result<Option<(Field, InnerInfo)>, Error> {
    let lines = lines_to_body(&band.domain, surface, points, reach)?;
    if lines.is_empty() {
        return Ok(None);
    }
    let lattice = band.domain.lattice;
    let ring = (RING / lattice.cell).ceil() as i32;
    let mut cells = BTreeSet::new();
    for &[i, j, k] in &lines {
        for_block([i - ring, j - ring, k - ring], 2 * ring + 1, 1, |cell| {
            cells.insert(cell);
        });
    }
    let active = cells
        .into_iter()
        .filter(|&cell| band.domain.find_cell(cell).is_none())
        .map(|cell| (cell, Kind::Deep))
        .collect();
    let domain = Domain::new(lattice, active)?;
    let held: Vec<Option<usize>> = domain.nodes.iter().map(|&node| band.domain.find_node(node)).collect();
    let fixed: Vec<bool> = held.iter().map(Option::is_some).collect();
    let mut displacement: Vec<Vec3> =
        held.iter().map(|node| node.map_or_else(Vec3::zeros, |n| band.displacement[n])).collect();
    let problem = Problem::new(device, params, &domain, Boundary::default(), &fixed, &displacement)?;
    let info = problem.solve(&mut displacement)?;
    drop(problem);
    Ok(Some((Field { domain, displacement }, info)))
}

/// Cells outside of the band on the lines from points outside to the body.
fn lines_to_body<'a>(
    band: &Domain,
    surface: impl Fn() -> &'a Surface,
    points: &[Vec3],
    reach: f64,
) -> Result<BTreeSet<Coordinates>, Error> {
    let mut cells = BTreeSet::new();
    for (element, p) in points.iter().enumerate() {
        if band.locate(p).is_some() {
            continue;
        }
        let closest = surface().closest(p);
        if closest.distance > reach {
            return Err(Error::FarPoint { what: String::new(), element, distance: closest.distance, reach });
        }
        let steps = (2.0 * closest.distance / band.lattice.cell).ceil().max(1.0) as usize;
        for step in 0..=steps {
            let at = band.lattice.cell_of(&p.lerp(&closest.point, step as f64 / steps as f64));
            if band.find_cell(at).is_some() {
                break;
            }
            cells.insert(at);
        }
    }
    Ok(cells)
}
