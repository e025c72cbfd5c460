use super::names::Part;
use super::*;

/// A figure in A-pose facing +Z, with a joint's path, parent and position.
fn skeleton(names: &dyn Fn(&str) -> String) -> Skeleton {
    let mut rows: Vec<(String, i32, [f64; 3])> = vec![
        ("hips".into(), -1, [0.0, 0.95, 0.0]),
        ("spine1".into(), 0, [0.0, 1.05, 0.0]),
        ("spine2".into(), 1, [0.0, 1.2, 0.0]),
        ("chest".into(), 2, [0.0, 1.35, 0.0]),
        ("neck".into(), 3, [0.0, 1.5, 0.0]),
        ("head".into(), 4, [0.0, 1.6, 0.02]),
        ("headend".into(), 5, [0.0, 1.78, 0.02]),
    ];
    for (side, x) in [("Left", 1.0), ("Right", -1.0)] {
        let mut add = |name: &str, parent: i32, p: [f64; 3]| {
            rows.push((format!("{side}{name}"), parent, [x * p[0], p[1], p[2]]));
            rows.len() as i32 - 1
        };
        let mut j = add("Collar", 3, [0.03, 1.45, 0.0]);
        for (name, p) in [
            ("UpperArm", [0.19, 1.42, 0.0]),
            ("ForeArm", [0.38, 1.22, 0.0]),
            ("Hand", [0.56, 1.04, 0.05]),
            ("Finger1", [0.62, 0.98, 0.07]),
            ("Finger2", [0.65, 0.95, 0.08]),
        ] {
            j = add(name, j, p);
        }
        j = 0;
        for (name, p) in [
            ("Thigh", [0.1, 0.92, 0.0]),
            ("Shin", [0.12, 0.5, 0.02]),
            ("Foot", [0.13, 0.08, 0.0]),
            ("ToeBase", [0.14, 0.02, 0.12]),
        ] {
            j = add(name, j, p);
        }
    }
    let at = |p: [f64; 3]| {
        let mut m = [[0.0; 4]; 4];
        (0..4).for_each(|i| m[i][i] = 1.0);
        (0..3).for_each(|i| m[i][3] = p[i]);
        m
    };
    Skeleton {
        joints: rows.iter().map(|r| names(&r.0)).collect(),
        parents: rows.iter().map(|r| r.1).collect(),
        world_from_joint: rows.iter().map(|r| at(r.2)).collect(),
    }
}

fn named() -> Skeleton {
    skeleton(&|name| name.to_owned())
}

/// The same joints turned about the vertical axis by `angle` and moved.
fn turned(mut skeleton: Skeleton, angle: f64) -> Skeleton {
    let turn = Rotation3::from_axis_angle(&Vec3::y_axis(), angle);
    for m in &mut skeleton.world_from_joint {
        let p = turn * Vec3::new(m[0][3], m[1][3], m[2][3]) + Vec3::new(3.0, 0.5, -2.0);
        (0..3).for_each(|k| m[k][3] = p[k]);
    }
    skeleton
}

fn joint(skeleton: &Skeleton, name: &str) -> usize {
    skeleton.joints.iter().position(|j| j == name).expect("a joint of this name")
}

fn posed(skeleton: &Skeleton, pose: &str) -> Vec<Vec3> {
    let set = poses(skeleton).expect("a tree");
    let pose = set.poses.iter().find(|p| p.name == pose).expect("a pose of this name");
    let figure = Figure::find(skeleton).expect("a tree");
    figure.positions.iter().zip(&pose.matrices).map(|(p, m)| skinning::transform(m, p)).collect()
}

#[test]
fn parts_are_found_by_name() {
    let skeleton = named();
    let figure = Figure::find(&skeleton).unwrap();
    let at = |name: &str| joint(&skeleton, name);
    assert_eq!(
        figure.arms[1],
        Some(Arm {
            clavicle: Some(at("RightCollar")),
            upper: at("RightUpperArm"),
            fore: at("RightForeArm"),
            hand: at("RightHand")
        })
    );
    assert_eq!(
        figure.legs[0],
        Some(Leg { thigh: at("LeftThigh"), shin: at("LeftShin"), foot: at("LeftFoot") })
    );
    assert_eq!(figure.spine, ["spine1", "spine2", "chest"].map(at));
    assert_eq!(figure.neck, ["neck", "head"].map(at));
    assert_eq!(names::part("head"), Some(Part::Head));
}

