//! What stands in the cells of a grid: an element matrix, and the boundary's mass in some.
//!
//! Cells that are alike share their element matrix: on the finest grid there are two, on a
//! coarser one as many as there are kinds of cells made of active, deep and missing ones
//! ([`super::multigrid::coarsen`]).

use super::boundary::{Boundary, Mass};
use super::domain::{Domain, Kind};
use super::element::{self, ElementMatrix};

/// The terms of the system on one grid.
#[derive(Clone, Debug)]
pub struct Terms {
    /// Distinct element matrices.
    pub elements: Vec<ElementMatrix>,
    /// The matrix of each cell.
    pub element_of_cell: Vec<u32>,
    /// Cells with a boundary mass, ascending, and the mass.
    pub masses: Vec<(u32, Mass)>,
}

impl Terms {
    /// On the finest grid, with viscosity `nu` and compliance `gamma`.
    pub fn new(domain: &Domain, nu: f64, gamma: f64, boundary: &Boundary) -> Terms {
        let h = domain.lattice.cell;
        let deep = element::viscous(h, nu);
        let open = deep + element::schur(h, gamma);
        let element = |kind: &Kind| match kind {
            Kind::Deep => 0,
            Kind::Open => 1,
        };
        Terms {
            elements: vec![deep, open],
            element_of_cell: domain.kinds.iter().map(element).collect(),
            masses: boundary.masses.clone(),
        }
    }
}
