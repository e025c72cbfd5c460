//! Blend shapes of the body, carried to what it wears.
//!
//! A blend shape moves points of the body by offsets (a belly, a flexed muscle); cloth over it has to
//! move too, or it is pierced. A cloth point takes the offset of the closest point of the skin,
//! interpolated between the triangle's corners. Far from the skin the closest point says little and jumps
//! from one side of a hollow to the other, so the offsets are averaged with those of the neighbours there:
//! with `d` the distance from the skin and `x_0` the offset taken,
//! ```text
//! x <- (1 - s) x_0 + s mean(x of neighbours)        s = d / (d + LOOSE)
//! ```
//! repeated [`ROUNDS`] times. Offsets belong to nodes, so seams stay closed.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Sewn;
use super::cloth::node_mesh;
use crate::geometry::OuterSkin;
use crate::geometry::topology::neighbours;
use crate::model::{BlendShape, Character, Garment, Vec3};

/// Distance from the skin at which cloth listens to its neighbours as much as to the skin [m].
const LOOSE: f64 = 0.1;
/// Rounds of averaging.
const ROUNDS: usize = 10;

/// Settings of blend shapes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Whether blend shapes of the body that move a garment are carried to it.
    pub enabled: bool,
    /// Garment points that a shape moves less are left out of it [m].
    pub smallest: f64,
}

impl Default for Params {
    fn default() -> Self {
        Params { enabled: false, smallest: 1e-4 }
    }
}

/// Offsets of the garment's vertices at `points` [m] for every shape of the character's body; `None` for a
/// shape that moves none of them by more than [`Params::smallest`]. `body` is its outer skin.
///
/// # Panics
/// If a shape names a point that the body does not have; shapes are checked where they are read.
pub fn carry(
    character: &Character,
    body: &OuterSkin,
    garment: &Garment,
    points: &[Vec3],
    params: &Params,
) -> Vec<Option<Vec<Vec3>>> {
    let cloth = node_mesh(&Sewn::new(garment, points));
    let anchors: Vec<Anchor> = cloth.points.par_iter().map(|p| Anchor::new(body, p)).collect();
    let neighbours = neighbours(cloth.points.len(), &cloth.triangles);
    let of_shape = |shape: &BlendShape| {
        let mut of_body = vec![Vec3::zeros(); character.body.points.len()];
        shape.points.iter().zip(&shape.offsets).for_each(|(&p, offset)| of_body[p as usize] = *offset);
        let taken: Vec<Vec3> = anchors.iter().map(|a| a.offset(&of_body)).collect();
        if taken.iter().all(|x| x.norm() <= params.smallest) {
            return None;
        }
        let smooth = averaged(&taken, &anchors, &neighbours);
        Some(garment.groups.node_of_vertex.iter().map(|&n| smooth[n as usize]).collect())
    };
    character.blend_shapes.par_iter().map(of_shape).collect()
}

/// The body point under a node.
struct Anchor {
    corners: [u32; 3],
    barycentric: [f64; 3],
    /// Share of the neighbours in the node's offset.
    loose: f64,
}

impl Anchor {
    fn new(body: &OuterSkin, p: &Vec3) -> Anchor {
        let on = body.surface.closest(p);
        let corners = body.surface.mesh().triangles[on.triangle as usize];
        Anchor {
            corners: corners.map(|i| body.point_of[i as usize]),
            barycentric: on.barycentric,
            loose: on.distance / (on.distance + LOOSE),
        }
    }

    fn offset(&self, of_body: &[Vec3]) -> Vec3 {
        (0..3).map(|k| of_body[self.corners[k] as usize] * self.barycentric[k]).sum()
    }
}

fn averaged(taken: &[Vec3], anchors: &[Anchor], neighbours: &[Vec<u32>]) -> Vec<Vec3> {
    let mut offsets = taken.to_vec();
    for _ in 0..ROUNDS {
        let mean =
            |around: &[u32]| around.iter().map(|&m| offsets[m as usize]).sum::<Vec3>() / around.len() as f64;
        offsets = (0..taken.len())
            .map(|n| match anchors[n].loose {
                s if neighbours[n].is_empty() || s == 0.0 => taken[n],
                s => taken[n] * (1.0 - s) + mean(&neighbours[n]) * s,
            })
            .collect();
    }
    offsets
}
