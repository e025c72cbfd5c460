//! The sparse grid: active cells of a regular lattice, and their nodes.

use serde::{Deserialize, Serialize};

use super::element;
use crate::model::Vec3;

/// Marks the absence of a cell or node.
pub const NONE: u32 = u32::MAX;

/// Cells that a domain's bounding box may hold: what a body of absurd scale would exceed.
const BOX_LIMIT: usize = 1 << 27;

/// A cell that counts in full, see [`Domain::shares`].
pub const WHOLE: u8 = 8;

/// Coordinates of a cell or node on the lattice.
pub type Coordinates = [i32; 3];

/// An endless regular lattice of cubes.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Lattice {
    /// Lower corner of cell (0, 0, 0) [m].
    pub origin: Vec3,
    /// Side of a cell [m].
    pub cell: f64,
}

impl Lattice {
    /// The cell that holds `p`.
    pub fn cell_of(&self, p: &Vec3) -> Coordinates {
        let t = (p - self.origin) / self.cell;
        [t.x.floor() as i32, t.y.floor() as i32, t.z.floor() as i32]
    }

    /// A cell's centre [m].
    pub fn centre(&self, cell: Coordinates) -> Vec3 {
        self.origin + Vec3::from(cell.map(|c| f64::from(c) + 0.5)) * self.cell
    }

    /// The place of `p` in `cell`, in units of its side.
    pub fn local(&self, cell: Coordinates, p: &Vec3) -> [f64; 3] {
        let t = (p - self.origin) / self.cell;
        std::array::from_fn(|d| (t[d] - f64::from(cell[d])).clamp(0.0, 1.0))
    }
}

/// What a cell's volume does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Whole inside the body: no volume term, so that a shrinking body is not resisted.
    Deep,
    /// Outside of the body or cut by its surface.
    Open,
}

/// Active cells with their nodes; both in lexicographic order of their coordinates.
#[derive(Clone, Debug)]
pub struct Domain {
    /// The lattice.
    pub lattice: Lattice,
    /// Coordinates of each cell.
    pub cells: Vec<Coordinates>,
    /// Kind of each cell.
    pub kinds: Vec<Kind>,
    /// How much the stiffness of each cell counts, in parts of [`WHOLE`].
    pub shares: Vec<u8>,
    /// The eight nodes of each cell, in the order of [`element::corner`].
    pub cell_nodes: Vec<[u32; 8]>,
    /// Coordinates of each node (that of the cell above it).
    pub nodes: Vec<Coordinates>,
    /// The eight cells around each node, [`NONE`] where inactive; in cell `o` the node is
    /// local node `7 - o`.
    pub node_cells: Vec<[u32; 8]>,
    lo: Coordinates,
    dims: [usize; 3],
    cell_index: Vec<u32>,
    node_index: Vec<u32>,
}

/// A domain's box would not fit in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooLarge {
    /// Size of the box in cells.
    pub cells: [f64; 3],
}

impl Domain {
    /// The domain of the given cells, in any order.
    ///
    /// # Errors
    /// The box around the cells is absurdly large.
    pub fn new(lattice: Lattice, mut active: Vec<(Coordinates, Kind)>) -> Result<Domain, TooLarge> {
        active.sort_unstable();
        active.dedup_by_key(|cell| cell.0);
        let (lo, dims) = bounding_box(active.iter().map(|cell| cell.0))?;
        let size: usize = dims.iter().product();
        let mut domain = Domain {
            lattice,
            cells: active.iter().map(|cell| cell.0).collect(),
            kinds: active.iter().map(|cell| cell.1).collect(),
            shares: vec![WHOLE; active.len()],
            cell_nodes: Vec::with_capacity(active.len()),
            nodes: Vec::new(),
            node_cells: Vec::new(),
            lo,
            dims,
            cell_index: vec![NONE; size],
            node_index: vec![NONE; size],
        };
        domain.number();
        Ok(domain)
    }

    /// Refuses a box of so many cells along each axis before anything is made for it.
    ///
    /// # Errors
    /// The box is absurdly large.
    pub fn check_size(extent: Vec3) -> Result<(), TooLarge> {
        if extent.product() > BOX_LIMIT as f64 || extent.max() > f64::from(i32::MAX / 2) {
            return Err(TooLarge { cells: extent.into() });
        }
        Ok(())
    }

    /// Memory that it takes, roughly [bytes].
    pub fn bytes(&self) -> usize {
        let (cell, node) = (size_of::<(Coordinates, Kind, [u32; 8])>(), size_of::<(Coordinates, [u32; 8])>());
        cell * self.cells.len()
            + node * self.nodes.len()
            + 4 * (self.cell_index.len() + self.node_index.len())
    }

    fn number(&mut self) {
        for (i, &cell) in self.cells.iter().enumerate() {
            let slot = self.slot(cell).expect("the box holds every cell");
            self.cell_index[slot] = i as u32;
            for a in 0..8 {
                let node = slot + self.step(element::corner(a));
                self.node_index[node] = 0;
            }
        }
        let [_, ny, nz] = self.dims;
        for slot in 0..self.node_index.len() {
            if self.node_index[slot] != NONE {
                self.node_index[slot] = self.nodes.len() as u32;
                let at = [slot / (ny * nz), slot / nz % ny, slot % nz];
                self.nodes.push(std::array::from_fn(|d| self.lo[d] + at[d] as i32));
            }
        }
        self.node_cells = vec![[NONE; 8]; self.nodes.len()];
        for (i, &cell) in self.cells.iter().enumerate() {
            let slot = self.slot(cell).expect("the box holds every cell");
            let nodes: [u32; 8] =
                std::array::from_fn(|a| self.node_index[slot + self.step(element::corner(a))]);
            for (a, &node) in nodes.iter().enumerate() {
                self.node_cells[node as usize][7 - a] = i as u32;
            }
            self.cell_nodes.push(nodes);
        }
    }

