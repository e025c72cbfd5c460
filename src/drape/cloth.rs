//! What of a garment does not change while it is draped: nodes, rest shape, masses, hinges.
//!
//! A *node* carries all vertices of a seam group (paper section 5, Seams Handling); the
//! simulated unknowns are the nodes. The rest shape of a triangle is its panel, so vertices
//! of panels that are sewn together keep rest shapes of their own.
//!
//! A *hinge* is an edge with a triangle on either side. Inside a panel both triangles share
//! the edge's two vertices; its rest angle is 0 (a panel is cut from flat cloth) unless
//! [`Options::curved_panels`] takes it from the source. At a seam the triangles belong to
//! different vertices of the same two nodes; its rest angle is the one on the source body.
//! Vertices that are sewn with an offset (a pocket on a front) make no hinge. An edge with
//! three or more triangles inside a panel makes none either; at a seam such triangles are
//! hinged one to the next.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::elastic::hinge;
use crate::model::{Fabric, Garment, Vec2, Vec3};

/// A rest triangle whose area over its longest edge squared is below this has no usable
/// inverse in `f32`.
const SLIVER: f64 = 1e-7;

/// How a cloth is made from a garment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Bending stiffness of a seam over that of the cloth around it (dimensionless): a seam
    /// has its allowances pressed to it, so three plies.
    pub seam_bending: f64,
    /// Whether panels keep the curvature that they have on the source body.
    pub curved_panels: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { seam_bending: 3.0, curved_panels: false }
    }
}

/// Why no cloth can be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// The pattern does not belong to the garment.
    #[error("{garment}: the pattern has {found} vertices, the garment {expected}")]
    Length { garment: String, found: usize, expected: usize },
    /// A triangle has (nearly) no area in its panel, or a coordinate is not finite.
    #[error("{garment}: triangle {triangle} has no usable area in its panel ({area:e} m^2)")]
    Degenerate { garment: String, triangle: usize, area: f64 },
    /// A fabric's density is not positive, or a stiffness is negative.
    #[error("{garment}: fabric '{fabric}': {what} is {value}, which is out of its range")]
    Fabric { garment: String, fabric: String, what: &'static str, value: f64 },
    /// A setting is out of its range.
    #[error("seam_bending is {0}; it must be finite and not negative")]
    SeamBending(f64),
}

/// An edge with a triangle on either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// The two triangles.
    pub triangles: [u32; 2],
    /// In either triangle, the corner opposite to the edge.
    pub corners: [u8; 2],
    /// The edge's vertices in the first triangle and, in the same order, in the second.
    pub edge: [[u32; 2]; 2],
    /// The vertices opposite to the edge.
    pub opposite: [u32; 2],
    /// Angle at rest [rad], signed as [`hinge::angle`] has it.
    pub rest_angle: f64,
    /// Whether this is a seam.
    pub seam: bool,
}

impl Hinge {
    /// Edge vectors of the hinge from the first edge vertex: to the second, and to the two
    /// opposite vertices.
    pub fn edges(&self, points: &[Vec3]) -> [Vec3; 3] {
        let p = |v: u32| points[v as usize];
        let [[a0, a1], [b0, _]] = self.edge;
        let [x2, x3] = self.opposite;
        [p(a1) - p(a0), p(x2) - p(a0), p(x3) - p(b0)]
    }
}

/// The constant data of a draped garment.
#[derive(Clone, Debug)]
pub struct Cloth {
    /// Number of nodes.
    pub node_count: usize,
    /// Node of each vertex, shape `[vertices]`.
    pub node_of_vertex: Vec<u32>,
    /// Triangles over vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Panel coordinates of each triangle's corners [m].
    pub rest: Vec<[Vec2; 3]>,
    /// Area of each triangle in its panel [m^2], positive.
    pub areas: Vec<f64>,
    /// Fabrics, one for each panel.
    pub fabrics: Vec<Fabric>,
    /// Fabric of each triangle.
    pub fabric_of_triangle: Vec<u32>,
    /// Lumped mass of each node [kg].
    pub masses: Vec<f64>,
    /// Hinges, those inside of panels first.
    pub hinges: Vec<Hinge>,
    /// How it was made.
    pub options: Options,
}

