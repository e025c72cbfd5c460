//! Poses: a target that stands otherwise than the source is taken to the source's pose first.
//!
//! The flow spreads what differs between two bodies through the space around them. An arm that
//! is raised by 45 degrees is no difference of shape, and a flow that raises it shears the
//! sleeve and tears open the armpit. So the target is *unposed*, the garments are carried to
//! it, and they are brought back with skin weights of their own.
//!
//! Which joints are turned is seen from the skin: source and target correspond point by point,
//! so the rotation that takes the points of a joint, weighted by its influence squared, from one
//! body to the other [Kabsch 1976] is that joint's turn `D_j`. Bones and joint frames would say
//! less: rigs turn their axes as they like, and the short bones of neck and shoulder lie up to
//! 31 degrees apart between a lean and a heavy man in one and the same pose, while no part of
//! the skin is turned by more than 12.
//!
//! The target is taken for the linear blend skin of its unposed self,
//! `t_i = sum_j w_ij G_j t'_i` with `G_j x = D_j (x - c_j) + b_j`, where `b_j` are its joints and
//! `c_j` the same joints along unposed bones. Blends share points among joints, so turns are
//! measured again on what came out, until nothing is left of them.

use nalgebra::{Matrix3, Rotation3};
use serde::Serialize;

use super::align::{Motion, nearest_rotation};
use crate::geometry::skinning::{
    Mat4, SkinningError, blended_matrix, from_rows, parents_first, to_rows, transform,
};
use crate::model::{Character, Skeleton, Skin, Vec3};

/// Rounds of measuring and unposing.
const ROUNDS: usize = 8;
/// Joints whose turn against their parent's is below this share of the setting are left with it.
const FOLLOWS: f64 = 0.5;
/// Influence (squared, in points) below which a joint has no skin to see its turn from.
const LEAST_SKIN: f64 = 8.0;
/// Rounds of reweighting, and the distance from which on a point counts less [m], when the whole
/// body's rotation is sought.
const FACING_ROUNDS: usize = 6;
const FACING_SCALE: f64 = 0.02;
/// Smallest determinant of a point's blended map that can be undone.
const LEAST_DETERMINANT: f64 = 0.05;

/// How the target's pose differs from the source's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseInfo {
    /// The joint whose skin is turned most.
    pub joint: String,
    /// By how much [degrees].
    pub angle_degrees: f64,
    /// Joints that were turned back.
    pub turned: usize,
    /// Largest turn that is left in the unposed target [degrees].
    pub left_degrees: f64,
}

/// A target in its source's pose.
#[derive(Clone, Debug)]
pub struct Unposed {
    /// The character with its body and its joints in the source's pose.
    pub character: Character,
    /// What takes each joint's points back to the target's own pose.
    pub matrices: Vec<Mat4>,
    /// The difference.
    pub info: PoseInfo,
}

impl Unposed {
    /// Points on the unposed target, in the target's own pose, moved with their skin [m].
    pub fn pose(&self, points: &[Vec3], skin: &Skin) -> Vec<Vec3> {
        crate::geometry::skinning::skin_points(points, skin, &self.matrices)
    }
}

/// Why a target could not be taken to its source's pose.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum PoseError {
    /// The skeleton.
    #[error("{path}: {error}")]
    Skeleton {
        /// The body's path.
        path: String,
        /// What is wrong.
        error: SkinningError,
    },
    /// The blend of a point's joints turns it over, so that it cannot be undone.
    #[error(
        "{path}, point {element}: the body stands in another pose than its source body \
         ({joint} is turned by {degrees:.0} degrees), too far to be taken to its pose"
    )]
    TooFar {
        /// The body's path.
        path: String,
        /// The point.
        element: usize,
        /// The joint that is turned most.
        joint: String,
        /// By how much.
        degrees: f64,
    },
}