    fn step(&self, c: [usize; 3]) -> usize {
        (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]
    }

    fn slot(&self, at: Coordinates) -> Option<usize> {
        let mut c = [0; 3];
        for d in 0..3 {
            let offset = i64::from(at[d]) - i64::from(self.lo[d]);
            if offset < 0 || offset >= self.dims[d] as i64 {
                return None;
            }
            c[d] = offset as usize;
        }
        Some(self.step(c))
    }

    /// The active cell at `at`.
    pub fn find_cell(&self, at: Coordinates) -> Option<usize> {
        self.slot(at).map(|s| self.cell_index[s]).filter(|&i| i != NONE).map(|i| i as usize)
    }

    /// The node at `at`.
    pub fn find_node(&self, at: Coordinates) -> Option<usize> {
        self.slot(at).map(|s| self.node_index[s]).filter(|&i| i != NONE).map(|i| i as usize)
    }

    /// The 27 nodes around each node, itself in the middle, z fastest; itself where there is
    /// none (its block is zero then).
    pub fn neighbours(&self) -> Vec<[u32; 27]> {
        let around = |i: usize| -> [u32; 27] {
            let slot = self.slot(self.nodes[i]).expect("the box holds every node");
            let corner = slot - self.step([1, 1, 1]);
            std::array::from_fn(|k| {
                let found = self.node_index[corner + self.step([k / 9, k / 3 % 3, k % 3])];
                if found == NONE { i as u32 } else { found }
            })
        };
        (0..self.nodes.len()).map(around).collect()
    }

    /// The nodal values `u` at a place in a cell.
    pub fn interpolate(&self, (cell, local): (u32, [f64; 3]), u: &[Vec3]) -> Vec3 {
        let nodes = &self.cell_nodes[cell as usize];
        nodes.iter().zip(element::shape(local)).map(|(&node, shape)| u[node as usize] * shape).sum()
    }

    /// The active cell that holds `p`, and the place of `p` in it.
    pub fn locate(&self, p: &Vec3) -> Option<(usize, [f64; 3])> {
        let at = self.lattice.cell_of(p);
        self.find_cell(at).map(|cell| (cell, self.lattice.local(at, p)))
    }
}

/// The box around the cells with a margin of one below and two above (nodes included).
fn bounding_box(cells: impl Iterator<Item = Coordinates>) -> Result<(Coordinates, [usize; 3]), TooLarge> {
    let (mut lo, mut hi) = ([i32::MAX; 3], [i32::MIN; 3]);
    for cell in cells {
        for d in 0..3 {
            lo[d] = lo[d].min(cell[d]);
            hi[d] = hi[d].max(cell[d]);
        }
    }
    if lo[0] > hi[0] {
        return Ok(([0; 3], [0; 3]));
    }
    let extent: [f64; 3] = std::array::from_fn(|d| f64::from(hi[d]) - f64::from(lo[d]) + 4.0);
    Domain::check_size(extent.into())?;
    Ok((lo.map(|c| c - 1), extent.map(|e| e as usize)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Lattice {
        Lattice { origin: Vec3::new(-0.3, 0.2, 0.1), cell: 0.1 }
    }

    #[test]
    fn nodes_and_cells_point_at_each_other() {
        let cells = [[0, 0, 0], [0, 0, 1], [1, 0, 1], [5, -3, 2]];
        let domain = Domain::new(lattice(), cells.map(|c| (c, Kind::Open)).to_vec()).unwrap();
        assert_eq!(domain.nodes.len(), 8 + 4 + 4 + 8);
        for (i, nodes) in domain.cell_nodes.iter().enumerate() {
            for (a, &node) in nodes.iter().enumerate() {
                let corner = element::corner(a).map(|c| c as i32);
                let expected: Coordinates = std::array::from_fn(|d| domain.cells[i][d] + corner[d]);
                assert_eq!(domain.nodes[node as usize], expected);
                assert_eq!(domain.node_cells[node as usize][7 - a], i as u32);
            }
        }
        for (i, around) in domain.neighbours().iter().enumerate() {
            for (k, &j) in around.iter().enumerate() {
                let offset = [k / 9, k / 3 % 3, k % 3].map(|o| o as i32 - 1);
                let at: Coordinates = std::array::from_fn(|d| domain.nodes[i][d] + offset[d]);
                assert_eq!(domain.find_node(at).unwrap_or(i), j as usize);
            }
        }
    }

    #[test]
    fn points_are_found_in_their_cell() {
        let domain = Domain::new(lattice(), vec![([2, 1, 0], Kind::Deep)]).unwrap();
        let (cell, local) = domain.locate(&Vec3::new(-0.07, 0.35, 0.11)).unwrap();
        assert_eq!(cell, 0);
        for (found, expected) in local.iter().zip([0.3, 0.5, 0.1]) {
            assert!((found - expected).abs() < 1e-12);
        }
        assert!(domain.locate(&Vec3::new(-0.11, 0.35, 0.11)).is_none());
        assert!(domain.locate(&Vec3::new(1e30, 0.0, 0.0)).is_none());
    }

    #[test]
    fn an_absurd_box_is_refused() {
        let cells = vec![([0, 0, 0], Kind::Open), ([1 << 20, 1 << 20, 1 << 20], Kind::Open)];
        assert!(Domain::new(lattice(), cells).is_err());
    }
}
