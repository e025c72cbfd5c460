//! The weights that put one vertex back on the skin.

use nalgebra::DVector;

use super::Scene;
use super::contact::Contact;
use crate::geometry::skinning::transform;
use crate::model::Vec3;
use crate::rig::influences;

/// A squared depth counts this many times a squared displacement.
const PUSH: f64 = 30.0;

/// Weights on `joints` near `now` that put the point `p` out of the body in its `contacts`: with the
/// metric `H` of [`influences`] (squared displacement when joints turn) and the heights `a_c` above
/// its plane at which contact `c` has the point for each joint alone, they minimise
///
/// `(w - now)^T H (w - now) + PUSH sum_c (a_c . w)^2`, `w >= 0`, `sum w = 1`.
pub(super) fn run(
    scene: &Scene<'_>,
    p: &Vec3,
    contacts: &[Contact],
    joints: &[u32],
    now: &DVector<f64>,
) -> DVector<f64> {
    let mut h = scene.turns.metric(p, joints) * influences::turn();
    let pull = &h * now;
    for contact in contacts {
        let matrices = &scene.poses[contact.pose].matrices;
        let height = |&j: &u32| contact.normal.dot(&(transform(&matrices[j as usize], p) - contact.on));
        let heights = DVector::from_iterator(joints.len(), joints.iter().map(height));
        h.ger(PUSH, &heights, &heights, 1.0);
    }
    influences::fit(&h, &pull, now, (0..joints.len()).collect())
}
