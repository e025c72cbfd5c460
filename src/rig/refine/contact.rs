//! Where a garment sinks into the posed body, and where it is near to it.

use super::garment::Garment;
use super::known::Near;
use crate::model::Vec3;

/// What is nearer to the skin than this is looked at [m]: what has been raised would otherwise sink back,
/// and what is next to it would be pulled in.
const NEAR: f64 = 4e-3;
/// How far above the skin a vertex is to be, so that the faces around it are out too [m].
const ABOVE: f64 = 2e-3;
/// How far above the skin the centre of a face is to be [m].
const FACE_ABOVE: f64 = 1e-3;

/// A spot that is to be above a plane in one pose: the mean of its nodes, one or a face's corners.
pub(super) struct Contact {
    pub pose: usize,
    nodes: [u32; 3],
    count: usize,
    /// Out of the body, of length 1.
    pub normal: Vec3,
    /// What `normal . x` has to be at least [m].
    pub height: f64,
    /// Of the cloth that it stands for [m^2].
    pub area: f64,
}

impl Contact {
    /// Its nodes.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes[..self.count]
    }
}

/// All of a garment's contacts.
#[derive(Default)]
pub(super) struct Sinking {
    pub contacts: Vec<Contact>,
    /// Numbers of vertices and of faces in the body, over poses.
    pub inside: [usize; 2],
    /// Sums of their depths [m].
    pub depth: [f64; 2],
}

impl Sinking {
    /// What sinks in one pose.
    pub fn add(&mut self, pose: usize, garment: &Garment<'_>) {
        let (resting, known) = (&garment.resting, &garment.known[pose]);
        for near in known.vertices(resting, NEAR) {
            let node = near.spot.index;
            self.take(0, pose, &near, ([node as u32; 3], 1), ABOVE, garment.cloth.areas[node]);
        }
        for near in known.faces(resting, NEAR) {
            let face = near.spot.index;
            let nodes = resting.corners(face).map(|v| v as u32);
            self.take(1, pose, &near, (nodes, 3), FACE_ABOVE, garment.face_areas[face]);
        }
    }

    fn take(
        &mut self,
        kind: usize,
        pose: usize,
        near: &Near<'_>,
        of: ([u32; 3], usize),
        above: f64,
        area: f64,
    ) {
        if near.depth > 0.0 {
            self.inside[kind] += 1;
            self.depth[kind] += near.depth;
        }
        let height = near.outward.dot(&near.on) + above;
        self.contacts.push(Contact { pose, nodes: of.0, count: of.1, normal: near.outward, height, area });
    }
}
