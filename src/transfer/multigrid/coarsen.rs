//! The next coarser grid, and the system on it.
//!
//! A coarse cell is active if any of its eight children is. The system is the fine one seen
//! through trilinear interpolation `P` (Galerkin): in each coarse cell
//!
//! ```text
//! K_coarse = sum over children o of T_o^T K_o T_o,        T_o[a, b] = phi_b((o + corner a) / 2)
//! ```
//!
//! so that missing children, cells without a volume term and the boundary's mass count on
//! every grid with what they are worth. Cells with the same children share their matrix.

use std::collections::HashMap;

use crate::transfer::boundary::Mass;
use crate::transfer::domain::{Coordinates, Domain, Kind, Lattice, NONE};
use crate::transfer::element::{ElementMatrix, corner, shape};
use crate::transfer::terms::Terms;

/// Weights of a coarse cell's nodes at the nodes of one of its children.
type Interpolation = [[f64; 8]; 8];

/// The coarse cell or node at or below.
fn parent(at: Coordinates) -> Coordinates {
    at.map(|c| c.div_euclid(2))
}

/// Which of its parent's children a cell is.
fn octant(cell: Coordinates) -> usize {
    cell.iter().fold(0, |o, c| 2 * o + c.rem_euclid(2) as usize)
}

/// `T_o`; rows of the child's nodes in `fixed` (a bit each) are zero.
fn interpolation(o: usize, fixed: u8) -> Interpolation {
    std::array::from_fn(|a| {
        let (child, corner) = (corner(o), corner(a));
        let weights = shape(std::array::from_fn(|d| 0.5 * (child[d] + corner[d]) as f64));
        if fixed >> a & 1 == 1 { [0.0; 8] } else { weights }
    })
}

/// The grid of cells twice the size.
pub fn coarser(fine: &Domain) -> Domain {
    let lattice = Lattice { origin: fine.lattice.origin, cell: 2.0 * fine.lattice.cell };
    let cells = fine.cells.iter().map(|&cell| (parent(cell), Kind::Open)).collect();
    Domain::new(lattice, cells).expect("smaller than the fine one")
}

/// The system on the `coarse` grid; what `fixed` fine nodes (if any) add is left out.
pub fn galerkin(fine: &Domain, terms: &Terms, fixed: &[bool], coarse: &Domain) -> Terms {
    let mask = |cell: usize| -> u8 {
        let held = |node: u32| fixed.get(node as usize) == Some(&true);
        fine.cell_nodes[cell].iter().enumerate().fold(0, |m, (a, &node)| m | (u8::from(held(node)) << a))
    };
    let parents: Vec<usize> = fine
        .cells
        .iter()
        .map(|&cell| coarse.find_cell(parent(cell)).expect("made of the fine cells"))
        .collect();
    let mut children = vec![[(NONE, 0u8); 8]; coarse.cells.len()];
    for (cell, &above) in parents.iter().enumerate() {
        children[above][octant(fine.cells[cell])] = (terms.element_of_cell[cell], mask(cell));
    }
    let mut products = HashMap::new();
    let (mut elements, mut known) = (Vec::new(), HashMap::new());
    let element_of_cell = children
        .iter()
        .map(|children| {
            *known.entry(*children).or_insert_with(|| {
                elements.push(sum_of(children, terms, &mut products));
                elements.len() as u32 - 1
            })
        })
        .collect();
    let mut masses: HashMap<u32, Mass> = HashMap::new();
    for (cell, mass) in &terms.masses {
        let cell = *cell as usize;
        let t = interpolation(octant(fine.cells[cell]), mask(cell));
        add_mass(masses.entry(parents[cell] as u32).or_default(), mass, &t);
    }
    let mut masses: Vec<_> = masses.into_iter().collect();
    masses.sort_unstable_by_key(|(cell, _)| *cell);
    Terms { elements, element_of_cell, masses }
}

/// `T^T K T` by octant, element and mask.
type Products = HashMap<(usize, u32, u8), ElementMatrix>;

fn sum_of(children: &[(u32, u8); 8], terms: &Terms, products: &mut Products) -> ElementMatrix {
    let mut sum = ElementMatrix::zeros();
    for (o, &(element, fixed)) in children.iter().enumerate() {
        if element != NONE {
            sum += *products.entry((o, element, fixed)).or_insert_with(|| {
                let t = interpolation(o, fixed);
                let half = right_product(&terms.elements[element as usize], &t);
                right_product(&half.transpose(), &t)
            });
        }
    }
    sum
}

/// `K (T x I_3)`.
fn right_product(k: &ElementMatrix, t: &Interpolation) -> ElementMatrix {
    let mut product = ElementMatrix::zeros();
    for (a, row) in t.iter().enumerate() {
        for (b, &weight) in row.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            let mut columns = product.fixed_columns_mut::<3>(3 * b);
            columns += k.fixed_columns::<3>(3 * a) * weight;
        }
    }
    product
}

/// Adds `T^T M T` to the coarse cell's mass.
fn add_mass(coarse: &mut Mass, fine: &Mass, t: &Interpolation) {
    let mut half = Mass::default();
    for a in 0..8 {
        for c in 0..8 {
            for b in 0..8 {
                half[a][b] += fine[a][c] * t[c][b];
            }
        }
    }
    for c in 0..8 {
        for a in 0..8 {
            for b in 0..8 {
                coarse[a][b] += t[c][a] * half[c][b];
            }
        }
    }
}

/// How vectors go from one grid to the other.
#[derive(Clone, Debug)]
pub struct Links {
    /// For each coarse node the 27 fine nodes around it, [`NONE`] where missing or fixed.
    pub children: Vec<[u32; 27]>,
    /// For each fine node the coarse nodes that it lies between, each worth an eighth (one
    /// that it sits on stands there eight times); [`NONE`] for a fixed one.
    pub parents: Vec<[u32; 8]>,
}

/// The links between two grids.
pub fn links(fine: &Domain, fixed: &[bool], coarse: &Domain) -> Links {
    let free = |node: &usize| fixed.get(*node) != Some(&true);
    let children = coarse
        .nodes
        .iter()
        .map(|node| {
            std::array::from_fn(|k| {
                let offset = [k / 9, k / 3 % 3, k % 3];
                let at = std::array::from_fn(|d| 2 * node[d] + offset[d] as i32 - 1);
                fine.find_node(at).filter(free).map_or(NONE, |i| i as u32)
            })
        })
        .collect();
    let parents = (0..fine.nodes.len())
        .map(|i| {
            std::array::from_fn(|k| {
                let side = corner(k);
                let at = std::array::from_fn(|d| (fine.nodes[i][d] + side[d] as i32).div_euclid(2));
                let found = || coarse.find_node(at).expect("a coarse cell has all of its nodes");
                if free(&i) { found() as u32 } else { NONE }
            })
        })
        .collect();
    Links { children, parents }
}
