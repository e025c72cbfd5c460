//! The weak boundary condition, by closest-point quadrature in the cells that the body cuts.
//!
//! Every cut cell has `q^3` points, each worth its share `w` of the cell's volume. Inside the
//! body both the displacement and the test function are taken at the point itself, outside
//! at its projection onto the surface; the value asked for is the surface's at the closest
//! point. With the penalty `beta` this adds to the system
//!
//! ```text
//! mass   M[a,b] = beta sum w phi_a(x) phi_b(x)
//! load   f[a]   = beta sum w phi_a(x) u_body(closest(x))
//! ```

use rayon::prelude::*;

use super::domain::{Domain, NONE};
use super::element;
use super::stencil::{SLOTS, slot};
use crate::geometry::Surface;
use crate::model::Vec3;

/// Winding number from which a point counts as inside.
pub const INSIDE: f64 = 0.5;

/// The boundary condition's part of the system.
#[derive(Clone, Debug, Default)]
pub struct Boundary {
    /// Row of `mass` that a node has, [`NONE`] where it has none; empty without a boundary.
    pub row_of_node: Vec<u32>,
    /// Couplings of a node to its 27 neighbours.
    pub mass: Vec<[f64; SLOTS]>,
    /// Load on each node, shape `[nodes, 3]`; empty without a boundary.
    pub load: Vec<Vec3>,
}

/// A quadrature point: where it is evaluated, and the displacement asked for.
struct Point {
    cell: usize,
    local: [f64; 3],
    displacement: Vec3,
}

/// Whether `p` is inside of the surface, whichever way its triangles turn.
pub fn is_inside(surface: &Surface, p: &Vec3) -> bool {
    surface.winding_number(p).abs() > INSIDE
}

impl Boundary {
    /// Integrates over the `cut` cells (indices into the domain's).
    ///
    /// `displacement` is asked for at the surface's vertices [m]; `beta` is the penalty,
    /// `quadrature` the number of points along an axis.
    pub fn new(
        domain: &Domain,
        surface: &Surface,
        displacement: &[Vec3],
        cut: &[u32],
        beta: f64,
        quadrature: usize,
    ) -> Boundary {
        let points: Vec<Vec<Point>> = cut
            .par_iter()
            .map(|&cell| cell_points(domain, surface, displacement, cell as usize, quadrature))
            .collect();
        let weight = beta * (domain.lattice.cell / quadrature as f64).powi(3);
        let mut boundary = Boundary {
            row_of_node: vec![NONE; domain.nodes.len()],
            mass: Vec::new(),
            load: vec![Vec3::zeros(); domain.nodes.len()],
        };
        for point in points.iter().flatten() {
            boundary.add(domain, point, weight);
        }
        boundary
    }

    fn add(&mut self, domain: &Domain, point: &Point, weight: f64) {
        let shape = element::shape(point.local);
        let nodes = &domain.cell_nodes[point.cell];
        for a in 0..8 {
            let node = nodes[a] as usize;
            if self.row_of_node[node] == NONE {
                self.row_of_node[node] = self.mass.len() as u32;
                self.mass.push([0.0; SLOTS]);
            }
            let row = &mut self.mass[self.row_of_node[node] as usize];
            for b in 0..8 {
                row[slot(a, b)] += weight * shape[a] * shape[b];
            }
            self.load[node] += point.displacement * (weight * shape[a]);
        }
    }
}

fn cell_points(
    domain: &Domain,
    surface: &Surface,
    displacement: &[Vec3],
    cell: usize,
    quadrature: usize,
) -> Vec<Point> {
    let h = domain.lattice.cell;
    let corner = domain.lattice.centre(domain.cells[cell]) - Vec3::repeat(0.5 * h);
    let along = |i: usize| (i as f64 + 0.5) * h / quadrature as f64;
    let mut known = Vec::with_capacity(quadrature.pow(3));
    (0..quadrature.pow(3))
        .filter_map(|k| {
            let (i, j, l) = (k / (quadrature * quadrature), k / quadrature % quadrature, k % quadrature);
            let p = corner + Vec3::new(along(i), along(j), along(l));
            let closest = surface.closest(&p);
            let triangle = surface.mesh().triangles[closest.triangle as usize];
            let wanted: Vec3 =
                (0..3).map(|c| displacement[triangle[c] as usize] * closest.barycentric[c]).sum();
            let inside = side(surface, &p, closest.distance, &mut known);
            let at = if inside { p } else { closest.point };
            // A surface point lies in a cell that the surface cuts, and those are active.
            let (cell, local) = domain.locate(&at)?;
            Some(Point { cell, local, displacement: wanted })
        })
        .collect()
}

/// A point whose side is known: no surface within `distance` of it.
struct Known {
    point: Vec3,
    distance: f64,
    inside: bool,
}

/// Whether `p`, `distance` away from the surface, is inside. Two points share their side
/// where the surface does not come between them: that saves half of the winding numbers.
fn side(surface: &Surface, p: &Vec3, distance: f64, known: &mut Vec<Known>) -> bool {
    let shared = known.iter().find(|k| (k.point - p).norm() < k.distance.max(distance));
    let inside = shared.map_or_else(|| is_inside(surface, p), |k| k.inside);
    known.push(Known { point: *p, distance, inside });
    inside
}