/// `target` in the pose of `source` (the points of the source body, in correspondence), if any
/// part of its skin is turned against the rest by more than `threshold` degrees.
///
/// # Errors
/// A skeleton that is none, or a pose too far away: [`PoseError`].
pub fn unpose(source: &[Vec3], target: &Character, threshold: f64) -> Result<Option<Unposed>, PoseError> {
    let joints = Joints::new(source, target)?;
    let points = &target.body.points;
    let seen = joints.turns(points);
    let (worst, angle) = largest(&seen);
    if angle <= threshold.to_radians() {
        return Ok(None);
    }
    let joint = target.skeleton.joints[worst].clone();
    let mut turns = vec![Rotation3::identity(); seen.len()];
    let mut unposed = points.clone();
    let mut left = seen;
    for _ in 0..ROUNDS {
        turns = joints.follow(&turns, &left, FOLLOWS * threshold.to_radians());
        unposed = joints.undo(&joints.matrices(&turns), points).map_err(|element| PoseError::TooFar {
            path: target.path.clone(),
            element,
            joint: joint.clone(),
            degrees: angle.to_degrees(),
        })?;
        left = joints.turns(&unposed);
    }
    let matrices = joints.matrices(&turns);
    let mut character = target.clone();
    character.body.points = unposed;
    for (matrix, bind) in matrices.iter().zip(&mut character.skeleton.world_from_joint) {
        let back = matrix.try_inverse().unwrap_or_else(Mat4::identity);
        *bind = to_rows(&(back * from_rows(bind)));
    }
    let info = PoseInfo {
        joint,
        angle_degrees: angle.to_degrees(),
        turned: turns.iter().filter(|t| t.angle() > 0.0).count(),
        left_degrees: largest(&left).1.to_degrees(),
    };
    Ok(Some(Unposed { character, matrices, info }))
}

/// The joint that is turned most, and its angle [rad].
fn largest(turns: &[Option<Rotation3<f64>>]) -> (usize, f64) {
    let angle = |t: &Option<Rotation3<f64>>| t.map_or(0.0, |t| t.angle());
    let most = |a: (usize, f64), b: (usize, f64)| if b.1 > a.1 { b } else { a };
    turns.iter().map(angle).enumerate().fold((0, 0.0), most)
}

/// What of source and target says how joints are turned.
struct Joints<'a> {
    source: &'a [Vec3],
    skeleton: &'a Skeleton,
    skin: &'a Skin,
    /// Parents before their children.
    order: Vec<usize>,
    /// Joints of the target [m].
    at: Vec<Vec3>,
}

