//! Finer cells near the skin, over the cells of the band.
//!
//! What bodies of one topology want from place to place varies over a few centimetres: a navel, a
//! fold, points that slid along the skin. Cells of 2 cm miss much of that, and so does cloth a
//! centimetre away. Cells a third of the size in a thin band see it. Both meet as an overlapping Schwarz
//! method [Schwarz 1870; Smith, Bjorstad, Gropp 1996]: the fine field takes the coarse one's
//! displacement at its rim, the coarse one is solved again outside with the fine one's held
//! inside, and the fine one ends with what that gives. All along the skin the coarse nodes are held:
//! one that was not would ask its neighbours for what the coarse cells make of the skin. One
//! exchange is enough: two more bring cloth no nearer to a fine solution than by 0.05 mm.
//!
//! The lattices have their origin in common and the ratio is a whole number, so the rim's faces
//! lie in faces of coarse cells or inside them, where a trilinear field is bilinear: the
//! composite is continuous.

use super::activity::{self, Active, Band, narrow_band};
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
        let mut active = narrow_band(surface, lattice, Band { width: band, fade: 0.0 }, &lo, &hi);
        active.retain(|a| coarse.find_cell(parent(a.cell, ratio)).is_some());
        let domain = activity::domain(lattice, &active)?;
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
    /// `displacement`: those of coarse cells that the skin may cut, those a coarse cell or more
    /// within the rim, and all of the body's inside.
    pub fn hold(&self, coarse: &Domain, u: &[Vec3], displacement: &mut [Vec3]) -> Vec<bool> {
        let at_skin = self.at_skin(coarse);
        let any = |flags: &[bool], i: usize| {
            coarse.node_cells[i].iter().any(|&cell| cell != NONE && flags[cell as usize])
        };
        let deep: Vec<bool> = coarse.kinds.iter().map(|&kind| kind == Kind::Deep).collect();
        let hold = |(i, place): (usize, &mut Vec3)| {
            let Some(j) = self.domain.find_node(coarse.nodes[i].map(|c| c * self.ratio)) else {
                return any(&deep, i);
            };
            let held = !self.rim[j] && (any(&at_skin, i) || self.is_covered(coarse.nodes[i]));
            if held {
                *place = u[j];
            }
            held
        };
        displacement.iter_mut().enumerate().map(hold).collect()
    }

    /// Whether each coarse cell holds a fine one that the skin may cut or that lies within it.
    fn at_skin(&self, coarse: &Domain) -> Vec<bool> {
        let mut at_skin = vec![false; coarse.cells.len()];
        for active in self.active.iter().filter(|active| active.cut || active.kind == Kind::Deep) {
            if let Some(cell) = coarse.find_cell(parent(active.cell, self.ratio)) {
                at_skin[cell] = true;
            }
        }
        at_skin
    }

    /// Whether no node of the rim is nearer to a coarse node than a coarse cell.
    fn is_covered(&self, node: Coordinates) -> bool {
        let span = 2 * self.ratio - 1;
        let on_rim = |k: i32| {
            let offset = [k / span / span, k / span % span, k % span].map(|o| o - self.ratio + 1);
            let near = offset.iter().map(|o| o * o).sum::<i32>() < self.ratio * self.ratio;
            let at = std::array::from_fn(|d| node[d] * self.ratio + offset[d]);
            near && self.domain.find_node(at).is_some_and(|j| self.rim[j])
        };
        !(0..span.pow(3)).any(on_rim)
    }
}

/// The coarse cell that a fine one lies in.
fn parent(cell: Coordinates, ratio: i32) -> Coordinates {
    cell.map(|c| c.div_euclid(ratio))
}

/// Nodes at the outer edge of a band: next to a missing cell, and to none near the surface.
fn rim(domain: &Domain, active: &[Active]) -> Vec<bool> {
    let far =
        |cell: u32| cell == NONE || (domain.kinds[cell as usize] == Kind::Open && !active[cell as usize].cut);
    let rim = |cells: &[u32; 8]| cells.contains(&NONE) && cells.iter().all(|&cell| far(cell));
    domain.node_cells.iter().map(rim).collect()
}
