//! Intersection contours of a cloth with itself, and how they get shorter [Volino and
//! Magnenat-Thalmann 2006].
//!
//! Where two parts of a sheet cross, they meet along polylines. The polyline's nodes are where
//! an edge passes through a triangle; from a node it runs into each triangle at the edge's
//! sides, along the unit vectors `R_i`. If the edge (unit direction `E`) moves by `d` against
//! the triangle (unit normal `N`), the node moves by `d - (d.N)/(E.N) E`, so that the
//! contour's length `L` changes by
//! ```text
//! dL = -d . G,   G = sum_i R_i - (E . sum_i R_i)/(E . N) N
//! ```
//! Moving edges by `G` and triangles against it shortens all contours; a closed one shrinks to
//! nothing, and one that ends on borders leaves over them. A loop around a long sleeve keeps
//! its length for a while: that is what [`super::regions`] is for.

use rayon::prelude::*;

use super::sheet::Sheet;
use crate::model::Vec3;

/// An edge this close to the triangle's plane (sine) says nothing of where to go.
const GRAZING: f64 = 0.02;

/// A place where an edge passes through a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// The edge.
    pub edge: u32,
    /// The triangle.
    pub triangle: u32,
    /// The place, from the edge's first end to its second (0 to 1).
    pub along: f64,
    /// The place in the triangle.
    pub barycentric: [f64; 3],
    /// Where the edge is to go against the triangle so that the contour gets shorter (`G`).
    pub shrink: Vec3,
    /// Length of the contour that belongs to the node [m]: half of its segments.
    pub length: f64,
}

/// The nodes of the contours whose crossings (edge and triangle) are `crossings`.
pub fn nodes(sheet: &Sheet, crossings: &[[u32; 2]], x: &[Vec3]) -> Vec<Node> {
    crossings.par_iter().filter_map(|&[edge, triangle]| node(sheet, edge, triangle, x)).collect()
}

/// Length of all contours [m].
pub fn length(nodes: &[Node]) -> f64 {
    nodes.iter().map(|n| n.length).sum()
}

fn node(sheet: &Sheet, edge: u32, triangle: u32, x: &[Vec3]) -> Option<Node> {
    let at = |p: u32| x[p as usize];
    let corners = sheet.triangles[triangle as usize].map(at);
    let [p, q] = sheet.edges.ends[edge as usize].map(at);
    let normal = unit_normal(&corners)?;
    let (above, below) = ((p - corners[0]).dot(&normal), (q - corners[0]).dot(&normal));
    let along = if above == below { 0.5 } else { (above / (above - below)).clamp(0.0, 1.0) };
    let place = p.lerp(&q, along);
    let direction = (q - p).try_normalize(0.0)?;
    let (mut runs, mut length) = (Vec3::zeros(), 0.0);
    for &side in &sheet.edges.triangles[edge as usize] {
        let face = sheet.triangles[side as usize].map(at);
        let Some(run) = run_into(&face, &p, &direction, &normal) else { continue };
        runs += run;
        length += 0.5 * until_out(&place, &run, &face, &p, &direction, &corners);
    }
    let sine = direction.dot(&normal);
    let sine = if sine.abs() < GRAZING { GRAZING.copysign(sine) } else { sine };
    let shrink = runs - normal * (direction.dot(&runs) / sine);
    let barycentric = crate::geometry::triangle::closest(&place, &corners);
    Some(Node { edge, triangle, along, barycentric, shrink, length })
}

fn unit_normal(corners: &[Vec3; 3]) -> Option<Vec3> {
    (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).try_normalize(0.0)
}

/// The direction in which the contour runs from the edge (through `p` along `direction`) into
/// `face`, in the plane with `normal`.
fn run_into(face: &[Vec3; 3], p: &Vec3, direction: &Vec3, normal: &Vec3) -> Option<Vec3> {
    let run = unit_normal(face)?.cross(normal).try_normalize(1e-9)?;
    let inward = inward(face, p, direction);
    Some(if run.dot(&inward) < 0.0 { -run } else { run })
}

