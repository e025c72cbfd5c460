//! Host tables of the elements: rest constants, stencils and bending weights.
//!
//! # Bending
//! The shape operator of a triangle [Gingold 2004; Grinspun 2006] is linear in the bends
//! `phi_i = theta_i - theta_i^rest` of its three hinges, `S_r - S_r^rest = sum_i W_ri phi_i`
//! for `S_r` = `S00`, `S11`, `S01` in warp/weft axes. Gingold differentiates mid-edge normals
//! that have turned by half of each angle,
//!
//! ```text
//! S - S^rest = sum_i phi_i / 2 (l_i / A) n_i n_i^T
//! ```
//!
//! with `n_i` the unit normal of edge i in the panel. That is exact for cylinders on lattices
//! and depends on the mesh elsewhere, however fine it is: over the panels of the sample
//! garments a cylinder gets 1.06 to 1.17 times its energy, and with vertices of a grid moved
//! by up to a fifth of an edge a sheet that relaxes between cylindrical borders still 0.99 to
//! 1.18 times. So `W` is chosen otherwise where that is sound: *the three angles of any
//! quadratic surface over the panel give back its curvature*. Row i of a matrix `B` holds the
//! angle of hinge i for unit `K00`, `K11`, `K01`, and `W = B^-1`. On lattices this is
//! Gingold's; the relaxed sheet comes to 0.96 to 1.05 (0.96 to 1.00 being the part of the
//! borders). Where a hinge is missing at a border or seam no moment passes, so the curvature
//! is the one of least energy among those that have the angles of the hinges that are there,
//! `W = K^-1 B^T (B K^-1 B^T)^-1` with `K` the diagonal of stiffnesses (which is `B^-1` when
//! none is missing). Without that a strip would be too soft by an amount of first order in
//! the edge length. Two limits guard it all, [`FIT_LARGEST`] and [`FIT_OVERSTATED`]. Past
//! them the angles are split by the heights `h`, `h'` of the two triangles over the edge,
//! `phi_i h_i / (h_i + h_i')`, in place of halves, which keeps rows of different widths
//! exact. The energy of paper
//! section 5.2,
//!
//! ```text
//! psi = A/2 [ k_warp (S00 - S00r)^2 + k_weft (S11 - S11r)^2 + k_shear (S01 - S01r)^2 ],
//! ```
//!
//! is then `|c|^2 / 2` with the amounts `c_r = sqrt(A k_r) (S_r - S_r^rest)`. Note that `S01`
//! enters once: cloth is isotropic with `k_shear = 2 k_warp = 2 k_weft`.
//!
//! # Seam springs
//! A seam hinge is an element with one amount, `c = sqrt(k l^2 / (A + A')) phi`: the energy of
//! cloth of stiffness `k` that takes the whole angle between the two triangles. `k` is the
//! mean of both sides' stiffness across the edge,
//! `k_warp n_x^4 + k_weft n_y^4 + k_shear n_x^2 n_y^2`, times `Options::seam_bending`.
//!
//! # Second derivatives
//! Gauss-Newton: `J^T J` with `J = dc/dx`; `sum_r c_r d^2 c_r / dx^2` is left out. It is
//! positive semi-definite, and exact where the cloth has its rest bend.

use nalgebra::{Matrix3, RealField, Vector3};

use super::hinge::{COLLAPSED, HingeRest};
use super::stretch::{self, StretchRest};
use crate::drape::cloth::{Cloth, Hinge};
use crate::model::{Fabric, Vec2};

/// Stands for "no hinge" and "no node".
pub const NONE: u32 = u32::MAX;

/// Largest norm of the fitted weights over that of the split ones: near a conic they grow
/// without bound.
pub const FIT_LARGEST: f64 = 2.0;

/// Largest overstatement of a curvature by the split weights that the fit may correct. A
/// mesh of alternating diagonals, where it is 1.9 to 2 in all triangles, shows why there is a
/// limit: fitted, it has bumpy modes that relax bending energies to 0.4 to 0.7 of their value.
pub const FIT_OVERSTATED: f64 = 1.6;

