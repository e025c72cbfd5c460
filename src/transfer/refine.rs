//! Finer cells near the skin, over the cells of the band.
//!
//! What bodies of one topology want from place to place varies over a few centimetres: a navel, a
//! fold, points that slid along the skin. Cells of 2 cm miss much of that, and so does cloth a
//! centimetre away. Cells half the size in a thin band see it. Both meet as an overlapping Schwarz
//! method [Schwarz 1870; Smith, Bjorstad, Gropp 1996]: the fine field takes the coarse one's
//! displacement at its rim, the coarse one is solved again outside with the fine one's held
//! inside, and the fine one ends with what that gives. One exchange is enough: with the overlap
//! of a coarse cell or more a second one moves no node by 0.2 mm.
//!
//! The lattices have their origin in common and the ratio is a whole number, so the rim's faces
//! lie in faces of coarse cells or inside them, where a trilinear field is bilinear: the
//! composite is continuous.

use super::activity::{Active, narrow_band};
use super::domain::{Coordinates, Domain, Kind, Lattice, NONE, TooLarge};
use super::field::Field;
use crate::geometry::Surface;
use crate::model::Vec3;

/// The finer cells near a surface, over those of a coarse domain.
pub(super) struct Overlay {
    ratio: i32,
    pub domain: Domain,
    pub active: Vec<Active>,
    /// Nodes at the outer edge, which take the coarse field's displacement.
    pub rim: Vec<bool>,
}

impl Overlay {
    /// Cells `ratio` times smaller than those of `coarse`, up to `band` [m] outside of `surface`.
    pub fn new(coarse: &Domain, surface: &Surface, ratio: i32, band: f64) -> Result<Overlay, TooLarge> {
        let cell = coarse.lattice.cell / f64::from(ratio);
        let lattice = Lattice { origin: coarse.lattice.origin, cell };
        let (lo, hi) = surface.mesh().bounds().expect("the coarse domain has one");
        Domain::check_size((hi - lo).add_scalar(2.0 * band) / cell)?;
        let mut active = narrow_band(surface, lattice, band, &lo, &hi);
        active.retain(|a| coarse.find_cell(parent(a.cell, ratio)).is_some());
        let domain = Domain::new(lattice, active.iter().map(|a| (a.cell, a.kind)).collect())?;
        let rim = rim(&domain, &active);
        Ok(Overlay { ratio, domain, active, rim })
    }

    /// The coarse field's displacement at every node [m].
    pub fn interpolate(&self, coarse: &Field) -> Vec<Vec3> {
        let at = |(node, cells): (&Coordinates, &[u32; 8])| {
            let cell = cells.iter().find(|&&cell| cell != NONE).expect("a node of a cell");
            let parent = parent(self.domain.cells[*cell as usize], self.ratio);
            let local =
                std::array::from_fn(|d| f64::from(node[d]) / f64::from(self.ratio) - f64::from(parent[d]));
            let index = coarse.domain.find_cell(parent).expect("cells without a parent were left out");
            coarse.domain.interpolate((index as u32, local), &coarse.displacement)
        };
        self.domain.nodes.iter().zip(&self.domain.node_cells).map(at).collect()
    }

    /// The coarse nodes that take the displacement of the fine field `u`, which is written to
    /// `displacement`: those a coarse cell or more within the rim, and all of the body's inside.
    pub fn hold(&self, coarse: &Domain, u: &[Vec3], displacement: &mut [Vec3]) -> Vec<bool> {
        let hold = |(i, place): (usize, &mut Vec3)| {
            let deep = |&cell: &u32| cell != NONE && coarse.kinds[cell as usize] == Kind::Deep;
            let Some(j) = self.domain.find_node(coarse.nodes[i].map(|c| c * self.ratio)) else {
                return coarse.node_cells[i].iter().any(deep);
            };
            let held = !self.rim[j] && (self.near_skin(j) || self.is_covered(coarse.nodes[i]));
            if held {
                *place = u[j];
            }
            held
        };
        displacement.iter_mut().enumerate().map(hold).collect()
    }

    /// Whether the skin may cut a cell around fine node `j`, or lies outside of one.
    fn near_skin(&self, j: usize) -> bool {
        let near = |cell: usize| self.active[cell].cut || self.active[cell].kind == Kind::Deep;
        self.domain.node_cells[j].iter().any(|&cell| cell != NONE && near(cell as usize))
    }

    /// Whether fine cells fill the eight coarse cells around a coarse node.
    fn is_covered(&self, node: Coordinates) -> bool {
        let span = 2 * self.ratio;
        let fine = |k: i32| {
            let offset = [k / span / span, k / span % span, k % span];
            self.domain.find_cell(std::array::from_fn(|d| (node[d] - 1) * self.ratio + offset[d]))
        };
        (0..span.pow(3)).all(|k| fine(k).is_some())
    }
}

/// The coarse cell that a fine one lies in.
fn parent(cell: Coordinates, ratio: i32) -> Coordinates {
    cell.map(|c| c.div_euclid(ratio))
}

/// Nodes at the outer edge of a band: next to a missing cell, and to none near the surface.
pub(super) fn rim(domain: &Domain, active: &[Active]) -> Vec<bool> {
    let far =
        |cell: u32| cell == NONE || (domain.kinds[cell as usize] == Kind::Open && !active[cell as usize].cut);
    let rim = |cells: &[u32; 8]| cells.contains(&NONE) && cells.iter().all(|&cell| far(cell));
    domain.node_cells.iter().map(rim).collect()
}
