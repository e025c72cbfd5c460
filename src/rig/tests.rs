mod refine;

use super::*;
use crate::model::{AuthoredSeam, GarmentSource, Panel, Skeleton, TriMesh, Vec2};

/// A tube around the segment from `a` to `b`, open at its ends, wound outward.
fn tube(a: Vec3, b: Vec3, radius: f64, around: usize, along: usize) -> TriMesh {
    let axis = (b - a).normalize();
    let side = axis.cross(&Vec3::ith(axis.iamin(), 1.0)).normalize();
    let up = axis.cross(&side);
    let mut mesh = TriMesh::default();
    for i in 0..=along {
        for j in 0..around {
            let angle = std::f64::consts::TAU * j as f64 / around as f64;
            let ring = side * angle.cos() + up * angle.sin();
            mesh.points.push(a + (b - a) * (i as f64 / along as f64) + ring * radius);
        }
    }
    for i in 0..along {
        for j in 0..around {
            let at = |i: usize, j: usize| (i * around + j % around) as u32;
            mesh.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            mesh.triangles.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    mesh
}

fn join(meshes: &[&TriMesh]) -> TriMesh {
    let mut all = TriMesh::default();
    for mesh in meshes {
        let first = all.points.len() as u32;
        all.points.extend(&mesh.points);
        all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + first)));
    }
    all
}

/// A character whose point weights are given as the weight of joint 1 (the rest is joint 0's).
fn character(body: TriMesh, second: impl Fn(&Vec3) -> f64) -> Character {
    let weights: Vec<f64> = body.points.iter().flat_map(|p| [1.0 - second(p), second(p)]).collect();
    Character {
        name: "test".to_owned(),
        path: "/Body".to_owned(),
        skin: Skin { influences: 2, joint_indices: [0, 1].repeat(body.points.len()), joint_weights: weights },
        skeleton: Skeleton { joints: vec!["a".to_owned(), "a/b".to_owned()], ..Skeleton::default() },
        body,
        colliders: Vec::new(),
        blend_shapes: Vec::new(),
    }
}

/// A garment whose panel coordinates do not matter: each triangle is its own flat piece, tied
/// to its neighbours because they share points.
fn garment(mesh: TriMesh, seams: Vec<AuthoredSeam>) -> Garment {
    let flat = [Vec2::new(0.0, 0.0), Vec2::new(0.01, 0.0), Vec2::new(0.0, 0.01)];
    let source = GarmentSource {
        name: "cloth".to_owned(),
        path: "/Cloth".to_owned(),
        corner_pattern: vec![flat; mesh.triangles.len()],
        panel_of_triangle: (0..mesh.triangles.len() as u32).collect(),
        panels: vec![Panel::default(); mesh.triangles.len()],
        mesh,
        seams,
        ..GarmentSource::default()
    };
    Garment::from_source(source).expect("a valid garment")
}

/// As [`run`], with the body's outer skin.
fn rig(body: &Character, cloth: &Garment, points: &[Vec3], params: &Params) -> Result<(Skin, Info), Error> {
    run(body, &OuterSkin::new(&body.body), cloth, points, params)
}

fn second(skin: &Skin, vertex: usize) -> f64 {
    let k = skin.influences;
    (0..k)
        .filter(|i| skin.joint_indices[vertex * k + i] == 1)
        .map(|i| skin.joint_weights[vertex * k + i])
        .sum()
}

#[test]
fn a_sleeve_takes_the_weights_of_the_arm_beneath_it() {
    let (a, b) = (Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.6, 1.0, 0.0));
    let body = character(tube(a, b, 0.05, 32, 60), |p| p.x / 0.6);
    let (c, d) = (Vec3::new(0.1, 1.0, 0.0), Vec3::new(0.5, 1.0, 0.0));
    let sleeve = garment(tube(c, d, 0.07, 24, 30), Vec::new());
    let (skin, info) = rig(&body, &sleeve, &sleeve.points, &Params::default()).expect("rigs");
    assert_eq!((info.matched, info.nearest, info.turned_pieces), (1.0, 0.0, 0));
    for (v, p) in sleeve.points.iter().enumerate() {
        // Evening out flattens the slope at a free border, 2 cm from the skin over 5 cm * (2 / 1.6)^(3/2).
        let fade = 0.05 * f64::powf(2.0 / 1.6, 1.5);
        let border = fade / 0.6 * (-(p.x - 0.1).min(0.5 - p.x) / fade).exp();
        let error = (second(&skin, v) - p.x / 0.6).abs();
        assert!(error < 1.1 * border + 2e-3, "vertex {v} at {p:?}: {}", second(&skin, v));
    }
}