/// Share of the largest bending stiffness of a fabric that each counts as having.
const LIMP: f64 = 1e-6;

/// A bending element: a triangle with its up to three hinges, or a seam spring.
#[derive(Clone, Debug)]
pub struct BendElement {
    /// For each corner the hinge opposite to it: `4 hinge + 2 side + swapped`, or [`NONE`].
    /// `side` is which triangle of the hinge this is; `swapped` whether the hinge's edge
    /// runs from corner i + 2 to corner i + 1.
    pub hinges: [u32; 3],
    /// Nodes of the corners and of the far points of the hinges, or [`NONE`].
    pub nodes: [u32; 6],
    /// `W`, a row for each amount, a column for each hinge [sqrt(J)].
    pub weights: [[f64; 3]; 3],
}

/// Constants of triangle `t`'s stretch.
pub fn stretch_rest(cloth: &Cloth, t: usize) -> StretchRest<f64> {
    let [p0, p1, p2] = cloth.rest[t];
    let (a, b) = (p1 - p0, p2 - p0);
    let double = a.perp(&b);
    let fabric = cloth.fabric(t);
    StretchRest {
        shape: [[b.y / double, -b.x / double], [-a.y / double, a.x / double]],
        stiffness: [fabric.stretch_warp, fabric.stretch_weft, fabric.shear].map(|k| k * cloth.areas[t]),
    }
}

/// Constants of a hinge.
pub fn hinge_rest(cloth: &Cloth, hinge: &Hinge) -> HingeRest<f64> {
    let length = hinge_length(cloth, hinge);
    HingeRest {
        angle: hinge.rest_angle,
        floor_edge: (COLLAPSED * length).powi(2),
        floor_normal: hinge.triangles.map(|t| (COLLAPSED * 2.0 * cloth.areas[t as usize]).powi(2)),
    }
}

/// Nodes of a hinge's points `x0`..`x3`.
pub fn hinge_nodes(cloth: &Cloth, hinge: &Hinge) -> [u32; 4] {
    let ([x0, x1], [x2, x3]) = (hinge.edge[0], hinge.opposite);
    [x0, x1, x2, x3].map(|v| cloth.node_of_vertex[v as usize])
}

/// All bending elements: one for each triangle, in order, then one for each seam hinge.
pub fn bend_elements(cloth: &Cloth) -> Vec<BendElement> {
    let mut elements: Vec<BendElement> = (0..cloth.triangles.len())
        .map(|t| {
            let [a, b, c] = cloth.nodes(t);
            BendElement { hinges: [NONE; 3], nodes: [a, b, c, NONE, NONE, NONE], weights: [[0.0; 3]; 3] }
        })
        .collect();
    for (h, hinge) in cloth.hinges.iter().enumerate() {
        if hinge.seam {
            elements.push(seam_element(cloth, h as u32, hinge));
            continue;
        }
        for side in 0..2 {
            let (t, corner) = (hinge.triangles[side] as usize, hinge.corners[side] as usize);
            let element = &mut elements[t];
            let swapped = cloth.triangles[t][(corner + 1) % 3] != hinge.edge[side][0];
            element.hinges[corner] = 4 * h as u32 + 2 * side as u32 + u32::from(swapped);
            element.nodes[3 + corner] = cloth.node_of_vertex[hinge.opposite[1 - side] as usize];
        }
    }
    for (t, element) in elements[..cloth.triangles.len()].iter_mut().enumerate() {
        element.weights = panel_weights(cloth, t, &element.hinges);
    }
    elements
}

