//! Tubes for limbs: closed forms, and skeletons of several makers.

use super::ease::{Worn, ring};
use super::hold::{HeldGirth, Hold, Params, SourceEase};
use super::joints::Joints;
use super::section::{Plane, cut, hull_length};
use super::*;
use crate::model::garment::GarmentSource;
use crate::model::{Character, Garment, Panel, Skeleton, Skin, TriMesh, Vec2, Vec3};

const SIDES: u32 = 48;

/// Length around a regular polygon of [`SIDES`] in a circle of radius `r`.
fn around(r: f64) -> f64 {
    f64::from(SIDES) * 2.0 * r * (std::f64::consts::PI / f64::from(SIDES)).sin()
}

/// Adds a tube of radius `r` from `a` to `b`.
fn add_tube(mesh: &mut TriMesh, a: Vec3, b: Vec3, r: f64) {
    let rings = 12;
    let axis = (b - a).normalize();
    let u = axis.cross(&if axis.x.abs() < 0.5 { Vec3::x() } else { Vec3::y() }).normalize();
    let v = axis.cross(&u);
    let base = mesh.points.len() as u32;
    for k in 0..=rings {
        for s in 0..SIDES {
            let angle = std::f64::consts::TAU * f64::from(s) / f64::from(SIDES);
            let at = a + (b - a) * (f64::from(k) / f64::from(rings));
            mesh.points.push(at + (u * angle.cos() + v * angle.sin()) * r);
        }
    }
    for k in 0..rings {
        for s in 0..SIDES {
            let at = |k: u32, s: u32| base + k * SIDES + s % SIDES;
            mesh.triangles.push([at(k, s), at(k, s + 1), at(k + 1, s + 1)]);
            mesh.triangles.push([at(k, s), at(k + 1, s + 1), at(k + 1, s)]);
        }
    }
}

/// Name, parent and place of each joint: a body in T-pose, left towards +X, facing +Z.
fn joints() -> Vec<(&'static str, i32, [f64; 3])> {
    let mut list = vec![
        ("root", -1, [0.0, 0.85, 0.0]),
        ("spine", 0, [0.0, 1.1, 0.0]),
        ("neck", 1, [0.0, 1.5, 0.0]),
        ("head", 2, [0.0, 1.65, 0.0]),
        ("crown", 3, [0.0, 1.8, 0.0]),
        ("jaw", 3, [0.0, 1.6, 0.08]),
    ];
    for x in [1.0, -1.0] {
        let first = list.len() as i32;
        let leg = [("thigh", 0, 0.1, 0.85, 0.0), ("shin", first, 0.1, 0.45, 0.0)];
        let foot = [("foot", first + 1, 0.1, 0.06, 0.0), ("toe", first + 2, 0.1, 0.02, 0.15)];
        let arm = [("collar", 1, 0.05, 1.4, 0.0), ("upperarm", first + 4, 0.18, 1.4, 0.0)];
        let hand = [("forearm", first + 5, 0.45, 1.4, 0.0), ("hand", first + 6, 0.72, 1.4, 0.0)];
        let fingers = [("thumb", first + 7, 0.78, 1.4, 0.05), ("finger", first + 7, 0.85, 1.4, 0.0)];
        for (name, parent, side, y, z) in [leg, foot, arm, hand, fingers].concat() {
            list.push((name, parent, [x * side, y, z]));
        }
    }
    list
}

/// The skeleton with joints named by `name`, from the plain name and the side.
fn skeleton(name: impl Fn(&str, Option<bool>) -> String) -> Skeleton {
    let list = joints();
    let side = |x: f64| (x != 0.0).then_some(x > 0.0);
    let matrix = |p: [f64; 3]| {
        [[1.0, 0.0, 0.0, p[0]], [0.0, 1.0, 0.0, p[1]], [0.0, 0.0, 1.0, p[2]], [0.0, 0.0, 0.0, 1.0]]
    };
    Skeleton {
        joints: list.iter().map(|(n, _, p)| name(n, side(p[0]))).collect(),
        parents: list.iter().map(|j| j.1).collect(),
        world_from_joint: list.iter().map(|j| matrix(j.2)).collect(),
    }
}

fn plain(name: &str, side: Option<bool>) -> String {
    format!("{name}{}", side.map_or("", |left| if left { "_l" } else { "_r" }))
}

