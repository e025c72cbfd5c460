//! Linear blend skinning: where a pose takes the points of a body or a garment.
//!
//! A pose turns every joint by a rotation `R_j` **about the world's axes as they are in the
//! bind pose**, at the joint's bind position `c_j`; children follow. With the parent's skinning
//! matrix `G_p` (the identity above a root),
//!
//! `G_j = G_p T(c_j) R_j T(-c_j)`, `posed_world_j = G_j bind_world_j`,
//!
//! so a pose depends on where joints are and not on how a rig turns their local axes. A
//! rotation `L` in the joint's own frame is `R = B L B^-1` with the joint's bind rotation `B`
//! ([`world_rotation`]). A point moves by the blend `M = sum_j w_j G_j` of its influences
//! [Magnenat-Thalmann 1988], normalised by `sum_j w_j` as USD's skinning is not: weights that
//! miss 1 by rounding must not scale a character. `M` is affine, and its inverse unposes the
//! point ([`blended_matrix`]).

use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3};
use rayon::prelude::*;
use thiserror::Error;

use crate::model::{Skeleton, Skin, Vec3};

/// An affine map of world space; translations in metres.
pub type Mat4 = Matrix4<f64>;

/// Why a skeleton cannot be posed.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum SkinningError {
    /// Arrays of a skeleton or a pose do not have one element for each joint.
    #[error("{what}: {found} elements for {expected} joints")]
    Length { what: &'static str, found: usize, expected: usize },
    /// A joint is its own ancestor, or its parent is not there.
    #[error("joint {joint}: its parent {parent} is no joint above it")]
    Parent { joint: String, parent: i32 },
    /// A joint's bind transform has no inverse.
    #[error("joint {joint}: its bind transform is singular")]
    Singular { joint: String },
}

/// A skeleton's joint transforms in world space, shape `[joints]`.
///
/// # Errors
/// [`SkinningError::Length`].
pub fn bind_world(skeleton: &Skeleton) -> Result<Vec<Mat4>, SkinningError> {
    expect("parents", skeleton.parents.len(), skeleton)?;
    expect("bind transforms", skeleton.world_from_joint.len(), skeleton)?;
    Ok(skeleton.world_from_joint.iter().map(from_rows).collect())
}

/// A matrix from its rows, as a [`Skeleton`] keeps it.
pub fn from_rows(rows: &[[f64; 4]; 4]) -> Mat4 {
    Mat4::from_fn(|r, c| rows[r][c])
}

/// The rows of a matrix.
pub fn to_rows(matrix: &Mat4) -> [[f64; 4]; 4] {
    std::array::from_fn(|r| std::array::from_fn(|c| matrix[(r, c)]))
}

/// World transforms after every joint was turned by its rotation about the bind pose's world
/// axes and everything was moved by `translation` [m]; shape `[joints]`.
///
/// # Errors
/// Arrays that do not fit, or parents that are no tree: [`SkinningError`].
pub fn posed_world(
    skeleton: &Skeleton,
    rotations: &[Rotation3<f64>],
    translation: &Vec3,
) -> Result<Vec<Mat4>, SkinningError> {
    let bind = bind_world(skeleton)?;
    let motion = motions(skeleton, &bind, rotations, translation)?;
    Ok(motion.iter().zip(&bind).map(|(g, b)| g * b).collect())
}

/// Skinning matrices `posed_world * bind_world^-1`, shape `[joints]`: what moves a point of the
/// bind pose that hangs on one joint alone.
///
/// # Errors
/// Arrays that do not fit, or a singular bind transform: [`SkinningError`].
pub fn skinning_matrices(skeleton: &Skeleton, posed_world: &[Mat4]) -> Result<Vec<Mat4>, SkinningError> {
    let bind = bind_world(skeleton)?;
    expect("posed transforms", posed_world.len(), skeleton)?;
    let matrix = |(j, posed): (usize, &Mat4)| {
        let inverse = bind[j].try_inverse();
        inverse
            .map(|inverse| posed * inverse)
            .ok_or_else(|| SkinningError::Singular { joint: skeleton.joints[j].clone() })
    };
    posed_world.iter().enumerate().map(matrix).collect()
}