/// `W` of triangle `t`.
fn panel_weights(cloth: &Cloth, t: usize, hinges: &[u32; 3]) -> [[f64; 3]; 3] {
    let (mut split, mut response) = (Matrix3::zeros(), Matrix3::zeros());
    for i in 0..3 {
        if hinges[i] != NONE {
            let (hinge, side) = (&cloth.hinges[(hinges[i] / 4) as usize], (hinges[i] / 2 % 2) as usize);
            split.set_column(i, &split_angle(cloth, hinge, side));
            response.set_row(i, &quadratic_response(cloth, hinge, side).transpose());
        }
    }
    // How much splitting overstates a quadratic surface's curvature, in the worst direction.
    let overstated = (split * response).singular_values().max();
    let fabric = cloth.fabric(t);
    let stiffness = [fabric.bending_warp, fabric.bending_weft, fabric.bending_shear];
    let fitted = least_curvature(&response, &stiffness)
        .filter(|w| w.norm() <= FIT_LARGEST * split.norm() && overstated <= FIT_OVERSTATED);
    let curvature = fitted.unwrap_or(split);
    std::array::from_fn(|row| {
        let root = (stiffness[row] * cloth.areas[t]).sqrt();
        std::array::from_fn(|i| root * curvature[(row, i)])
    })
}

/// The curvature of least energy for each radian of the hinges whose rows in `response` are
/// not zero.
fn least_curvature(response: &Matrix3<f64>, stiffness: &[f64; 3]) -> Option<Matrix3<f64>> {
    // What does not resist at all is taken for nearly limp, so that there is a least.
    let floor = LIMP * stiffness.iter().copied().fold(0.0, f64::max);
    let compliance = Matrix3::from_diagonal(&Vector3::from_fn(|r, _| 1.0 / stiffness[r].max(floor)));
    let lifted = compliance * response.transpose();
    let mut gram = response * lifted;
    for i in 0..3 {
        if gram[(i, i)] == 0.0 {
            gram[(i, i)] = 1.0; // no hinge: its column of `lifted` is zero
        }
    }
    Some(lifted * gram.try_inverse()?).filter(|w| w.iter().all(|c| c.is_finite()))
}

/// The curvature (`S00`, `S11`, `S01`) of the triangle on `side` for each radian of a hinge
/// when the angle is split by heights.
fn split_angle(cloth: &Cloth, hinge: &Hinge, side: usize) -> Vector3<f64> {
    let (length, n) = edge_in_panel(cloth, hinge, side);
    let [area, other] = [side, 1 - side].map(|s| cloth.areas[hinge.triangles[s] as usize]);
    let part = area / (area + other); // the heights' ratio: the edge is the same
    Vector3::new(n.x * n.x, n.y * n.y, n.x * n.y) * (sign(cloth, hinge, side) * part * length / area)
}

/// The angle of a hinge of the triangle on `side` for each unit of curvature (`K00`, `K11`,
/// `K01`) of a quadratic surface over the panel: its height over the triangle's plane at the
/// far point, over that point's distance from the edge.
fn quadratic_response(cloth: &Cloth, hinge: &Hinge, side: usize) -> Vector3<f64> {
    let (t, corner) = (hinge.triangles[side] as usize, hinge.corners[side] as usize);
    let (far_triangle, far_corner) = (hinge.triangles[1 - side] as usize, hinge.corners[1 - side] as usize);
    let rest = &cloth.rest[t];
    let far = cloth.rest[far_triangle][far_corner];
    let shapes = stretch::shapes(&stretch_rest(cloth, t));
    let to_far = far - rest[0];
    let mut height = Vector3::zeros();
    let quadratic = |p: Vec2| Vector3::new(0.5 * p.x * p.x, 0.5 * p.y * p.y, p.x * p.y);
    for (p, g) in rest.iter().zip(shapes) {
        height -= quadratic(p - rest[0]) * (g[0] * to_far.x + g[1] * to_far.y);
    }
    height += quadratic(to_far);
    let edge = rest[(corner + 2) % 3] - rest[(corner + 1) % 3];
    let distance = edge.perp(&(far - rest[(corner + 1) % 3])).abs() / edge.norm();
    height * (sign(cloth, hinge, side) / distance)
}

/// The hinge's sign follows its edge, counter-clockwise in the first triangle's panel; in a
/// panel without folds the second triangle has it clockwise.
fn sign(cloth: &Cloth, hinge: &Hinge, side: usize) -> f64 {
    if runs_counter_clockwise(cloth, hinge, side) == (side == 0) { 1.0 } else { -1.0 }
}

