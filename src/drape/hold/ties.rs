//! The potentials that hold bands: springs that pull and never push.
//!
//! A tie has the vector `r = sum_i w_i x_i - a` and the energy
//! ```text
//! e = k/2 max(0, |r| - l)^2,    de/dx_i = w_i k (|r| - l) r/|r|,
//! d2e/dx_i dx_j = w_i w_j k [ n n^T + (1 - l/|r|) (I - n n^T) ],    n = r/|r|,
//! ```
//! which is convex where it pulls. An *elastic* has a tie for each triangle of its band:
//! `r = F d` is the stretched unit vector `d` along the band in the panel (`F` the deformation
//! gradient, `a = 0`), `l` the stretch at which the elastic is slack and `k = K A / l` with the
//! band's area `A` and `K` [N/m]: a membrane that resists along the band alone, whatever the
//! mesh. Its slack stretch is that of the band laid onto the body over `1 + elastic_stretch`, so
//! around the body the tension is everywhere `K elastic_stretch` for each metre of height. A
//! *tether* has a tie for each node, with `l = 0` and `a` its transferred place.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, SymmetricEigen};

use super::{Band, Held, Kind, Params};
use crate::drape::contact::stencil::{self, Stencil};
use crate::geometry::Surface;
use crate::model::{Garment, Vec2, Vec3};

/// A triangle whose normal is this close to the band's axis (cosine) is a lid and not a wall.
const LID: f64 = 0.8;

/// A spring that pulls.
#[derive(Clone, Copy, Debug)]
struct Tie {
    nodes: [u32; 4],
    weights: [f64; 4],
    anchor: Vec3,
    slack: f64,
    stiffness: f64,
    /// What a tether's anchor follows where the body moves.
    spot: Option<Spot>,
}

/// A place in the frame of a body's triangle.
#[derive(Clone, Copy, Debug)]
struct Spot {
    body: usize,
    triangle: u32,
    barycentric: [f64; 3],
    local: Vec3,
}

impl Spot {
    /// The place `p`, seen from the closest of the bodies.
    fn new(bodies: &[&Surface], p: &Vec3) -> Option<Spot> {
        let closest = bodies.iter().map(|b| b.closest(p)).enumerate();
        let (body, c) = closest.min_by(|a, b| a.1.distance.total_cmp(&b.1.distance))?;
        let corners = bodies[body].mesh().corners(c.triangle as usize);
        let local = triangle_frame(&corners)?.transpose() * (p - c.point);
        Some(Spot { body, triangle: c.triangle, barycentric: c.barycentric, local })
    }

    fn place(&self, bodies: &[&Surface]) -> Option<Vec3> {
        let corners = bodies[self.body].mesh().corners(self.triangle as usize);
        let point: Vec3 = (0..3).map(|k| corners[k] * self.barycentric[k]).sum();
        Some(point + triangle_frame(&corners)? * self.local)
    }
}

/// Along the first edge, across it, and the normal.
fn triangle_frame([a, b, c]: &[Vec3; 3]) -> Option<Matrix3<f64>> {
    let along = (b - a).try_normalize(0.0)?;
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    Some(Matrix3::from_columns(&[along, normal.cross(&along), normal]))
}

impl Tie {
    fn vector(&self, x: &[Vec3]) -> Vec3 {
        (0..4).map(|k| x[self.nodes[k] as usize] * self.weights[k]).sum::<Vec3>() - self.anchor
    }

    fn stencil(&self, x: &[Vec3]) -> Option<Stencil> {
        let r = self.vector(x);
        let length = r.norm();
        (length > self.slack && length > 0.0 || self.slack == 0.0).then(|| Stencil {
            kind: stencil::Kind::Tension,
            nodes: self.nodes,
            weights: self.weights,
            normal: r.try_normalize(0.0).unwrap_or_else(Vec3::y),
            gap: length,
            radius: self.slack,
            stiffness: self.stiffness,
        })
    }
}

/// A band with its ties.
#[derive(Clone, Debug)]
struct Grip {
    band: Band,
    panels: Vec<String>,
    ties: Vec<Tie>,
    /// Area in the pattern [m^2], and mean height across the band [m].
    area: f64,
    height: f64,
    /// Nodes and where the transfer put them.
    places: Vec<(u32, Vec3)>,
    stiffness: f64,
}

/// What holds a garment.
#[derive(Clone, Debug, Default)]
pub struct Hold {
    grips: Vec<Grip>,
}

