//! Where a garment sinks into the posed body.

use std::collections::BTreeMap;

use super::garment::Garment;
use crate::certificate::posed::Anchor;
use crate::geometry::Closest;
use crate::model::Vec3;

/// How far above the skin a vertex that has sunk is put, so that the faces around it are out too [m].
const ABOVE: f64 = 3e-3;
/// How far above the skin the centre of a face is put [m].
const FACE_ABOVE: f64 = 1e-3;

/// What a node owes to one pose: to be above a plane.
#[derive(Clone, Copy)]
pub(super) struct Contact {
    pub pose: usize,
    /// The node's own skin.
    pub anchor: Anchor,
    /// A point of the plane [m].
    pub on: Vec3,
    /// Out of the body, of length 1.
    pub normal: Vec3,
}

/// All of a garment's contacts.
#[derive(Default)]
pub(super) struct Sinking {
    /// By node.
    pub contacts: BTreeMap<usize, Vec<Contact>>,
    /// Sum of the depths of vertices and faces' centres over poses [m].
    pub depth: f64,
}

impl Sinking {
    /// What sinks in one pose. A face whose centre sinks raises its corners, each by as much as the
    /// centre has to be.
    pub fn add(&mut self, pose: usize, garment: &Garment<'_>) {
        let posed = &garment.posed[pose];
        for (spot, on, at) in posed.known.vertices(&garment.resting) {
            let plane = Contact { pose, anchor: spot.anchor, on: on.point, normal: outward(&on, &at) };
            let plane = Contact { on: plane.on + plane.normal * ABOVE, ..plane };
            self.depth += on.distance;
            self.contacts.entry(spot.index).or_default().push(plane);
        }
        for (spot, on, at) in posed.known.faces(&garment.resting) {
            let normal = outward(&on, &at);
            self.depth += on.distance;
            for node in garment.resting.corners(spot.index) {
                let on = posed.points[node] + normal * (on.distance + FACE_ABOVE);
                let raised = Contact { pose, anchor: spot.anchor, on, normal };
                self.contacts.entry(node).or_default().push(raised);
            }
        }
    }
}

/// From a point in the body to the skin.
fn outward(on: &Closest, at: &Vec3) -> Vec3 {
    (on.point - at) / on.distance
}
