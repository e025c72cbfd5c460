//! Details between the proxy and something else.
//!
//! A detail is as thick as it was, unless there is no room for it: an inner pocket bag between a
//! trouser leg and the thigh, a strap in a fold of the shell. There its offset is pressed
//! together: with `s` the way from the proxy to what is on the other side, a height `h` above
//! `s - c` becomes `s h / (h + c)`, which leaves a part of the clearance `c` free and keeps the order
//! of details that lie on one another.

use super::binding::{Bond, Deformed};
use crate::geometry::Surface;
use crate::model::Vec3;

/// Room that a detail wants between itself and what is opposite [m].
const CLEARANCE: f64 = 1e-3;
/// Rays start this share of the height above the surface that they leave.
const START: f64 = 1e-2;

/// The vertex, nearer to the proxy where there is no room for it at `x`; `None` if there is.
pub fn run(bond: &Bond, x: &Vec3, proxy: &Deformed, obstacles: &[&Surface]) -> Option<Vec3> {
    if bond.in_surface() || bond.beyond {
        return None;
    }
    let foot = proxy.on_patch(bond, x).point;
    let offset = x - foot;
    let height = offset.norm();
    let start = foot + offset * START;
    let room = std::iter::once(&&proxy.surface)
        .chain(obstacles)
        .filter_map(|surface| surface.ray(&start, &offset, height + CLEARANCE))
        .map(|hit| hit.distance + START * height)
        .fold(f64::INFINITY, f64::min);
    (room < height + CLEARANCE).then(|| foot + offset * (room / (height + CLEARANCE)))
}