/// Whether the hinge's edge runs counter-clockwise around the triangle on `side`, seen in
/// its panel.
fn runs_counter_clockwise(cloth: &Cloth, hinge: &Hinge, side: usize) -> bool {
    let (t, corner) = (hinge.triangles[side] as usize, hinge.corners[side] as usize);
    let with_winding = cloth.triangles[t][(corner + 1) % 3] == hinge.edge[side][0];
    with_winding == (cloth.signed_area(t) > 0.0)
}

fn seam_element(cloth: &Cloth, index: u32, hinge: &Hinge) -> BendElement {
    let [x0, x1, x2, x3] = hinge_nodes(cloth, hinge);
    let stiffness: f64 = (0..2)
        .map(|side| {
            let (_, normal) = edge_in_panel(cloth, hinge, side);
            0.5 * stiffness_across(cloth.fabric(hinge.triangles[side] as usize), normal)
        })
        .sum();
    let areas: f64 = hinge.triangles.iter().map(|&t| cloth.areas[t as usize]).sum();
    let length = hinge_length(cloth, hinge);
    let weight = (cloth.options.seam_bending * stiffness * length * length / areas).sqrt();
    let mut weights = [[0.0; 3]; 3];
    weights[0][0] = weight;
    BendElement { hinges: [4 * index, NONE, NONE], nodes: [x2, x0, x1, x3, NONE, NONE], weights }
}

/// Bending stiffness for curvature along the unit vector `n` of the panel [N m].
fn stiffness_across(fabric: &Fabric, n: Vec2) -> f64 {
    let (x, y) = (n.x * n.x, n.y * n.y);
    fabric.bending_warp * x * x + fabric.bending_weft * y * y + fabric.bending_shear * x * y
}

/// Rest length of a hinge's edge and its unit normal, in the panel of the triangle on `side`.
fn edge_in_panel(cloth: &Cloth, hinge: &Hinge, side: usize) -> (f64, Vec2) {
    let (t, corner) = (hinge.triangles[side] as usize, hinge.corners[side] as usize);
    let rest = &cloth.rest[t];
    let edge = rest[(corner + 2) % 3] - rest[(corner + 1) % 3];
    let length = edge.norm();
    (length, Vec2::new(edge.y, -edge.x) / length)
}

/// Rest length of a hinge's edge, the mean of both sides [m].
fn hinge_length(cloth: &Cloth, hinge: &Hinge) -> f64 {
    0.5 * (edge_in_panel(cloth, hinge, 0).0 + edge_in_panel(cloth, hinge, 1).0)
}

/// The amounts of an element; `bend_of_hinge` gives `phi`.
pub fn amounts<T: RealField + Copy>(
    hinges: &[u32; 3],
    weights: &[T; 9],
    bend_of_hinge: impl Fn(usize) -> T,
) -> [T; 3] {
    let mut amounts = [T::zero(); 3];
    for i in 0..3 {
        if hinges[i] != NONE {
            let bend = bend_of_hinge((hinges[i] / 4) as usize);
            for row in 0..3 {
                amounts[row] += weights[3 * row + i] * bend;
            }
        }
    }
    amounts
}

/// The derivatives of an element's amounts with respect to its six nodes, a row for each
/// amount; `gradient_of_hinge` gives the gradient of `theta` in the hinge's four points.
pub fn amount_gradients<T: RealField + Copy>(
    hinges: &[u32; 3],
    weights: &[T; 9],
    gradient_of_hinge: impl Fn(usize) -> [Vector3<T>; 4],
) -> [[Vector3<T>; 3]; 6] {
    let mut rows = [[Vector3::zeros(); 3]; 6];
    for i in 0..3 {
        if hinges[i] == NONE {
            continue;
        }
        let g = gradient_of_hinge((hinges[i] / 4) as usize);
        let (side, swapped) = ((hinges[i] / 2 % 2) as usize, (hinges[i] % 2) as usize);
        for row in 0..3 {
            let weight = weights[3 * row + i];
            rows[i][row] += g[2 + side] * weight;
            rows[(i + 1) % 3][row] += g[swapped] * weight;
            rows[(i + 2) % 3][row] += g[1 - swapped] * weight;
            rows[3 + i][row] = g[3 - side] * weight;
        }
    }
    rows
}
