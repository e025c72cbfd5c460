//! The weak boundary condition, by closest-point quadrature in the cells that the body cuts.
//!
//! Every cut cell has `q^3` points, each worth its share `w` of the cell's volume. Displacement and
//! test function are taken at the point's projection `x` onto the surface, where the surface's
//! displacement is asked for. With the penalty `beta` this adds to the system
//!
//! ```text
//! mass   M[a,b] = beta sum w phi_a(x) phi_b(x)
//! load   f[a]   = beta sum w phi_a(x) u_body(x)
//! ```
//!
//! The paper takes points inside of the body where they are. That would ask for a displacement
//! without a slope in half of the cut cell, and what trilinear cells have on one side they have on
//! the other. For the same reason the part of a cut cell that lies inside keeps little of its
//! stiffness ([`super::terms`]).
//!
//! A penalty leaves a gap where the flow pulls. [`Boundary::augment`] asks for as much more as was
//! missed (the augmented Lagrangian method [Hestenes 1969; Powell 1969]).

use rayon::prelude::*;

use super::activity::Active;
use super::domain::{Domain, WHOLE};
use super::element;
use crate::geometry::{Patch, Surface};
use crate::model::Vec3;

/// Winding number from which a point counts as inside.
pub const INSIDE: f64 = 0.5;

/// The boundary's mass between the nodes of a cell, the same for each component.
pub type Mass = [[f64; 8]; 8];

/// The boundary condition's part of the system.
#[derive(Clone, Debug, Default)]
pub struct Boundary {
    /// Cells that hold quadrature points, ascending, and the mass of each.
    pub masses: Vec<(u32, Mass)>,
    /// Load on each node, shape `[nodes, 3]`; empty without a boundary.
    pub load: Vec<Vec3>,
    /// Cells that the surface may cut, ascending, and how much of each lies outside of the body,
    /// in parts of [`WHOLE`].
    pub outside: Vec<(u32, u8)>,
    /// Ascending by cell.
    points: Vec<Point>,
    /// What a point is worth.
    weight: f64,
}

/// A quadrature point.
#[derive(Clone, Debug)]
struct Point {
    /// The cell that it is evaluated in, and where in it.
    at: (u32, [f64; 3]),
    /// The surface's displacement there [m].
    wanted: Vec3,
    /// What is asked for [m].
    asked: Vec3,
}

/// Whether `p` is inside of the surface, whichever way its triangles turn.
pub fn is_inside(surface: &Surface, p: &Vec3) -> bool {
    surface.winding_number(p).abs() > INSIDE
}

impl Boundary {
    /// Integrates over the cells that the surface may cut; `active` holds the domain's cells.
    ///
    /// `displacement` is asked for at the surface's vertices [m]; `beta` is the penalty,
    /// `quadrature` the number of points along an axis.
    pub fn new(
        domain: &Domain,
        surface: &Surface,
        displacement: &[Vec3],
        active: &[Active],
        beta: f64,
        quadrature: usize,
    ) -> Boundary {
        let cells: Vec<(u32, u8, Vec<Point>)> = active
            .par_iter()
            .enumerate()
            .with_min_len(64)
            .filter(|(_, active)| active.cut)
            .map(|(cell, active)| {
                let (points, outside) = cell_points(domain, surface, displacement, active, quadrature);
                (cell as u32, outside, points)
            })
            .collect();
        let outside = cells.iter().map(|(cell, outside, _)| (*cell, *outside)).collect();
        let mut points: Vec<Point> = cells.into_iter().flat_map(|(_, _, points)| points).collect();
        points.sort_by_key(|point| point.at.0); // stable: sums keep their order
        let weight = beta * (domain.lattice.cell / quadrature as f64).powi(3);
        Boundary {
            masses: masses(&points, weight),
            load: load(domain, &points, weight),
            outside,
            points,
            weight,
        }
    }