#[test]
fn cloth_wound_inward_is_turned_for_the_search() {
    let (a, b) = (Vec3::zeros(), Vec3::new(0.4, 0.0, 0.0));
    let body = character(tube(a, b, 0.05, 32, 40), |p| p.x / 0.4);
    let mut inward = tube(a, b, 0.07, 24, 20);
    inward.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let sleeve = garment(inward, Vec::new());
    let (_, info) = rig(&body, &sleeve, &sleeve.points, &Params::default()).expect("rigs");
    assert_eq!((info.turned_pieces, info.nearest), (1, 0.0));
    assert!(info.matched > 0.95, "{info:?}");
}

/// An upper arm hangs 2 cm beside the torso, its sleeve touches the torso: the nearest skin of
/// the sleeve's inner side is the torso's, the skin behind it is the arm's.
#[test]
fn an_armpit_is_told_apart_where_the_nearest_point_is_not() {
    let torso = tube(Vec3::zeros(), Vec3::new(0.0, 0.6, 0.0), 0.15, 64, 60);
    let arm = tube(Vec3::new(0.22, 0.0, 0.0), Vec3::new(0.22, 0.6, 0.0), 0.04, 32, 60);
    let torso_points = torso.points.len();
    let body = join(&[&torso, &arm]);
    let is_arm = |p: &Vec3| f64::from(u8::from(p.x > 0.17));
    assert!(body.points[..torso_points].iter().all(|p| is_arm(p) == 0.0));
    let body = character(body, is_arm);
    let sleeve =
        garment(tube(Vec3::new(0.22, 0.1, 0.0), Vec3::new(0.22, 0.5, 0.0), 0.065, 32, 40), Vec::new());

    let surface = OuterSkin::new(&body.body).surface;
    let wrong = sleeve.points.iter().filter(|p| surface.closest(p).point.x < 0.17).count();
    assert!(wrong > 100, "the nearest point is on the torso for {wrong} vertices: not a hard case");
    let (skin, _) = rig(&body, &sleeve, &sleeve.points, &Params::default()).expect("rigs");
    for v in 0..sleeve.points.len() {
        assert!(second(&skin, v) > 0.999, "vertex {v} at {:?}", sleeve.points[v]);
    }
}

/// Below the band a wide skirt is beyond the search's reach: its weights go on from the band's,
/// smoothly, also where left and right leg are equally near.
#[test]
fn a_loose_skirt_is_inpainted_without_a_split() {
    let left = tube(Vec3::new(-0.1, 0.0, 0.0), Vec3::new(-0.1, 1.0, 0.0), 0.09, 32, 50);
    let right = tube(Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.1, 1.0, 0.0), 0.09, 32, 50);
    let blend = |p: &Vec3| (0.5 + p.x / 0.4).clamp(0.0, 1.0);
    let body =
        character(
            join(&[&left, &right]),
            |p| if p.y > 0.9 { blend(p) } else { f64::from(u8::from(p.x > 0.0)) },
        );
    let mut cone = tube(Vec3::new(0.0, 0.4, 0.0), Vec3::new(0.0, 1.0, 0.0), 1.0, 64, 40);
    for p in &mut cone.points {
        let radius = 0.22 + 0.5 * (0.95 - p.y).max(0.0);
        (p.x, p.z) = (p.x * radius, p.z * radius);
    }
    let skirt = garment(cone, Vec::new());
    let (skin, info) = rig(&body, &skirt, &skirt.points, &Params::default()).expect("rigs");
    assert!(info.inpainted > 0.3 && info.matched > 0.02 && info.nearest == 0.0, "{info:?}");
    let mut jump: f64 = 0.0;
    let hem = |v: usize| skirt.points[v].y < 0.6;
    for t in &skirt.triangles {
        for k in 0..3 {
            let (a, b) = (t[k] as usize, t[(k + 1) % 3] as usize);
            if hem(a) && hem(b) {
                jump = jump.max((second(&skin, a) - second(&skin, b)).abs());
            }
        }
    }
    assert!(jump < 0.2, "weights jump by {jump} along an edge of the hem");
}

/// Wide legs of trousers: the left hem's inner side touches the right leg.
#[test]
fn a_hem_that_touches_the_other_leg_does_not_move_with_it() {
    let leg = |x: f64| tube(Vec3::new(x, 0.0, 0.0), Vec3::new(x, 0.8, 0.0), 0.07, 48, 60);
    let (left, right) = (leg(-0.1), leg(0.1));
    let body = character(join(&[&left, &right]), |p| f64::from(u8::from(p.x > 0.0)));
    let mut wide = tube(Vec3::new(0.0, 0.1, 0.0), Vec3::new(0.0, 0.7, 0.0), 1.0, 48, 40);
    for p in &mut wide.points {
        let radius = 0.085 + 0.04 * (0.7 - p.y) / 0.6;
        (p.x, p.z) = (p.x * radius - 0.1, p.z * radius);
    }
    let trousers = garment(wide, Vec::new());
    let surface = OuterSkin::new(&body.body).surface;
    let wrong = trousers.points.iter().filter(|p| surface.closest(p).point.x > 0.0).count();
    assert!(wrong > 20, "only {wrong} vertices are nearest to the other leg: not a hard case");
    let (skin, _) = rig(&body, &trousers, &trousers.points, &Params::default()).expect("rigs");
    for v in 0..trousers.points.len() {
        assert!(second(&skin, v) < 1e-3, "vertex {v} at {:?}: {}", trousers.points[v], second(&skin, v));
    }
}

