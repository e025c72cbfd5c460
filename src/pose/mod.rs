//! Poses made from a skeleton alone, to try what hangs on it.
//!
//! Skeletons differ in names, bind poses and in how joints are turned. So a pose is not a list
//! of joint angles: it says which way the parts of a figure point ("upper arms forward, shins
//! down") in the figure's own frame. [`figure`] finds the parts by name, hierarchy and place;
//! [`set`] holds the poses; here they become rotations.
//!
//! With `P` the rotation that a joint's ancestors have made and `d` the direction from it to the
//! next joint of its limb in the bind pose, the rotation that makes the limb point along `w` is
//! the shortest one from `d` to `P^-1 w` (about world axes, as [`crate::geometry::skinning`]
//! takes it). Twist along a limb stays what it was. A bend of the trunk or the neck is shared
//! equally by its joints.

mod figure;
mod limbs;
mod names;
mod set;
#[cfg(test)]
mod tests;

use nalgebra::{Rotation3, Unit};

use crate::geometry::skinning::{self, Mat4, SkinningError};
use crate::model::{Skeleton, Vec3};
pub use figure::{Arm, Figure, Frame, Leg};
pub use set::{Stance, stances};

/// A pose of one skeleton.
#[derive(Clone, Debug)]
pub struct Pose {
    /// Its name in the report.
    pub name: String,
    /// Skinning matrix of each joint ([`skinning::pose_matrices`]).
    pub matrices: Vec<Mat4>,
}

/// The poses that a skeleton can take, and those of the set that it cannot.
#[derive(Clone, Debug, Default)]
pub struct PoseSet {
    /// In the order of [`stances`].
    pub poses: Vec<Pose>,
    /// Names of the poses left out, each with the part that was not found.
    pub left_out: Vec<(&'static str, &'static str)>,
}

/// Every pose of [`stances`] that the skeleton's parts allow.
///
/// # Errors
/// A skeleton that is no tree or whose arrays do not fit: [`SkinningError`].
pub fn poses(skeleton: &Skeleton) -> Result<PoseSet, SkinningError> {
    let figure = Figure::find(skeleton)?;
    let mut set = PoseSet::default();
    for stance in stances() {
        match figure.lacks(stance) {
            Some(part) => set.left_out.push((stance.name, part)),
            None => {
                let rotations = rotations(&figure, stance);
                let matrices = skinning::pose_matrices(skeleton, &rotations, &Vec3::zeros())?;
                set.poses.push(Pose { name: stance.name.to_owned(), matrices });
            }
        }
    }
    Ok(set)
}

/// Rotation of every joint about the bind pose's world axes; shape `[joints]`.
pub fn rotations(figure: &Figure, stance: &Stance) -> Vec<Rotation3<f64>> {
    let mut turned = vec![Rotation3::identity(); figure.positions.len()];
    let frame = &figure.frame;
    share(&mut turned, &figure.spine, frame, stance.trunk);
    share(&mut turned, &figure.neck, frame, stance.head);
    for (side, arm) in figure.arms.iter().enumerate() {
        let (Some(arm), Some(directions)) = (arm, stance.arms) else { continue };
        let mut above = Rotation3::identity();
        if let Some(clavicle) = arm.clavicle {
            // The left shoulder goes up about the axis that points forward.
            let angle = stance.raise.to_radians() * sign(side);
            above = Rotation3::from_axis_angle(&Unit::new_unchecked(frame.forward), angle);
            turned[clavicle] = above;
        }
        limb(figure, [arm.upper, arm.fore, arm.hand], side, directions[side], above, &mut turned);
    }
    for (side, leg) in figure.legs.iter().enumerate() {
        let (Some(leg), Some(directions)) = (leg, stance.legs) else { continue };
        let joints = [leg.thigh, leg.shin, leg.foot];
        limb(figure, joints, side, directions[side], Rotation3::identity(), &mut turned);
    }
    turned
}

/// Turns the two segments of a limb to point along `directions` [outward, up, forward] as seen from
/// the trunk that it hangs on.
fn limb(
    figure: &Figure,
    joints: [usize; 3],
    side: usize,
    directions: [[f64; 3]; 2],
    mut above: Rotation3<f64>,
    turned: &mut [Rotation3<f64>],
) {
    for (k, [outward, up, forward]) in directions.into_iter().enumerate() {
        let frame = &figure.frame;
        let wanted = frame.left * (outward * sign(side)) + frame.up * up + frame.forward * forward;
        let bone = figure.positions[joints[k + 1]] - figure.positions[joints[k]];
        let turn = shortest(&bone, &(above.inverse() * wanted), &frame.forward);
        turned[joints[k]] = turn;
        above *= turn;
    }
}

/// 1 on the left, -1 on the right.
fn sign(side: usize) -> f64 {
    if side == 0 { 1.0 } else { -1.0 }
}

/// The shortest rotation from `a` to `b`; where they oppose one another, about `otherwise`.
fn shortest(a: &Vec3, b: &Vec3, otherwise: &Vec3) -> Rotation3<f64> {
    Rotation3::rotation_between(a, b).unwrap_or_else(|| {
        let across = otherwise - a * (a.dot(otherwise) / a.norm_squared());
        let axis = Unit::try_new(across, 1e-9).unwrap_or_else(|| Unit::new_normalize(a.cross(&Vec3::x())));
        Rotation3::from_axis_angle(&axis, std::f64::consts::PI)
    })
}

/// Shares a bend forward, a lean to the left and a turn to the left [degrees] among joints.
fn share(turned: &mut [Rotation3<f64>], joints: &[usize], frame: &Frame, [bend, lean, turn]: [f64; 3]) {
    let about = |axis: Vec3, degrees: f64| {
        let angle = degrees.to_radians() / joints.len() as f64;
        Rotation3::from_axis_angle(&Unit::new_unchecked(axis), angle)
    };
    for &j in joints {
        turned[j] = about(frame.up, turn) * about(-frame.forward, lean) * about(frame.left, bend);
    }
}
