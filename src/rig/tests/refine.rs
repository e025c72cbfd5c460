//! Weights refined against poses.

use super::*;
use crate::certificate::posed;
use crate::geometry::skinning::Mat4;
use crate::pose::Pose;
use crate::rig::refine::{self, Worn};

/// The far half of a limb along x bends at x = 0.3 about an axis, by an angle [degrees].
fn bend(name: &str, axis: &Vec3, degrees: f64) -> Pose {
    let joint = Vec3::new(0.3, 0.0, 0.0);
    let turn = Mat4::from_scaled_axis(axis * degrees.to_radians());
    let matrix = Mat4::new_translation(&joint) * turn * Mat4::new_translation(&-joint);
    Pose { name: name.to_owned(), matrices: vec![Mat4::identity(), matrix] }
}

fn poses() -> Vec<Pose> {
    vec![bend("up", &Vec3::z(), 60.0), bend("down", &Vec3::z(), -60.0)]
}

/// A limb with a short blend at its joint.
fn limb() -> Character {
    let body = tube(Vec3::zeros(), Vec3::new(0.6, 0.0, 0.0), 0.05, 32, 60);
    character(body, |p| ((p.x - 0.27) / 0.06).clamp(0.0, 1.0))
}

/// A sleeve in two parts sewn at the joint, and weights that blend beyond it.
fn sleeve() -> (Garment, Skin) {
    let at = |x: f64| Vec3::new(x, 0.0, 0.0);
    let (left, right) = (tube(at(0.05), at(0.3), 0.056, 32, 25), tube(at(0.3), at(0.55), 0.056, 32, 25));
    let first = left.points.len() as u32;
    let pairs: Vec<[u32; 2]> = (0..32).map(|j| [first - 32 + j, first + j]).collect();
    let seam = AuthoredSeam { name: "join".to_owned(), pairs, offset: false };
    let cloth = garment(join(&[&left, &right]), vec![seam]);
    let far = |p: &Vec3| ((p.x - 0.32) / 0.1).clamp(0.0, 1.0);
    let skin = Skin {
        influences: 2,
        joint_indices: [0, 1].repeat(cloth.points.len()),
        joint_weights: cloth.points.iter().flat_map(|p| [1.0 - far(p), far(p)]).collect(),
    };
    (cloth, skin)
}

fn refined(body: &Character, cloth: &Garment, skin: &Skin, rounds: usize) -> (Skin, Info) {
    let (mut skin, mut info) = (skin.clone(), Info::default());
    let worn = Worn { sewn: Sewn::new(cloth, &cloth.points), skin: &mut skin, info: &mut info };
    let params = Params { refine: rounds, ..Params::default() };
    refine::run(body, &OuterSkin::new(&body.body), &mut [worn], &poses(), &params).expect("refines");
    (skin, info)
}

/// Mean depth over poses, by the certificate's own check [m].
fn depth(body: &Character, cloth: &Garment, skin: &Skin, poses: &[Pose]) -> f64 {
    let mesh = TriMesh { points: cloth.points.clone(), triangles: cloth.triangles.clone() };
    let cloths = [posed::Cloth { mesh: &mesh, skin }];
    let figures = posed::measure(body, &OuterSkin::new(&body.body), &cloths, poses).remove(0);
    figures.iter().map(|f| f.depth_mean_m).sum::<f64>() / poses.len() as f64
}

#[test]
fn cloth_that_sinks_in_poses_is_put_back() {
    let (body, (cloth, skin)) = (limb(), sleeve());
    let (new, info) = refined(&body, &cloth, &skin, 6);
    let (before, after) = (depth(&body, &cloth, &skin, &poses()), depth(&body, &cloth, &new, &poses()));
    assert!(before > 1e-3, "{before}: not a hard case");
    assert!(after < 0.5 * before, "{after} of {before}");
    assert!(info.refined > 0.1 && info.sunk_m[1] < 0.5 * info.sunk_m[0], "{info:?}");
    // A pose that it was not fitted to gains too.
    let other = [bend("aside", &Vec3::y(), 50.0)];
    let (before, after) = (depth(&body, &cloth, &skin, &other), depth(&body, &cloth, &new, &other));
    assert!(after < 0.9 * before, "{after} of {before}");
}

/// Shares of the faces that are inside, summed over the poses.
#[test]
fn skin_between_vertices_is_covered_again() {
    let (body, (cloth, skin)) = (limb(), sleeve());
    let (new, _) = refined(&body, &cloth, &skin, 6);
    let faces = |skin: &Skin| {
        let mesh = TriMesh { points: cloth.points.clone(), triangles: cloth.triangles.clone() };
        let cloths = [posed::Cloth { mesh: &mesh, skin }];
        let figures = posed::measure(&body, &OuterSkin::new(&body.body), &cloths, &poses()).remove(0);
        figures.iter().map(|f| f.faces_inside).sum::<f64>()
    };
    let (before, after) = (faces(&skin), faces(&new));
    assert!(before > 0.01, "{before}: not a hard case");
    assert!(after < 0.6 * before, "{after} of {before}");
}

#[test]
fn refined_weights_are_a_partition_of_unity_and_identical_across_seams() {
    let (body, (cloth, skin)) = (limb(), sleeve());
    let (new, _) = refined(&body, &cloth, &skin, 6);
    assert_eq!(new.influences, 2);
    assert!(new.joint_weights.iter().all(|w| (0.0..=1.0).contains(w)));
    assert!(new.joint_weights.chunks(2).all(|w| (w[0] + w[1] - 1.0).abs() < 1e-12));
    let mut of_node = vec![None; cloth.groups.node_count];
    for (v, &node) in cloth.groups.node_of_vertex.iter().enumerate() {
        let weight = second(&new, v);
        assert_eq!(*of_node[node as usize].get_or_insert(weight), weight);
    }
}

#[test]
fn what_does_not_sink_is_left_as_it_is() {
    let (body, (cloth, skin)) = (limb(), sleeve());
    assert_eq!(refined(&body, &cloth, &skin, 0).0, skin);
    let own: Vec<f64> = cloth.points.iter().map(|p| ((p.x - 0.27) / 0.06).clamp(0.0, 1.0)).collect();
    let follows = Skin { joint_weights: own.iter().flat_map(|w| [1.0 - w, *w]).collect(), ..skin };
    let (new, info) = refined(&body, &cloth, &follows, 6);
    let before = depth(&body, &cloth, &follows, &poses());
    assert!(depth(&body, &cloth, &new, &poses()) <= before);
    assert!(info.sunk_m[1] <= info.sunk_m[0]);
    // Far from the bend nothing was touched.
    let far = |v: &usize| (cloth.points[*v].x - 0.3).abs() > 0.2;
    for v in (0..cloth.points.len()).filter(far) {
        assert!((second(&new, v) - second(&follows, v)).abs() < 1e-2, "vertex {v}");
    }
}