/// Skinning matrices of a pose given by rotations, as [`posed_world`] takes them; bind
/// transforms need not be invertible.
///
/// # Errors
/// As [`posed_world`].
pub fn pose_matrices(
    skeleton: &Skeleton,
    rotations: &[Rotation3<f64>],
    translation: &Vec3,
) -> Result<Vec<Mat4>, SkinningError> {
    motions(skeleton, &bind_world(skeleton)?, rotations, translation)
}

/// The rotation about world axes that turns a joint by `local` about the axes of its own frame
/// `bind` (whose scale is left out of account).
pub fn world_rotation(bind: &Mat4, local: &Rotation3<f64>) -> Rotation3<f64> {
    let frame = Rotation3::from_matrix(&bind.fixed_view::<3, 3>(0, 0).into_owned());
    frame * local * frame.inverse()
}

/// The map of point `point` of a skin: the normalised blend of its joints' matrices. It is the
/// identity for a point without weight.
///
/// # Panics
/// If the skin names a joint without a matrix; skins are checked where they are read.
pub fn blended_matrix(skin: &Skin, point: usize, matrices: &[Mat4]) -> Mat4 {
    let influences = point * skin.influences..(point + 1) * skin.influences;
    let pairs = influences.map(|i| (skin.joint_indices[i], skin.joint_weights[i]));
    blend(pairs, matrices)
}

/// The normalised blend of matrices under (joint, weight) pairs; the identity without weight.
pub fn blend(weights: impl Iterator<Item = (u32, f64)>, matrices: &[Mat4]) -> Mat4 {
    let (mut sum, mut total) = (Mat4::zeros(), 0.0);
    for (joint, weight) in weights.filter(|w| w.1 != 0.0) {
        sum += matrices[joint as usize] * weight;
        total += weight;
    }
    if total == 0.0 { Mat4::identity() } else { sum / total }
}

/// `matrix` applied to a point.
pub fn transform(matrix: &Mat4, p: &Vec3) -> Vec3 {
    let linear: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    linear * p + matrix.fixed_view::<3, 1>(0, 3)
}

/// Points of the bind pose, moved with their skin; shape `[n, 3]` [m].
///
/// # Panics
/// If the skin does not have influences for every point, or names a joint without a matrix.
pub fn skin_points(points: &[Vec3], skin: &Skin, matrices: &[Mat4]) -> Vec<Vec3> {
    assert_eq!(skin.joint_weights.len(), points.len() * skin.influences, "influences for every point");
    points.par_iter().enumerate().map(|(i, p)| transform(&blended_matrix(skin, i, matrices), p)).collect()
}

/// Checks that a skeleton's arrays fit and that its joints make a tree.
///
/// # Errors
/// [`SkinningError::Length`], [`SkinningError::Parent`].
pub fn check_tree(skeleton: &Skeleton) -> Result<(), SkinningError> {
    expect("parents", skeleton.parents.len(), skeleton)?;
    parents_first(skeleton).map(drop)
}

fn motions(
    skeleton: &Skeleton,
    bind: &[Mat4],
    rotations: &[Rotation3<f64>],
    translation: &Vec3,
) -> Result<Vec<Mat4>, SkinningError> {
    expect("rotations", rotations.len(), skeleton)?;
    let mut motion = vec![Translation3::from(*translation).to_homogeneous(); bind.len()];
    for j in parents_first(skeleton)? {
        let parent = skeleton.parents[j];
        if parent >= 0 {
            motion[j] = motion[parent as usize];
        }
        let at: Vec3 = bind[j].fixed_view::<3, 1>(0, 3).into_owned();
        let back = at - rotations[j] * at;
        motion[j] *= Translation3::from(back).to_homogeneous() * rotations[j].to_homogeneous();
    }
    Ok(motion)
}