impl<'a> Joints<'a> {
    fn new(source: &'a [Vec3], target: &'a Character) -> Result<Joints<'a>, PoseError> {
        let skeleton = &target.skeleton;
        let order = parents_first(skeleton)
            .map_err(|error| PoseError::Skeleton { path: target.path.clone(), error })?;
        Ok(Joints { source, skeleton, skin: &target.skin, order, at: skeleton.positions() })
    }

    /// The turn of each joint's skin from the source to `points`, against that of the whole body;
    /// none where it has too little skin.
    fn turns(&self, points: &[Vec3]) -> Vec<Option<Rotation3<f64>>> {
        let facing = facing(self.source, points);
        let mut regions = vec![Region::default(); self.at.len()];
        let k = self.skin.influences;
        for (i, (x, y)) in self.source.iter().zip(points).enumerate() {
            for at in i * k..(i + 1) * k {
                let weight = self.skin.joint_weights[at].powi(2);
                if weight > 0.0 {
                    regions[self.skin.joint_indices[at] as usize].add(weight, x, y);
                }
            }
        }
        regions
            .iter()
            .map(|r| r.turn().map(|t| t * facing.transpose()).map(Rotation3::from_matrix_unchecked))
            .collect()
    }

    /// Turns after the `left` over ones are added; a joint that is turned against its parent by
    /// less than `least` [rad], or has no skin, goes with its parent.
    fn follow(
        &self,
        turns: &[Rotation3<f64>],
        left: &[Option<Rotation3<f64>>],
        least: f64,
    ) -> Vec<Rotation3<f64>> {
        let mut next = vec![Rotation3::identity(); turns.len()];
        for &j in &self.order {
            let parent = usize::try_from(self.skeleton.parents[j]).map_or(Rotation3::identity(), |p| next[p]);
            next[j] = match left[j] {
                Some(left) if (parent.inverse() * turns[j] * left).angle() > least => turns[j] * left,
                _ => parent,
            };
        }
        next
    }

    /// `G_j`: from the source's pose to the target's.
    fn matrices(&self, turns: &[Rotation3<f64>]) -> Vec<Mat4> {
        let mut unposed = self.at.clone();
        let mut matrices = vec![Mat4::identity(); turns.len()];
        for &j in &self.order {
            if let Ok(p) = usize::try_from(self.skeleton.parents[j]) {
                unposed[j] = unposed[p] + turns[p].inverse() * (self.at[j] - self.at[p]);
            }
            matrices[j] = turns[j].to_homogeneous();
            let shift = self.at[j] - turns[j] * unposed[j];
            matrices[j].fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
        }
        matrices
    }

    /// Undoes the blend of `matrices` at every point.
    ///
    /// # Errors
    /// The first point at which it cannot be undone.
    fn undo(&self, matrices: &[Mat4], points: &[Vec3]) -> Result<Vec<Vec3>, usize> {
        let back = |(i, p): (usize, &Vec3)| {
            let blend = blended_matrix(self.skin, i, matrices);
            let inverse = (blend.determinant() > LEAST_DETERMINANT).then(|| blend.try_inverse()).flatten();
            inverse.map(|m| transform(&m, p)).ok_or(i)
        };
        points.iter().enumerate().map(back).collect()
    }
}

/// The rotation of most of the body: least distances instead of squares, by reweighting, so that a
/// raised leg does not tilt the rest.
fn facing(source: &[Vec3], points: &[Vec3]) -> Matrix3<f64> {
    let mut weights = vec![1.0; points.len()];
    for _ in 0..FACING_ROUNDS {
        let motion = Motion::best(source, points, &weights);
        let distances = source.iter().zip(points).map(|(x, y)| (motion.apply(x) - y).norm());
        weights = distances.map(|d| 1.0 / (d + FACING_SCALE)).collect();
    }
    nearest_rotation(&Motion::best(source, points, &weights).linear)
}

/// Weighted moments of corresponding points.
#[derive(Clone, Default)]
struct Region {
    weight: f64,
    x: Vec3,
    y: Vec3,
    yx: Matrix3<f64>,
}

impl Region {
    fn add(&mut self, weight: f64, x: &Vec3, y: &Vec3) {
        self.weight += weight;
        self.x += x * weight;
        self.y += y * weight;
        self.yx += y * x.transpose() * weight;
    }