impl Hold {
    /// Ties the bands of a garment whose vertices start at `points` and have the rest positions
    /// `pattern`, around `bodies`, whose contact begins at `distance` [m].
    pub fn new(
        garment: &Garment,
        points: &[Vec3],
        pattern: &[Vec2],
        bands: &[Band],
        bodies: &[&Surface],
        distance: f64,
        params: &Params,
    ) -> Hold {
        let x = super::node_points(garment, points);
        let grip = |band: &Band| {
            let area: Vec<(usize, f64)> = super::triangles(garment, &band.panels)
                .map(|t| (t, 0.5 * area_vector(&garment.pattern_corners(pattern, t)).abs()))
                .collect();
            let worn = |p: &Vec3| onto(bodies, distance, p);
            let (ties, stiffness) = match band.kind {
                Kind::Elastic => {
                    (elastic(garment, pattern, &area, &x, worn, params), params.elastic_stiffness)
                }
                Kind::Tether => (tether(garment, &area, &x, bodies, params), params.tether_stiffness),
            };
            let total: f64 = area.iter().map(|(_, a)| a).sum();
            Grip {
                band: band.clone(),
                panels: super::names(garment, &band.panels),
                ties,
                area: total,
                height: 2.0 * total / rims(garment, pattern, band),
                places: super::nodes(garment, &band.panels).into_iter().map(|n| (n, x[n as usize])).collect(),
                stiffness,
            }
        };
        Hold { grips: bands.iter().map(grip).collect() }
    }

    /// The ties that pull where the nodes are `x`.
    pub fn stencils(&self, x: &[Vec3]) -> Vec<Stencil> {
        self.grips.iter().flat_map(|grip| &grip.ties).filter_map(|tie| tie.stencil(x)).collect()
    }

    /// Lets tethers follow the bodies, which are moved and otherwise those of [`Hold::new`].
    pub fn follow(&mut self, bodies: &[&Surface]) {
        for tie in self.grips.iter_mut().flat_map(|grip| &mut grip.ties) {
            if let Some(place) = tie.spot.and_then(|spot| spot.place(bodies)) {
                tie.anchor = place;
            }
        }
    }

    /// How hard every band is held where the nodes are `x`.
    pub fn report(&self, x: &[Vec3]) -> Vec<Held> {
        self.grips.iter().map(|grip| grip.report(x)).collect()
    }
}