/// The joints in an order in which every parent stands before its children.
///
/// # Errors
/// Parents that are no tree: [`SkinningError::Parent`].
pub fn parents_first(skeleton: &Skeleton) -> Result<Vec<usize>, SkinningError> {
    let count = skeleton.parents.len();
    let mut children = vec![Vec::new(); count];
    let mut order = Vec::new();
    for (j, &parent) in skeleton.parents.iter().enumerate() {
        match usize::try_from(parent) {
            Err(_) => order.push(j),
            Ok(p) if p < count => children[p].push(j),
            Ok(_) => return Err(SkinningError::Parent { joint: skeleton.joints[j].clone(), parent }),
        }
    }
    let mut next = 0;
    while let Some(&j) = order.get(next) {
        order.append(&mut children[j]);
        next += 1;
    }
    if order.len() == count {
        return Ok(order);
    }
    let reached: std::collections::BTreeSet<usize> = order.into_iter().collect();
    let j = (0..count).find(|j| !reached.contains(j)).unwrap_or(0);
    Err(SkinningError::Parent { joint: skeleton.joints[j].clone(), parent: skeleton.parents[j] })
}

fn expect(what: &'static str, found: usize, skeleton: &Skeleton) -> Result<(), SkinningError> {
    let expected = skeleton.joints.len();
    if found == expected { Ok(()) } else { Err(SkinningError::Length { what, found, expected }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain along x with a joint every metre, each with turned and scaled axes of its own.
    fn chain(count: usize) -> Skeleton {
        let joint = |j: usize| {
            let turn = Rotation3::from_euler_angles(0.3 * j as f64, 1.1, -0.4).to_homogeneous();
            let frame = turn.prepend_scaling(0.01);
            let m = Translation3::new(j as f64, 0.0, 0.0).to_homogeneous() * frame;
            std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
        };
        Skeleton {
            joints: (0..count).map(|j| format!("j{j}")).collect(),
            parents: (0..count as i32).map(|j| j - 1).collect(),
            world_from_joint: (0..count).map(joint).collect(),
        }
    }

    fn skin(rows: &[[(u32, f64); 2]]) -> Skin {
        Skin {
            influences: 2,
            joint_indices: rows.iter().flatten().map(|w| w.0).collect(),
            joint_weights: rows.iter().flatten().map(|w| w.1).collect(),
        }
    }

    fn quarter() -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vec3::z_axis(), std::f64::consts::FRAC_PI_2)
    }

    #[test]
    fn nothing_moves_in_the_bind_pose() {
        let skeleton = chain(3);
        let bind = bind_world(&skeleton).unwrap();
        let posed = posed_world(&skeleton, &[Rotation3::identity(); 3], &Vec3::zeros()).unwrap();
        assert!(posed.iter().zip(&bind).all(|(p, b)| (p - b).amax() < 1e-14));
        let matrices = skinning_matrices(&skeleton, &posed).unwrap();
        assert!(matrices.iter().all(|m| (m - Mat4::identity()).amax() < 1e-12));
    }

    #[test]
    fn a_motion_of_the_root_is_rigid() {
        let skeleton = chain(3);
        let turn = Rotation3::from_euler_angles(0.4, -0.9, 2.0);
        let rotations = [turn, Rotation3::identity(), Rotation3::identity()];
        let shift = Vec3::new(0.2, -0.5, 1.0);
        let matrices = pose_matrices(&skeleton, &rotations, &shift).unwrap();
        let points = [Vec3::new(0.3, 0.1, 0.0), Vec3::new(1.7, -0.1, 0.2)];
        let moved = skin_points(&points, &skin(&[[(0, 0.5), (2, 0.5)], [(1, 1.0), (0, 0.0)]]), &matrices);
        for (p, q) in points.iter().zip(moved) {
            assert!((q - (turn * p + shift)).norm() < 1e-14, "the root joint is at the origin");
        }
    }

    /// The elbow at x = 1 bends by a right angle and the wrist at x = 2 by another.
    #[test]
    fn two_bones_bend_as_on_paper() {
        let mut skeleton = chain(3);
        let rotations = [Rotation3::identity(), quarter(), quarter()];
        let points = [Vec3::new(1.5, 0.0, 0.0), Vec3::new(2.5, 0.0, 0.0), Vec3::new(1.0, 0.2, 0.0)];
        let skin = skin(&[[(1, 1.0), (0, 0.0)], [(2, 3.0), (0, 0.0)], [(0, 0.5), (1, 0.5)]]);
        let expected = [Vec3::new(1.0, 0.5, 0.0), Vec3::new(0.5, 1.0, 0.0), Vec3::new(0.9, 0.1, 0.0)];
        let matrices = pose_matrices(&skeleton, &rotations, &Vec3::zeros()).unwrap();
        for (q, e) in skin_points(&points, &skin, &matrices).iter().zip(&expected) {
            assert!((q - e).norm() < 1e-14, "{q} {e}");
        }
        // The same from posed transforms, and with the children listed before their parents.
        let posed = posed_world(&skeleton, &rotations, &Vec3::zeros()).unwrap();
        let same = skinning_matrices(&skeleton, &posed).unwrap();
        assert!(same.iter().zip(&matrices).all(|(a, b)| (a - b).amax() < 1e-12));
        skeleton.joints.reverse();
        skeleton.world_from_joint.reverse();
        skeleton.parents = vec![1, 2, -1];
        let reversed: Vec<_> = rotations.iter().rev().copied().collect();
        let again = pose_matrices(&skeleton, &reversed, &Vec3::zeros()).unwrap();
        assert!(again.iter().rev().zip(&matrices).all(|(a, b)| (a - b).amax() < 1e-14));
    }

    #[test]
    fn a_rotation_in_the_joints_frame_is_the_same_about_world_axes() {
        let skeleton = chain(2);
        let bind = bind_world(&skeleton).unwrap();
        let local = Rotation3::from_euler_angles(0.5, 0.2, -0.7);
        let expected = bind[1] * local.to_homogeneous();
        let world = [Rotation3::identity(), world_rotation(&bind[1], &local)];
        let posed = posed_world(&skeleton, &world, &Vec3::zeros()).unwrap();
        assert!((posed[1] - expected).amax() < 1e-12);
    }

    #[test]
    fn the_inverse_of_the_blend_gives_back_the_bind_point() {
        let skeleton = chain(3);
        let rotations = [Rotation3::identity(), Rotation3::from_euler_angles(0.3, 0.8, 0.5), quarter()];
        let matrices = pose_matrices(&skeleton, &rotations, &Vec3::x()).unwrap();
        let skin = skin(&[[(0, 0.3), (1, 0.7)], [(2, 0.6), (1, 0.4)]]);
        let points = [Vec3::new(0.9, 0.2, 0.1), Vec3::new(1.8, -0.1, 0.3)];
        for (i, q) in skin_points(&points, &skin, &matrices).iter().enumerate() {
            let back = blended_matrix(&skin, i, &matrices).try_inverse().expect("affine");
            assert!((transform(&back, q) - points[i]).norm() < 1e-13);
        }
    }

    #[test]
    fn what_is_no_skeleton_is_refused() {
        let mut skeleton = chain(3);
        let still = [Rotation3::identity(); 3];
        let short = pose_matrices(&skeleton, &still[1..], &Vec3::zeros());
        assert_eq!(short.unwrap_err(), SkinningError::Length { what: "rotations", found: 2, expected: 3 });
        skeleton.parents = vec![-1, 2, 1];
        let circle = pose_matrices(&skeleton, &still, &Vec3::zeros());
        assert_eq!(circle.unwrap_err(), SkinningError::Parent { joint: "j1".to_owned(), parent: 2 });
        skeleton = chain(3);
        let posed = bind_world(&skeleton).unwrap();
        skeleton.world_from_joint[2] = [[0.0; 4]; 4];
        let flat = skinning_matrices(&skeleton, &posed);
        assert_eq!(flat.unwrap_err(), SkinningError::Singular { joint: "j2".to_owned() });
    }
}