impl Cloth {
    /// The cloth of a garment whose vertices have the rest positions `pattern` [m].
    ///
    /// # Errors
    /// The pattern has another length than the garment, or a triangle without area; a
    /// fabric or a setting is out of range.
    pub fn new(garment: &Garment, pattern: &[Vec2], options: &Options) -> Result<Cloth, Error> {
        let name = || garment.name.clone();
        if pattern.len() != garment.points.len() {
            let (found, expected) = (pattern.len(), garment.points.len());
            return Err(Error::Length { garment: name(), found, expected });
        }
        if !(options.seam_bending.is_finite() && options.seam_bending >= 0.0) {
            return Err(Error::SeamBending(options.seam_bending));
        }
        let fabrics: Vec<Fabric> = garment.panels.iter().map(|panel| panel.fabric.clone()).collect();
        for fabric in &fabrics {
            check_fabric(garment, fabric)?;
        }
        let rest: Vec<[Vec2; 3]> =
            (0..garment.triangles.len()).map(|t| garment.pattern_corners(pattern, t)).collect();
        let mut areas = Vec::with_capacity(rest.len());
        for (triangle, corners) in rest.iter().enumerate() {
            let area = 0.5 * area_vector(corners).abs();
            let longest =
                (0..3).map(|i| (corners[(i + 1) % 3] - corners[i]).norm_squared()).fold(0.0, f64::max);
            if !(area.is_finite() && longest.is_finite() && area > SLIVER * longest) {
                return Err(Error::Degenerate { garment: name(), triangle, area });
            }
            areas.push(area);
        }
        let mut cloth = Cloth {
            node_count: garment.groups.node_count,
            node_of_vertex: garment.groups.node_of_vertex.clone(),
            triangles: garment.triangles.clone(),
            rest,
            areas,
            fabrics,
            fabric_of_triangle: garment.panel_of_triangle.clone(),
            masses: vec![0.0; garment.groups.node_count],
            hinges: Vec::new(),
            options: options.clone(),
        };
        for t in 0..cloth.triangles.len() {
            let third = cloth.fabric(t).density * cloth.areas[t] / 3.0;
            for v in cloth.triangles[t] {
                cloth.masses[cloth.node_of_vertex[v as usize] as usize] += third;
            }
        }
        cloth.hinges = hinges(&cloth, &garment.groups.has_offset);
        for hinge in &mut cloth.hinges {
            if hinge.seam || options.curved_panels {
                let [edge, a, b] = hinge.edges(&garment.points);
                hinge.rest_angle = hinge::angle(&edge, &a, &b);
            }
        }
        Ok(cloth)
    }

    /// Fabric of triangle `t`.
    pub fn fabric(&self, t: usize) -> &Fabric {
        &self.fabrics[self.fabric_of_triangle[t] as usize]
    }

    /// Nodes of triangle `t`'s corners.
    pub fn nodes(&self, t: usize) -> [u32; 3] {
        self.triangles[t].map(|v| self.node_of_vertex[v as usize])
    }

    /// Twice the signed area of triangle `t` in its panel [m^2].
    pub fn signed_area(&self, t: usize) -> f64 {
        area_vector(&self.rest[t])
    }
}

fn area_vector(corners: &[Vec2; 3]) -> f64 {
    (corners[1] - corners[0]).perp(&(corners[2] - corners[0]))
}

fn check_fabric(garment: &Garment, fabric: &Fabric) -> Result<(), Error> {
    let fault = |what, value| {
        let (garment, fabric) = (garment.name.clone(), fabric.name.clone());
        Err(Error::Fabric { garment, fabric, what, value })
    };
    if !(fabric.density.is_finite() && fabric.density > 0.0) {
        return fault("density", fabric.density);
    }
    let stiffness = [
        ("stretch_warp", fabric.stretch_warp),
        ("stretch_weft", fabric.stretch_weft),
        ("shear", fabric.shear),
        ("bending_warp", fabric.bending_warp),
        ("bending_weft", fabric.bending_weft),
        ("bending_shear", fabric.bending_shear),
    ];
    match stiffness.into_iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0)) {
        Some((what, value)) => fault(what, value),
        None => Ok(()),
    }
}

/// A triangle's edge: the triangle, the corner opposite to it, its vertices.
type Side = (u32, u8, [u32; 2]);

/// All hinges, those of panels first, each part in order of its first triangle.
fn hinges(cloth: &Cloth, has_offset: &[bool]) -> Vec<Hinge> {
    let mut sides_of_edge: BTreeMap<[u32; 2], Vec<Side>> = BTreeMap::new();
    for (t, tri) in cloth.triangles.iter().enumerate() {
        for corner in 0..3 {
            let (a, b) = (tri[(corner + 1) % 3], tri[(corner + 2) % 3]);
            let key = [a.min(b), a.max(b)];
            sides_of_edge.entry(key).or_default().push((t as u32, corner as u8, [a, b]));
        }
    }
    let mut sides_of_seam: BTreeMap<[u32; 2], Vec<Side>> = BTreeMap::new();
    let mut panel = Vec::new();
    for sides in sides_of_edge.values() {
        match sides[..] {
            [a, b] => panel.push(join(cloth, a, b, false)),
            [(_, _, [a, b])] if !has_offset[a as usize] && !has_offset[b as usize] => {
                let (na, nb) = (cloth.node_of_vertex[a as usize], cloth.node_of_vertex[b as usize]);
                if na != nb {
                    sides_of_seam.entry([na.min(nb), na.max(nb)]).or_default().push(sides[0]);
                }
            }
            _ => {}
        }
    }
    let mut seams: Vec<Hinge> = sides_of_seam
        .values()
        .flat_map(|sides| sides.windows(2).map(|pair| join(cloth, pair[0], pair[1], true)))
        .collect();
    panel.sort_by_key(|hinge| hinge.triangles);
    seams.sort_by_key(|hinge| hinge.triangles);
    panel.extend(seams);
    panel
}