impl Grip {
    fn report(&self, x: &[Vec3]) -> Held {
        let (mut force_n, mut extension) = (0.0, 0.0);
        match self.band.kind {
            // Means over the band's area; the tension of a ring is that of its cross-section.
            Kind::Elastic => {
                for tie in &self.ties {
                    let area = tie.stiffness * tie.slack / self.stiffness;
                    let stretch = tie.vector(x).norm() / tie.slack - 1.0;
                    extension += stretch * area / self.area;
                    force_n += self.stiffness * stretch.max(0.0) * area / self.area;
                }
                force_n *= self.height;
            }
            Kind::Tether => {
                let pull: Vec3 = self.ties.iter().map(|tie| tie.vector(x) * tie.stiffness).sum();
                force_n = pull.norm();
            }
        }
        let moved: Vec<f64> = self.places.iter().map(|(n, p)| (x[*n as usize] - p).norm()).collect();
        Held {
            panels: self.panels.clone(),
            kind: self.band.kind,
            source_distance_m: self.band.source_distance_m,
            force_n,
            extension,
            moved_mean_m: moved.iter().sum::<f64>() / moved.len().max(1) as f64,
            moved_max_m: moved.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Twice the signed area of a triangle in its panel.
fn area_vector(corners: &[Vec2; 3]) -> f64 {
    (corners[1] - corners[0]).perp(&(corners[2] - corners[0]))
}

/// Length in the pattern of all rims of a band (two, for a ring) [m].
fn rims(garment: &Garment, pattern: &[Vec2], band: &Band) -> f64 {
    let mut edges: BTreeMap<[u32; 2], (usize, f64)> = BTreeMap::new();
    for t in super::triangles(garment, &band.panels) {
        for k in 0..3 {
            let v = [garment.triangles[t][k], garment.triangles[t][(k + 1) % 3]];
            let mut n = v.map(|v| garment.groups.node_of_vertex[v as usize]);
            n.sort_unstable();
            let edge = edges.entry(n).or_default();
            edge.0 += 1;
            edge.1 = (pattern[v[1] as usize] - pattern[v[0] as usize]).norm();
        }
    }
    edges.values().filter(|(count, _)| *count == 1).map(|(_, length)| length).sum()
}

/// The point `p` moved to `distance` above the closest of the bodies.
fn onto(bodies: &[&Surface], distance: f64, p: &Vec3) -> Vec3 {
    let closest =
        bodies.iter().map(|b| (b, b.closest(p))).min_by(|a, b| a.1.distance.total_cmp(&b.1.distance));
    closest.map_or(*p, |(body, c)| c.point + body.pseudo_normal(&c) * distance)
}

/// A tie for each triangle of a band; `area` are its triangles with their areas, `x` the nodes.
fn elastic(
    garment: &Garment,
    pattern: &[Vec2],
    area: &[(usize, f64)],
    x: &[Vec3],
    worn: impl Fn(&Vec3) -> Vec3,
    params: &Params,
) -> Vec<Tie> {
    let axis = axis(garment, area);
    let mut ties = Vec::new();
    for &(t, area) in area {
        let nodes = garment.triangles[t].map(|v| garment.groups.node_of_vertex[v as usize]);
        let Some(along) = direction(garment, t, &axis) else { continue };
        let c = coefficients(&garment.pattern_corners(pattern, t), &along);
        let around: Vec3 = (0..3).map(|k| worn(&x[nodes[k] as usize]) * c[k]).sum();
        let slack = around.norm() / (1.0 + params.elastic_stretch);
        if slack > 0.0 {
            ties.push(Tie {
                nodes: [nodes[0], nodes[1], nodes[2], nodes[0]],
                weights: [c[0], c[1], c[2], 0.0],
                anchor: Vec3::zeros(),
                slack,
                stiffness: params.elastic_stiffness * area / slack,
                spot: None,
            });
        }
    }
    ties
}

/// A tie for each node of a band.
fn tether(
    garment: &Garment,
    area: &[(usize, f64)],
    x: &[Vec3],
    bodies: &[&Surface],
    params: &Params,
) -> Vec<Tie> {
    let mut share: BTreeMap<u32, f64> = BTreeMap::new();
    for &(t, area) in area {
        for v in garment.triangles[t] {
            *share.entry(garment.groups.node_of_vertex[v as usize]).or_default() += area / 3.0;
        }
    }
    let tie = |(n, area): (u32, f64)| Tie {
        nodes: [n; 4],
        weights: [1.0, 0.0, 0.0, 0.0],
        anchor: x[n as usize],
        slack: 0.0,
        stiffness: params.tether_stiffness * area,
        spot: Spot::new(bodies, &x[n as usize]),
    };
    share.into_iter().map(tie).collect()
}

/// The axis that a band runs around: the direction that its normals on the source have least
/// of. Rims would say less of a band that is as high as it is wide.
fn axis(garment: &Garment, area: &[(usize, f64)]) -> Vec3 {
    let mesh = garment.mesh();
    let mut spread = Matrix3::zeros();
    for &(t, area) in area {
        if let Some(n) = mesh.area_normal(t).try_normalize(0.0) {
            spread += n * n.transpose() * area;
        }
    }
    let eigen = SymmetricEigen::new(spread);
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into()
}

/// The unit direction around `axis` of triangle `t`, in its panel as authored; `None` for a
/// triangle that lies across the axis.
fn direction(garment: &Garment, t: usize, axis: &Vec3) -> Option<Vec2> {
    let [a, b, c] = garment.triangles[t].map(|v| garment.points[v as usize]);
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    if normal.dot(axis).abs() > LID {
        return None;
    }
    // Its gradients turn lengths in the panel into lengths on the source, and back.
    let along = normal.cross(axis);
    let corners = garment.pattern_corners(&garment.pattern, t);
    let columns = [Vec2::x(), Vec2::y()].map(|d| {
        let w = coefficients(&corners, &d);
        a * w[0] + b * w[1] + c * w[2]
    });
    let [u, v] = columns;
    let gram = nalgebra::Matrix2::new(u.dot(&u), u.dot(&v), u.dot(&v), v.dot(&v));
    let solved = gram.try_inverse()? * Vec2::new(u.dot(&along), v.dot(&along));
    solved.try_normalize(0.0)
}

/// The coefficients of a triangle's corners in `F d`: shape gradients along `d`.
fn coefficients(corners: &[Vec2; 3], d: &Vec2) -> [f64; 3] {
    let double = area_vector(corners);
    std::array::from_fn(|k| {
        let opposite = corners[(k + 2) % 3] - corners[(k + 1) % 3];
        // Gradient of the corner's shape function: the opposite edge turned inwards.
        (opposite.x * d.y - opposite.y * d.x) / double
    })
}
