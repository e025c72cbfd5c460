//! What stands in the cells of a grid: an element matrix, and the boundary's mass in some.
//!
//! The flow is one of the space outside of the body. What lies inside carries the field on to where
//! the moved skin is looked up, and should not resist: cells deep inside and the inner part of cut
//! cells keep [`INSIDE`] of the viscosity and nothing of the volume term (the finite cell method
//! [Parvizian, Duester, Rank 2007]). Where the band fades, both go to nothing.
//!
//! Cells that are alike share their element matrix: on the finest grid there is one for each share
//! that a cell may have, on a coarser one as many as there are kinds of cells made of them
//! ([`super::multigrid::coarsen`]).

use super::boundary::{Boundary, Mass};
use super::domain::{Domain, Kind, WHOLE};
use super::element::{self, ElementMatrix};

/// Share of the viscosity that is left inside of the body. With all of it cloth within 2 cm of the
/// skin is twice as far from the field of fine cells; with 0.03 the solves take a tenth longer for
/// little.
pub const INSIDE: f64 = 0.1;

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
        let (viscous, schur) = (element::viscous(h, nu), element::schur(h, gamma));
        let shares = (0..=WHOLE).map(|k| f64::from(k) / f64::from(WHOLE));
        let cut = shares.clone().map(|share| viscous * inside(share) + schur * share);
        let faded = shares.map(|share| (viscous + schur) * share);
        Terms {
            elements: cut.chain(faded).collect(),
            element_of_cell: Shares::new(domain, boundary).elements(),
            masses: boundary.masses.clone(),
        }
    }
}

/// The viscosity of a cell of which `outside` lies outside of the body.
pub fn inside(outside: f64) -> f64 {
    INSIDE + (1.0 - INSIDE) * outside
}

/// How much of each cell of the finest grid counts, in parts of [`WHOLE`].
#[derive(Clone, Debug)]
pub struct Shares {
    /// The volume term's.
    pub volume: Vec<u8>,
    /// Whether it is the body that takes the rest, and the band's end otherwise.
    pub cut: Vec<bool>,
}

impl Shares {
    /// Of cells whole inside, cut and outside.
    pub fn new(domain: &Domain, boundary: &Boundary) -> Shares {
        let deep: Vec<bool> = domain.kinds.iter().map(|&kind| kind == Kind::Deep).collect();
        let volume = domain.shares.iter().zip(&deep).map(|(&share, &deep)| if deep { 0 } else { share });
        let mut shares = Shares { volume: volume.collect(), cut: deep };
        for &(cell, outside) in &boundary.outside {
            shares.volume[cell as usize] = outside;
            shares.cut[cell as usize] = true;
        }
        shares
    }

    /// The share of a cell's viscosity.
    pub fn viscosity(&self, cell: usize) -> f64 {
        let share = f64::from(self.volume[cell]) / f64::from(WHOLE);
        if self.cut[cell] { inside(share) } else { share }
    }

    fn elements(&self) -> Vec<u32> {
        let of_cell =
            |(&share, &cut): (&u8, &bool)| if cut { 0 } else { u32::from(WHOLE) + 1 } + u32::from(share);
        self.volume.iter().zip(&self.cut).map(of_cell).collect()
    }
}