/// The hinge between two sides; its edge runs as in the first triangle, turned
/// counter-clockwise in its panel.
fn join(cloth: &Cloth, a: Side, b: Side, seam: bool) -> Hinge {
    let mut first = a.2;
    if cloth.signed_area(a.0 as usize) < 0.0 {
        first.reverse();
    }
    let mut second = b.2;
    let node = |v: u32| cloth.node_of_vertex[v as usize];
    if if seam { node(second[0]) != node(first[0]) } else { second[0] != first[0] } {
        second.reverse();
    }
    let vertex = |(t, corner, _): Side| cloth.triangles[t as usize][corner as usize];
    Hinge {
        triangles: [a.0, b.0],
        corners: [a.1, b.1],
        edge: [first, second],
        opposite: [vertex(a), vertex(b)],
        rest_angle: 0.0,
        seam,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::elastic::tests::{Split, flat, garment_of, panel, sewn};

    #[test]
    fn masses_are_thirds_of_the_triangles_around() {
        let garment = garment_of(&panel(2, 1, 0.1, Split::Diagonal, 0.3), &Fabric::default(), flat);
        let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).unwrap();
        let triangle = 0.15 * 0.005;
        let total: f64 = cloth.masses.iter().sum();
        assert!((total - 4.0 * triangle).abs() < 1e-15);
        let most = cloth.masses.iter().copied().fold(0.0, f64::max);
        assert!((most - triangle).abs() < 1e-15, "the middle nodes have three triangles");
    }

    #[test]
    fn inner_edges_are_hinges_and_sewn_ones_seams() {
        let garment = garment_of(&panel(3, 2, 0.1, Split::Diagonal, 0.0), &Fabric::default(), flat);
        let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).unwrap();
        // Euler: 12 vertices, 12 triangles, 23 edges, 10 of them on the border.
        assert_eq!(cloth.hinges.len(), 13);
        assert!(cloth.hinges.iter().all(|h| !h.seam && h.rest_angle == 0.0));
        let garment = sewn(3, 0.1, 0.7);
        let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).unwrap();
        let seams: Vec<_> = cloth.hinges.iter().filter(|h| h.seam).collect();
        assert_eq!((seams.len(), cloth.node_count, cloth.node_of_vertex.len()), (3, 12, 16));
        for hinge in seams {
            let nodes = hinge.edge.map(|edge| edge.map(|v| cloth.node_of_vertex[v as usize]));
            assert_eq!(nodes[0], nodes[1]);
            assert_ne!(hinge.edge[0], hinge.edge[1]);
            assert!((hinge.rest_angle.abs() - 0.7).abs() < 1e-12);
        }
    }

    #[test]
    fn vertices_sewn_with_an_offset_make_no_seam_hinge() {
        let mut garment = sewn(3, 0.1, 0.7);
        for v in 0..garment.points.len() {
            let anchor = garment.groups.anchor_of_node[garment.groups.node_of_vertex[v] as usize];
            garment.groups.has_offset[v] = anchor != v as u32;
        }
        let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).unwrap();
        assert!(cloth.hinges.iter().all(|h| !h.seam));
    }

    #[test]
    fn curved_panels_keep_their_angles() {
        let mesh = panel(3, 2, 0.1, Split::Diagonal, 0.0);
        let folded = |p: &Vec2| Vec3::new(p.x.min(0.1), (p.x - 0.1).max(0.0), p.y);
        let garment = garment_of(&mesh, &Fabric::default(), folded);
        let options = Options { curved_panels: true, ..Options::default() };
        let cloth = Cloth::new(&garment, &garment.pattern, &options).unwrap();
        let right_angles = cloth
            .hinges
            .iter()
            .filter(|h| (h.rest_angle.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-12)
            .count();
        assert_eq!(right_angles, 2);
    }

    #[test]
    fn what_cannot_be_cloth_is_refused() {
        let garment = garment_of(&panel(2, 1, 0.1, Split::Diagonal, 0.0), &Fabric::default(), flat);
        let make = |pattern: &[Vec2], options: &Options| Cloth::new(&garment, pattern, options).map(|_| ());
        let options = Options::default();
        let short = make(&garment.pattern[1..], &options);
        assert_eq!(short, Err(Error::Length { garment: "sheet".to_owned(), found: 5, expected: 6 }));
        let collapsed: Vec<Vec2> = garment.pattern.iter().map(|p| Vec2::new(p.x, 1e-9 * p.y)).collect();
        assert!(matches!(make(&collapsed, &options), Err(Error::Degenerate { triangle: 0, .. })));
        let unknown = vec![Vec2::new(f64::NAN, 0.0); 6];
        assert!(matches!(make(&unknown, &options), Err(Error::Degenerate { triangle: 0, .. })));
        let negative = Options { seam_bending: -1.0, ..options.clone() };
        assert_eq!(make(&garment.pattern, &negative), Err(Error::SeamBending(-1.0)));
        let mut weightless = garment.clone();
        weightless.panels[0].fabric.density = 0.0;
        let found = Cloth::new(&weightless, &garment.pattern, &options).map(|_| ());
        assert!(matches!(found, Err(Error::Fabric { what: "density", .. })));
    }
}