#[test]
fn names_of_other_rigs_say_the_same() {
    // Mixamo's `LeftArm` and `LeftLeg`, and SMPL's joints after what lies at them.
    let other = |words: &'static [(&str, &str)]| {
        move |name: &str| {
            let found = words.iter().find(|(ours, _)| name.ends_with(ours));
            found.map_or_else(|| name.to_owned(), |(ours, theirs)| name.replace(ours, theirs))
        }
    };
    let mixamo = other(&[("UpperArm", "Arm"), ("Collar", "Shoulder"), ("Thigh", "UpLeg"), ("Shin", "Leg")]);
    let smpl = other(&[
        ("UpperArm", "_shoulder"),
        ("ForeArm", "_elbow"),
        ("Hand", "_wrist"),
        ("Thigh", "_hip"),
        ("Shin", "_knee"),
        ("Foot", "_ankle"),
    ]);
    let ours = Figure::find(&named()).unwrap();
    for names in [&mixamo as &dyn Fn(&str) -> String, &smpl] {
        let theirs = Figure::find(&skeleton(names)).unwrap();
        assert_eq!((theirs.arms, theirs.legs), (ours.arms, ours.legs));
        assert_eq!((theirs.spine, theirs.neck), (ours.spine.clone(), ours.neck.clone()));
    }
}

#[test]
fn parts_are_found_by_place_where_names_tell_nothing() {
    let ours = Figure::find(&named()).unwrap();
    let mut nameless = named();
    nameless.joints = (0..nameless.joints.len()).map(|i| format!("joint{i}")).collect();
    for skeleton in [turned(nameless.clone(), 2.1), nameless] {
        let theirs = Figure::find(&skeleton).unwrap();
        assert_eq!((theirs.arms, theirs.legs), (ours.arms, ours.legs));
        assert_eq!(theirs.spine, ours.spine);
    }
}

#[test]
fn limbs_point_where_the_pose_says() {
    let skeleton = named();
    let at = |name: &str| joint(&skeleton, name);
    let direction = |points: &[Vec3], a: &str, b: &str| (points[at(b)] - points[at(a)]).normalize();
    let t = posed(&skeleton, "t");
    assert!((direction(&t, "LeftUpperArm", "LeftForeArm") - Vec3::x()).norm() < 1e-12);
    assert!((direction(&t, "RightForeArm", "RightHand") + Vec3::x()).norm() < 1e-12);
    let up = posed(&skeleton, "arms_up");
    assert!(up[at("LeftHand")].y > 1.9 && up[at("LeftUpperArm")].y > 1.42);
    let sit = posed(&skeleton, "sit");
    assert!(direction(&sit, "LeftThigh", "LeftShin").z > 0.95);
    assert!(direction(&sit, "RightShin", "RightFoot").y < -0.99);
    let bend = posed(&skeleton, "bend");
    assert!(bend[at("head")].z > 0.3 && (bend[at("LeftFoot")] - Vec3::new(0.13, 0.08, 0.0)).norm() < 1e-12);
    let twist = posed(&skeleton, "twist");
    let across = direction(&twist, "RightCollar", "LeftCollar");
    assert!((across - Vec3::new(0.5f64.sqrt(), 0.0, -(0.5f64.sqrt()))).norm() < 1e-12, "turned to the left");
    let lean = posed(&skeleton, "lean");
    assert!(lean[at("head")].x > 0.15, "leans to the left");
}

#[test]
fn a_pose_turns_with_the_figure() {
    let angle = 0.8;
    let (here, there) = (named(), turned(named(), angle));
    let turn = Rotation3::from_axis_angle(&Vec3::y_axis(), angle);
    for stance in stances() {
        let (a, b) = (posed(&here, stance.name), posed(&there, stance.name));
        for (p, q) in a.iter().zip(&b) {
            assert!((turn * p + Vec3::new(3.0, 0.5, -2.0) - q).norm() < 1e-9, "{}", stance.name);
        }
    }
}

#[test]
fn a_pole_has_no_pose() {
    let mut pole = named();
    pole.joints.truncate(3);
    pole.parents.truncate(3);
    pole.world_from_joint.truncate(3);
    let set = poses(&pole).unwrap();
    assert!(set.poses.is_empty());
    assert_eq!(set.left_out.len(), stances().len());
    assert!(stances().len() >= 12);
}