/// A sleeve whose end is turned up lies on itself, inside out: both layers move with the arm.
#[test]
fn a_turned_up_cuff_moves_with_the_arm_beneath_it() {
    let (a, b) = (Vec3::zeros(), Vec3::new(0.6, 0.0, 0.0));
    let body = character(tube(a, b, 0.05, 32, 60), |p| p.x / 0.6);
    let mut sleeve = tube(Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.6, 0.0, 0.0), 0.06, 32, 50);
    for p in sleeve.points.iter_mut().filter(|p| p.x > 0.4) {
        let out = 0.064 / 0.06;
        *p = Vec3::new(0.8 - p.x, p.y * out, p.z * out);
    }
    let sleeve = garment(sleeve, Vec::new());
    let (skin, info) = rig(&body, &sleeve, &sleeve.points, &Params::default()).expect("rigs");
    assert!(info.matched > 0.9, "{info:?}");
    for (v, p) in sleeve.points.iter().enumerate() {
        assert!((second(&skin, v) - p.x / 0.6).abs() < 0.08, "vertex {v} at {p:?}: {}", second(&skin, v));
    }
}

#[test]
fn weights_are_a_partition_of_unity_and_identical_across_seams() {
    let (a, b) = (Vec3::zeros(), Vec3::new(0.5, 0.0, 0.0));
    let body = character(tube(a, b, 0.05, 32, 60), |p| p.x / 0.5);
    // Two tubes with points of their own, sewn end to end.
    let (left, right) = (tube(a, b * 0.5, 0.07, 24, 12), tube(b * 0.5, b, 0.07, 24, 12));
    let first = left.points.len() as u32;
    let pairs: Vec<[u32; 2]> = (0..24).map(|j| [first - 24 + j, first + j]).collect();
    let seam = AuthoredSeam { name: "join".to_owned(), pairs: pairs.clone(), offset: false };
    let cloth = garment(join(&[&left, &right]), vec![seam]);
    let (skin, info) =
        rig(&body, &cloth, &cloth.points, &Params { influences: Some(3), ..Params::default() })
            .expect("rigs");
    assert!((info.matched + info.inpainted + info.nearest - 1.0).abs() < 1e-12);
    assert_eq!(skin.joint_weights.len(), 3 * cloth.points.len());
    for w in skin.joint_weights.chunks(3) {
        assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12 && w.iter().all(|&w| w >= 0.0));
    }
    let at = |point: u32| cloth.point_of_vertex.iter().position(|&p| p == point).expect("used");
    for [p, q] in pairs {
        let (p, q) = (at(p) * 3, at(q) * 3);
        assert_eq!(skin.joint_weights[p..p + 3], skin.joint_weights[q..q + 3]);
        assert_eq!(skin.joint_indices[p..p + 3], skin.joint_indices[q..q + 3]);
    }
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let body = character(tube(Vec3::zeros(), Vec3::x(), 0.05, 8, 4), |_| 0.0);
    let cloth = garment(tube(Vec3::zeros(), Vec3::x(), 0.07, 8, 4), Vec::new());
    let short = rig(&body, &cloth, &cloth.points[1..], &Params::default());
    assert!(matches!(short, Err(Error::Length { .. })));
    let none = rig(&body, &cloth, &cloth.points, &Params { influences: Some(0), ..Params::default() });
    assert!(matches!(none, Err(Error::Setting { name: "influences", .. })));
    let nowhere = [vec![Vec3::repeat(f64::NAN)], cloth.points[1..].to_vec()].concat();
    let nowhere = rig(&body, &cloth, &nowhere, &Params::default());
    assert_eq!(nowhere.unwrap_err(), Error::NotFinite { what: "garment", element: 0 });
    let mut strange = body.clone();
    strange.skin.joint_indices[6] = 9;
    let strange = rig(&strange, &cloth, &cloth.points, &Params::default());
    let wanted = Error::Joint { body: "/Body".to_owned(), element: 3, joint: 9, count: 2 };
    assert_eq!(strange.unwrap_err(), wanted);
    let mut weightless = body.clone();
    weightless.skin.joint_weights[8..10].fill(0.0);
    let weightless = rig(&weightless, &cloth, &cloth.points, &Params::default());
    assert_eq!(weightless.unwrap_err(), Error::Weights { body: "/Body".to_owned(), element: 4 });
    let bare = Character { skin: Skin::default(), ..body };
    assert!(matches!(rig(&bare, &cloth, &cloth.points, &Params::default()), Err(Error::NoSkin { .. })));
}