    fn turn(&self) -> Option<Matrix3<f64>> {
        (self.weight >= LEAST_SKIN)
            .then(|| nearest_rotation(&(self.yx - self.y * self.x.transpose() / self.weight)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::skinning::{pose_matrices, skin_points};
    use crate::model::TriMesh;

    const RINGS: usize = 41;
    const SIDES: usize = 12;

    /// A tube of radius `r` along x with joints at 0, 1 and 2 m, whose skin goes from one to the
    /// next within 30 cm.
    fn tube(r: f64) -> Character {
        let mut body = TriMesh::default();
        let mut skin = Skin { influences: 2, ..Skin::default() };
        for i in 0..RINGS {
            let x = 3.0 * i as f64 / (RINGS - 1) as f64;
            for k in 0..SIDES {
                let angle = std::f64::consts::TAU * k as f64 / SIDES as f64;
                body.points.push(Vec3::new(x, r * angle.sin(), r * angle.cos() * (1.0 + 0.2 * x)));
                let share = |joint: f64| ((x - joint) / 0.3 + 0.5).clamp(0.0, 1.0);
                let (joint, next) = if x < 1.5 { (0, share(1.0)) } else { (1, share(2.0)) };
                skin.joint_indices.extend([joint, joint + 1]);
                skin.joint_weights.extend([1.0 - next, next]);
            }
        }
        let at = |x: f64| {
            let mut m = [[0.0; 4]; 4];
            (0..4).for_each(|i| m[i][i] = 1.0);
            m[0][3] = x;
            m
        };
        let skeleton = Skeleton {
            joints: ["root", "root/elbow", "root/elbow/wrist"].map(str::to_owned).to_vec(),
            parents: vec![-1, 0, 1],
            world_from_joint: [0.0, 1.0, 2.0].map(at).to_vec(),
        };
        Character { path: "/Body".to_owned(), body, skin, skeleton, ..Character::default() }
    }

    /// The tube with its elbow and its wrist turned [degrees].
    fn bent(straight: &Character, elbow: f64, wrist: f64) -> Character {
        let turn = |degrees: f64| Rotation3::from_axis_angle(&Vec3::z_axis(), degrees.to_radians());
        let turns = [Rotation3::identity(), turn(elbow), turn(wrist)];
        let matrices = pose_matrices(&straight.skeleton, &turns, &Vec3::zeros()).unwrap();
        let mut posed = straight.clone();
        posed.body.points = skin_points(&straight.body.points, &straight.skin, &matrices);
        for (bind, matrix) in posed.skeleton.world_from_joint.iter_mut().zip(&matrices) {
            *bind = to_rows(&(matrix * from_rows(bind)));
        }
        posed
    }

    fn farthest(a: &[Vec3], b: &[Vec3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn another_shape_or_place_is_no_other_pose() {
        let (thin, mut thick) = (tube(0.05), tube(0.15));
        let turn = Rotation3::from_euler_angles(0.3, 2.0, -1.0);
        thick.body.points.iter_mut().for_each(|p| *p = turn * *p + Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(unpose(&thin.body.points, &thick, 15.0).unwrap().map(|u| u.info), None);
        let slightly = bent(&thin, 10.0, 0.0);
        assert!(unpose(&thin.body.points, &slightly, 15.0).unwrap().is_none());
    }

    #[test]
    fn a_bent_body_is_straightened() {
        let straight = tube(0.1);
        let target = bent(&straight, 50.0, -30.0);
        let unposed = unpose(&straight.body.points, &target, 15.0).unwrap().unwrap();
        assert!(unposed.info.left_degrees < 1.0, "{:?}", unposed.info);
        // As it was, but for where it stands: which of its parts faces as before is open.
        let (from, to) = (&straight.body.points, &unposed.character.body.points);
        let motion = Motion::best(from, to, &vec![1.0; from.len()]);
        let moved: Vec<Vec3> = from.iter().map(|p| motion.apply(p)).collect();
        assert!(farthest(&moved, to) < 0.01, "{} m of a body of 3 m", farthest(&moved, to));
        let joint = |j: usize| {
            let m = unposed.character.skeleton.world_from_joint[j];
            Vec3::new(m[0][3], m[1][3], m[2][3])
        };
        assert!(((joint(2) - joint(0)).norm() - 2.0).abs() < 0.01);
        // What hangs on the skin comes back with it.
        let back = unposed.pose(&unposed.character.body.points, &target.skin);
        assert!(farthest(&back, &target.body.points) < 1e-12);
    }

    #[test]
    fn what_is_folded_over_is_refused() {
        let straight = tube(0.1);
        let error = unpose(&straight.body.points, &bent(&straight, 178.0, 0.0), 15.0).unwrap_err();
        assert!(matches!(&error, PoseError::TooFar { path, .. } if path == "/Body"), "{error}");
        let mut orphan = bent(&straight, 50.0, 0.0);
        orphan.skeleton.parents = vec![-1, 2, 1];
        let error = unpose(&straight.body.points, &orphan, 15.0).unwrap_err();
        assert!(matches!(error, PoseError::Skeleton { .. }));
    }
}