/// From the edge to the corner of `face` opposite to it, across the edge.
fn inward(face: &[Vec3; 3], p: &Vec3, direction: &Vec3) -> Vec3 {
    let across = face.map(|c| (c - p) - direction * direction.dot(&(c - p)));
    across.into_iter().max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default()
}

/// How far the contour runs from `place` along `run` until it leaves `face` over another of its
/// edges, or the triangle `corners` [m].
fn until_out(
    place: &Vec3,
    run: &Vec3,
    face: &[Vec3; 3],
    p: &Vec3,
    direction: &Vec3,
    corners: &[Vec3; 3],
) -> f64 {
    let mut end = f64::MAX;
    let mut leave = |a: &Vec3, b: &Vec3, inside: &Vec3| {
        let edge = b - a;
        let across = |v: &Vec3| v - edge * (edge.dot(v) / edge.norm_squared());
        let outward = -across(&(inside - a));
        let (speed, left) = (run.dot(&outward), -(place - a).dot(&outward));
        if speed > 0.0 {
            end = end.min((left / speed).max(0.0));
        }
    };
    for k in 0..3 {
        leave(&corners[k], &corners[(k + 1) % 3], &corners[(k + 2) % 3]);
        let (a, b, c) = (&face[k], &face[(k + 1) % 3], &face[(k + 2) % 3]);
        let on_edge = |v: &Vec3| (v - p).cross(direction).norm() < 1e-12;
        if !(on_edge(a) && on_edge(b)) {
            leave(a, b, c);
        }
    }
    if end == f64::MAX { 0.0 } else { end }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::contact::crossing::with_itself;

    /// A cone of eight triangles over a plane of two, its tip `depth` below it.
    fn cone_through_plane(depth: f64, shift: &Vec3) -> (Sheet, Vec<Vec3>) {
        let mut x = vec![Vec3::new(0.03, -depth, 0.02) + shift];
        for i in 0..8 {
            let turn = std::f64::consts::TAU * f64::from(i) / 8.0;
            x.push(Vec3::new(turn.cos(), 1.0, 0.7 * turn.sin()) + shift);
        }
        x.extend([(-2.0, -2.1), (2.0, -2.0), (2.1, 2.0), (-2.0, 2.0)].map(|(x, z)| Vec3::new(x, 0.0, z)));
        let mut triangles: Vec<[u32; 3]> = (0..8).map(|i| [0, 1 + i, 1 + (i + 1) % 8]).collect();
        triangles.extend([[9, 11, 10], [9, 12, 11]]);
        let ids: Vec<u32> = (0..x.len() as u32).collect();
        let sheet = Sheet::of(ids.clone(), ids, triangles, x.clone());
        (sheet, x)
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_length() {
        let at = |shift: &Vec3| {
            let (sheet, x) = cone_through_plane(0.4, shift);
            nodes(&sheet, &with_itself(&sheet, &x), &x)
        };
        let here = at(&Vec3::zeros());
        assert!(here.len() > 8 && length(&here) > 0.5);
        // Cone edges move against the plane; where the plane's own edge is crossed, the plane
        // moves against the cone.
        let gradient: Vec3 = here.iter().map(|n| if n.triangle < 8 { n.shrink } else { -n.shrink }).sum();
        for k in 0..3 {
            let step = Vec3::ith(k, 1e-6);
            let slope = (length(&at(&step)) - length(&at(&-step))) / 2e-6;
            assert!((slope - gradient[k]).abs() < 1e-5, "{k}: {slope} {gradient}");
        }
    }

    #[test]
    fn a_poking_tip_is_drawn_back() {
        let (sheet, x) = cone_through_plane(0.2, &Vec3::zeros());
        for node in nodes(&sheet, &with_itself(&sheet, &x), &x) {
            // The contour runs straight over the plane's own edge, which has no say.
            let own = node.triangle < 8;
            assert!(if own { node.shrink.norm() < 1e-9 } else { node.shrink.y > 0.0 }, "{node:?}");
        }
    }
}