fn character() -> Character {
    let mut body = TriMesh::default();
    add_tube(&mut body, Vec3::new(0.0, 0.75, 0.0), Vec3::new(0.0, 1.45, 0.0), 0.15);
    add_tube(&mut body, Vec3::new(0.0, 1.46, 0.0), Vec3::new(0.0, 1.7, 0.0), 0.06);
    for x in [1.0, -1.0] {
        add_tube(&mut body, Vec3::new(0.1 * x, 0.0, 0.0), Vec3::new(0.1 * x, 0.84, 0.0), 0.08);
    }
    let arms = body.points.len();
    for x in [1.0, -1.0] {
        add_tube(&mut body, Vec3::new(0.16 * x, 1.4, 0.0), Vec3::new(0.8 * x, 1.4, 0.0), 0.05);
    }
    let skeleton = skeleton(plain);
    let arm = skeleton.joints.iter().position(|n| n == "upperarm_l").unwrap() as u32;
    let joint_indices = (0..body.points.len()).map(|i| if i < arms { 0 } else { arm }).collect();
    let skin = Skin { influences: 1, joint_indices, joint_weights: vec![1.0; body.points.len()] };
    Character { name: "made".into(), path: "/made".into(), body, skeleton, skin, ..Character::default() }
}

#[test]
fn joints_are_found_whatever_they_are_called() {
    let expected = Joints::find(&skeleton(plain));
    let legs = expected.legs.as_ref().unwrap();
    assert_eq!(legs[0].points[0], Vec3::new(0.1, 0.85, 0.0), "the left one comes first");
    assert_eq!(expected.arms.as_ref().unwrap()[1].points[0], Vec3::new(-0.18, 1.4, 0.0));
    assert_eq!(expected.neck.unwrap()[1], Vec3::new(0.0, 1.65, 0.0));
    let renamed = |table: &'static [(&'static str, &'static str)]| {
        move |name: &str| table.iter().find(|t| t.0 == name).map_or(name.to_owned(), |t| t.1.to_owned())
    };
    let mixamo = renamed(&[
        ("thigh", "UpLeg"),
        ("upperarm", "Arm"),
        ("hand", "Hand"),
        ("foot", "Foot"),
        ("neck", "Neck"),
        ("head", "Head"),
        ("collar", "Shoulder"),
    ]);
    let smpl = renamed(&[
        ("thigh", "Hip"),
        ("upperarm", "Shoulder"),
        ("hand", "Wrist"),
        ("foot", "Ankle"),
        ("neck", "Neck"),
        ("head", "Head"),
        ("collar", "Collar"),
    ]);
    let side = |left: Option<bool>, words: [&str; 2]| left.map_or("", |l| words[usize::from(!l)]).to_owned();
    let skeletons = [
        skeleton(|n, l| format!("mixamorig:{}{}", side(l, ["Left", "Right"]), mixamo(n))),
        skeleton(|n, l| format!("{}{}", side(l, ["L_", "R_"]), smpl(n))),
        skeleton(|n, _| format!("joint{}", n.len())), // names that say nothing
    ];
    for skeleton in &skeletons {
        let found = Joints::find(skeleton);
        let roots = |j: &Joints| {
            let of =
                |limbs: &Option<[joints::Limb; 2]>| limbs.clone().unwrap().map(|l| (l.points[0], l.root));
            (of(&j.legs), of(&j.arms), j.neck)
        };
        assert_eq!(roots(&found), roots(&expected), "{:?}", skeleton.joints);
    }
    assert_eq!(Joints::find(&Skeleton::default()), Joints::default());
}

#[test]
fn girths_of_tubes_have_their_closed_form() {
    let landmarks = Landmarks::find(&character());
    assert!(landmarks.missing.is_empty(), "{:?}", landmarks.missing);
    let girth = |girth, side| landmarks.get(girth, side).unwrap().body_m;
    for (found, r) in [
        (girth(Girth::Bust, None), 0.15),
        (girth(Girth::Waist, None), 0.15),
        (girth(Girth::Thigh, Some(Side::Left)), 0.08),
        (girth(Girth::Thigh, Some(Side::Right)), 0.08),
        (girth(Girth::UpperArm, Some(Side::Left)), 0.05),
        (girth(Girth::Neck, None), 0.06),
    ] {
        assert!((found - around(r)).abs() < 1e-9, "{found} {}", around(r));
    }
    // The tape about the seat spans trunk and legs: a stadium where legs stick out.
    assert!(girth(Girth::Hip, None) > around(0.15));
}

#[test]
fn a_body_without_a_skeleton_has_no_girths_and_says_why() {
    let body = Character { skeleton: Skeleton::default(), ..character() };
    let landmarks = Landmarks::find(&body);
    assert!(landmarks.found.is_empty());
    assert_eq!(landmarks.missing.len(), Girth::ALL.len());
    assert!(landmarks.missing.iter().all(|(_, why)| why.contains("found")));
}

#[test]
fn the_tape_spans_hollows() {
    let star = (0..10).map(|k| {
        let (angle, r) = (std::f64::consts::TAU * f64::from(k) / 10.0, if k % 2 == 0 { 1.0 } else { 0.3 });
        Vec2::new(angle.cos(), angle.sin()) * r
    });
    let pentagon = 10.0 * (std::f64::consts::PI / 5.0).sin();
    assert!((hull_length(star.collect()) - pentagon).abs() < 1e-12);
    assert_eq!(hull_length(Vec::new()), 0.0);
}