    /// Asks at every point for as much more as the field `u` misses there.
    pub fn augment(&mut self, domain: &Domain, u: &[Vec3]) {
        self.points.par_iter_mut().for_each(|p| p.asked += p.wanted - domain.interpolate(p.at, u));
        self.load = load(domain, &self.points, self.weight);
    }
}

/// The mass of each cell that holds points, `weight` being the penalty times a point's share of
/// its cell.
fn masses(points: &[Point], weight: f64) -> Vec<(u32, Mass)> {
    let mut masses: Vec<(u32, Mass)> = Vec::new();
    for (cell, local) in points.iter().map(|point| point.at) {
        if masses.last().is_none_or(|last| last.0 != cell) {
            masses.push((cell, Mass::default()));
        }
        let mass = &mut masses.last_mut().expect("just pushed").1;
        let shape = element::shape(local);
        for (a, b) in (0..64).map(|k| (k / 8, k % 8)) {
            mass[a][b] += weight * shape[a] * shape[b];
        }
    }
    masses
}

/// The load on each node.
fn load(domain: &Domain, points: &[Point], weight: f64) -> Vec<Vec3> {
    let mut load = vec![Vec3::zeros(); domain.nodes.len()];
    for Point { at: (cell, local), asked, .. } in points {
        for (&node, shape) in domain.cell_nodes[*cell as usize].iter().zip(element::shape(*local)) {
            load[node as usize] += asked * (weight * shape);
        }
    }
    load
}

/// The points of a cell and how much of it lies outside, in parts of [`WHOLE`].
fn cell_points(
    domain: &Domain,
    surface: &Surface,
    displacement: &[Vec3],
    active: &Active,
    quadrature: usize,
) -> (Vec<Point>, u8) {
    let h = domain.lattice.cell;
    let centre = domain.lattice.centre(active.cell);
    let along = |i: usize| ((i as f64 + 0.5) / quadrature as f64 - 0.5) * h;
    let radius = along(0).abs() * 3.0_f64.sqrt();
    let patch = Patch::new(surface, &centre, active.distance, radius);
    let sides = Sides { surface, patch: &patch, centre, winding: active.winding };
    let (mut points, mut outside, all) = (Vec::new(), 0, quadrature.pow(3));
    for k in 0..all {
        let (i, j, l) = (k / (quadrature * quadrature), k / quadrature % quadrature, k % quadrature);
        let p = centre + Vec3::new(along(i), along(j), along(l));
        outside += usize::from(!sides.is_inside(&p));
        let closest = patch.closest(&p);
        let triangle = surface.mesh().triangles[closest.triangle as usize];
        let wanted: Vec3 = (0..3).map(|c| displacement[triangle[c] as usize] * closest.barycentric[c]).sum();
        // A surface point lies in a cell that the surface cuts, and those are active.
        if let Some((cell, local)) = domain.locate(&closest.point) {
            points.push(Point { at: (cell as u32, local), wanted, asked: wanted });
        }
    }
    (points, ((usize::from(WHOLE) * outside + all / 2) / all) as u8)
}

/// Tells the sides of points near a centre whose side is known: a closed surface changes its
/// winding number only where it is crossed.
pub(super) struct Sides<'a> {
    pub surface: &'a Surface,
    /// Covers the points that are asked for.
    pub patch: &'a Patch<'a>,
    pub centre: Vec3,
    /// The centre's winding number.
    pub winding: f64,
}

impl Sides<'_> {
    /// The winding number at `p`.
    pub fn winding(&self, p: &Vec3) -> f64 {
        let change = self.surface.is_closed().then(|| self.patch.winding_change(&self.centre, p)).flatten();
        change.map_or_else(|| self.surface.winding_number(p), |change| self.winding + f64::from(change))
    }

    /// As [`is_inside`].
    pub fn is_inside(&self, p: &Vec3) -> bool {
        self.winding(p).abs() > INSIDE
    }
}