#[test]
fn a_section_comes_in_pieces_that_go_round() {
    let mut mesh = TriMesh::default();
    add_tube(&mut mesh, Vec3::zeros(), Vec3::y(), 0.1);
    add_tube(&mut mesh, Vec3::x(), Vec3::new(1.0, 1.0, 0.0), 0.2);
    let plane = Plane::level(0.51);
    let pieces = cut(&mesh.points, &mesh.triangles, &|v| v, &|_| false, &plane);
    let turns: Vec<[f64; 2]> =
        pieces.iter().map(|p| [Vec3::zeros(), Vec3::x()].map(|c| p.turns_around(&plane.flat(&c)))).collect();
    assert_eq!(pieces.len(), 2);
    for (k, expected) in [[1.0, 0.0], [0.0, 1.0]].iter().enumerate() {
        assert!((0..2).all(|c| (turns[k][c] - expected[c]).abs() < 1e-9), "{turns:?}");
    }
    let open = cut(&mesh.points, &mesh.triangles[..40], &|v| v, &|_| false, &Plane::level(0.03));
    assert!(open.iter().all(|p| p.turns_around(&Vec2::zeros()) < 0.9));
}

/// A tube of cloth of radius `r` about the trunk, cut from a pattern that it stretches by `stretch`.
fn band(r: f64, stretch: f64) -> Garment {
    let mut mesh = TriMesh::default();
    add_tube(&mut mesh, Vec3::new(0.0, 0.8, 0.0), Vec3::new(0.0, 1.35, 0.0), r);
    let columns = SIDES;
    let corner_pattern = (mesh.triangles.iter())
        .map(|tri| {
            let wraps = tri.iter().any(|v| v % columns == columns - 1);
            tri.map(|v| {
                let column = if wraps && v % columns == 0 { columns } else { v % columns };
                let step = around(r) / f64::from(SIDES) / stretch;
                Vec2::new(0.55 / 12.0 * f64::from(v / columns), step * f64::from(column))
            })
        })
        .collect();
    let panel_of_triangle = vec![0; mesh.triangles.len()];
    let panels = vec![Panel::default()];
    let source =
        GarmentSource { mesh, corner_pattern, panel_of_triangle, panels, ..GarmentSource::default() };
    Garment::from_source(source).unwrap()
}

#[test]
fn ease_is_cloth_at_rest_less_body() {
    let body = Landmarks::find(&character());
    let (garment, target) = (band(0.2, 1.1), band(0.25, 1.0));
    let source = Worn { body: &body, points: &garment.points, pattern: &garment.pattern };
    let worn = Worn { body: &body, points: &target.points, pattern: &target.pattern };
    let ease = Ease::new(&garment, [source, worn, worn], &|girth, _| (girth == Girth::Waist).then_some(0.3));
    assert_eq!(ease.girths.iter().map(|e| e.girth).collect::<Vec<_>>(), [Girth::Bust, Girth::Waist]);
    let waist = &ease.girths[1];
    assert!((waist.source.garment_m - around(0.2) / 1.1).abs() < 1e-9, "{waist:?}");
    assert!((waist.source.worn_m - around(0.2)).abs() < 1e-9 && !waist.open);
    assert!((waist.source.ease_m - (around(0.2) / 1.1 - around(0.15))).abs() < 1e-9);
    assert!((waist.target.ease_m - (around(0.25) - around(0.15))).abs() < 1e-9);
    assert_eq!((waist.held_m, ease.girths[0].held_m), (Some(0.3), None));
    // Not about the thigh: the band ends above; nor about an arm.
    let thigh = body.get(Girth::Thigh, Some(Side::Left)).unwrap();
    assert_eq!(ring(&garment, &garment.points, &garment.pattern, thigh), None);
}

#[test]
fn a_hold_says_one_thing() {
    let held = |held: HeldGirth| Params { hold: Hold { neck: held, ..Hold::default() }, ..Params::default() };
    assert!(Params::default().check().is_ok() && !Params::default().holds("shirt"));
    let good = held(HeldGirth { absolute: Some(0.04), ..HeldGirth::default() });
    assert!(good.check().is_ok() && good.holds("shirt"));
    let named = Params { garments: vec!["coat".into()], ..good };
    assert!(named.holds("coat") && !named.holds("shirt"));
    let both = HeldGirth { absolute: Some(0.04), relative: Some(0.1), source: SourceEase::Free };
    let nan = HeldGirth { absolute: Some(f64::NAN), ..HeldGirth::default() };
    let gone = HeldGirth { relative: Some(-1.0), ..HeldGirth::default() };
    for wrong in [both, nan, gone] {
        assert_eq!(held(wrong).check().unwrap_err().girth, "neck");
    }
}
