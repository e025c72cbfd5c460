//! Closed forms: a pocket on a sheet that is moved, stretched and bent.

use nalgebra::Rotation3;

use super::*;
use crate::model::{AuthoredSeam, GarmentSource, Panel, Role, Skin, TriMesh, Vec2};
use crate::pattern;

/// Thickness of the pocket with what is under it [m].
const H: f64 = 3e-3;

/// A garment made of rectangles.
#[derive(Default)]
struct Rectangles {
    source: GarmentSource,
}

/// A rectangle of a panel: `[x0, y0]` to `[x1, y1]` in cells of a number.
type Extent = ([f64; 2], [f64; 2], [u32; 2]);

impl Rectangles {
    /// Adds a panel; `place` takes the rectangle's coordinates to space, `turn` [rad] turns it in
    /// the pattern. Returns its first point.
    fn panel(&mut self, label: &str, extent: Extent, turn: f64, place: impl Fn(f64, f64) -> Vec3) -> u32 {
        let ([x0, y0], [x1, y1], [nx, ny]) = extent;
        let first = self.source.mesh.points.len() as u32;
        let panel = self.source.panels.len() as u32;
        self.source.panels.push(Panel {
            name: format!("{label}_{panel}"),
            label: label.into(),
            ..Panel::default()
        });
        let mut uv = Vec::new();
        for j in 0..=ny {
            for i in 0..=nx {
                let x = x0 + (x1 - x0) * f64::from(i) / f64::from(nx);
                let y = y0 + (y1 - y0) * f64::from(j) / f64::from(ny);
                self.source.mesh.points.push(place(x, y));
                uv.push(nalgebra::Rotation2::new(turn) * Vec2::new(x, y) + Vec2::new(f64::from(panel), 0.0));
            }
        }
        for j in 0..ny {
            for i in 0..nx {
                let a = j * (nx + 1) + i;
                let [b, c, d] = [a + 1, a + nx + 2, a + nx + 1];
                for t in [[a, b, c], [a, c, d]] {
                    self.source.corner_pattern.push(t.map(|k| uv[k as usize]));
                    self.source.mesh.triangles.push(t.map(|k| first + k));
                    self.source.panel_of_triangle.push(panel);
                }
            }
        }
        first
    }

    fn seam(&mut self, pairs: Vec<[u32; 2]>, offset: bool) {
        self.source.seams.push(AuthoredSeam { name: "seam".into(), pairs, offset });
    }

    /// Sews each border point of a panel of `n` cells onto the nearest point of the first panel.
    fn sew_onto(&mut self, first: u32, [nx, ny]: [u32; 2], under: u32) {
        let points = &self.source.mesh.points;
        let nearest = |p: u32| {
            let d = |q: &u32| (points[*q as usize] - points[p as usize]).norm_squared();
            (0..under).min_by(|a, b| d(a).total_cmp(&d(b))).unwrap()
        };
        let border = (0..(nx + 1) * (ny + 1)).filter(|k| {
            let (i, j) = (k % (nx + 1), k / (nx + 1));
            i == 0 || i == nx || j == 0 || j == ny
        });
        let pairs = border.map(|k| [first + k, nearest(first + k)]).collect();
        self.seam(pairs, true);
    }

    fn garment(self) -> Garment {
        Garment::from_source(GarmentSource { path: "/Shirt".into(), ..self.source }).unwrap()
    }
}

const FRONT: Extent = ([0.0, 0.0], [0.4, 0.4], [32, 32]);
const POCKET: Extent = ([0.131, 0.12], [0.27, 0.243], [9, 8]);
const FRONT_POINTS: u32 = 33 * 33;

/// A front with a pocket at height `H`; `place` takes front coordinates and height to space.
fn pocketed(label: &str, place: impl Fn(f64, f64, f64) -> Vec3) -> Garment {
    let mut parts = Rectangles::default();
    parts.panel("front", FRONT, 0.0, |x, y| place(x, y, 0.0));
    let first = parts.panel(label, POCKET, 0.7, |x, y| place(x, y, H));
    parts.sew_onto(first, POCKET.2, FRONT_POINTS);
    parts.garment()
}

fn flat(x: f64, y: f64, h: f64) -> Vec3 {
    Vec3::new(x, y, h)
}

/// Rolled about the y axis with radius `r`; heights point outward, and inward for a negative `r`.
fn rolled(r: f64) -> impl Fn(f64, f64, f64) -> Vec3 {
    move |x, y, h| {
        let a = (x - 0.2) / r;
        Vec3::new((r + h) * a.sin(), y, (r + h) * a.cos() - r)
    }
}

/// The front's vertices moved by `place`, and the pocket where its closed form has it.
fn moved(garment: &Garment, place: impl Fn(f64, f64, f64) -> Vec3) -> Vec<Vec3> {
    garment.points.iter().map(|p| place(p.x, p.y, p.z)).collect()
}

fn worst(a: &[Vec3], b: &[Vec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn at_rest_and_after_any_rigid_motion_details_are_where_they_were() {
    let garment = pocketed("pocket", rolled(0.1));
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    assert_eq!(proxy.info().left_out.len(), 1);
    assert_eq!(proxy.garment().points.len(), FRONT_POINTS as usize);
    assert_eq!(proxy.info().bound_vertices, 90);
    // The rolled sheet is a polygon: its sagitta is 0.2 mm.
    assert!((proxy.info().distance_max_m - H).abs() < 0.1 * H, "{}", proxy.info().distance_max_m);
    for turn in [Rotation3::identity(), Rotation3::from_euler_angles(0.5 * std::f64::consts::PI, 0.3, -2.0)] {
        let motion = |p: &Vec3| turn * p + Vec3::new(0.3, -1.0, 5.0);
        let expected: Vec<Vec3> = garment.points.iter().map(motion).collect();
        let (found, info) = proxy.restore(&proxy.gather(&expected), &[]);
        assert!(worst(&found, &expected) < 1e-12, "{}", worst(&found, &expected));
        assert!((info.offset_least - 1.0).abs() < 1e-9 && (info.offset_most - 1.0).abs() < 1e-9);
        assert_eq!((info.inside, info.squeezed), (0, 0));
    }
}

#[test]
fn the_stretch_of_a_flat_front_is_followed_and_the_thickness_kept() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let expected = moved(&garment, |x, y, h| Vec3::new(1.3 * x + 0.1 * y, 0.9 * y, h));
    let found = proxy.lift(&proxy.gather(&expected));
    assert!(worst(&found, &expected) < 1e-9, "{}", worst(&found, &expected));
}

#[test]
fn bending_keeps_distance_and_side() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    // Over a forearm, and into a hollow in which 7 cells make a quarter of the turn.
    for r in [0.06, -0.06] {
        let expected = moved(&garment, rolled(r));
        let (found, info) = proxy.restore(&proxy.gather(&expected), &[]);
        assert_eq!((info.inside, info.squeezed), (0, 0), "{r}");
        assert!((info.offset_least - 1.0).abs() < 1e-5 && (info.offset_most - 1.0).abs() < 1e-5, "{info:?}");
        // The sheet is a polygon: its sagitta is 0.33 mm.
        assert!(worst(&found, &expected) < 5e-4, "{}", worst(&found, &expected));
    }
}

#[test]
fn a_fold_sharper_than_the_detail_is_thick_turns_nothing_inside() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    // Folded by 110 degrees along a line between two columns, towards the pocket and away from it.
    for way in [1.0, -1.0] {
        let angle = 110.0_f64.to_radians() * way;
        let fold = |x: f64, y: f64, h: f64| {
            let over = (x - 0.2).max(0.0);
            Vec3::new(x.min(0.2) + over * angle.cos(), y, h + over * angle.sin())
        };
        let (_, info) = proxy.restore(&proxy.gather(&moved(&garment, fold)), &[]);
        assert_eq!(info.inside, 0, "{info:?}");
        assert!(info.offset_least > 0.9 && info.offset_most < 1.1, "{info:?}");
    }
}

#[test]
fn a_crest_that_comes_through_a_detail_raises_it() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let crossings = |points: &[Vec3]| {
        crate::geometry::intersect::self_intersections(&Surface::new(garment.welded_mesh(points))).len()
    };
    // The crest runs between two columns of the pocket, 7 and 8 mm from them.
    let angle = -50.0_f64.to_radians();
    let crest = |x: f64, y: f64, h: f64| {
        let over = (x - 0.2).max(0.0);
        Vec3::new(x.min(0.2) + over * angle.cos(), y, h + over * angle.sin())
    };
    let shell = proxy.gather(&moved(&garment, crest));
    assert!(crossings(&proxy.lift(&shell)) > 0);
    let (points, info) = proxy.restore(&shell, &[]);
    assert_eq!(crossings(&points), 0);
    // Both columns of nine, by less than if the normals did not lean over the crest: 20%.
    assert_eq!((info.raised, info.inside, info.squeezed), (18, 0, 0), "{info:?}");
    assert!(info.offset_most > 1.05 && info.offset_most < 1.2, "{info:?}");
}

#[test]
fn a_detail_between_two_sheets_is_pressed_together() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let lid = |z: f64| {
        let p = |x: f64, y: f64| Vec3::new(x, y, z);
        let points = vec![p(-1.0, -1.0), p(2.0, -1.0), p(2.0, 2.0), p(-1.0, 2.0)];
        Surface::new(TriMesh { points, triangles: vec![[0, 1, 2], [0, 2, 3]] })
    };
    let shell = proxy.gather(&garment.points);
    let (points, info) = proxy.restore(&shell, &[&lid(2e-3)]);
    assert_eq!(info.squeezed, 90);
    let heights = (FRONT_POINTS as usize..points.len()).map(|v| points[v].z);
    assert!(heights.clone().all(|z| (z - 1.5e-3).abs() < 1e-9), "2 mm of 3 mm and 1 mm free: {heights:?}");
    assert_eq!(proxy.restore(&shell, &[&lid(4.1e-3)]).1.squeezed, 0);
    assert_eq!(proxy.restore(&shell, &[&lid(-2e-3)]).1.squeezed, 0, "on the other side");
}

#[test]
fn the_pattern_of_a_detail_follows_the_front() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let params = pattern::Params::default();
    let refit = |scale: f64| {
        let points: Vec<Vec3> = proxy.garment().points.iter().map(|p| p * scale).collect();
        proxy.refit(&points, &params, None).unwrap()
    };
    let (same, info) = refit(1.0);
    let change = same.iter().zip(&garment.pattern).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(change < 1e-6, "{change}");
    assert!((info.area_ratio - 1.0).abs() < 1e-6 && info.flipped_triangles == 0);
    let (scaled, info) = refit(1.25);
    assert!((info.area_ratio - 1.25 * 1.25).abs() < 1e-6, "{}", info.area_ratio);
    for t in 0..garment.triangles.len() {
        let [a, b, _] = garment.pattern_corners(&scaled, t);
        let [c, d, _] = garment.pattern_corners(&garment.pattern, t);
        assert!(((b - a).norm() - 1.25 * (d - c).norm()).abs() < 1e-8, "triangle {t}");
    }
}

#[test]
fn what_is_sewn_stays_sewn() {
    // A strap of two panels across a front, sewn edge to edge in the middle and, at its lower edge,
    // to the front without an offset.
    let mut parts = Rectangles::default();
    parts.panel("front", FRONT, 0.0, |x, y| flat(x, y, 0.0));
    let cells = [8, 2];
    let left =
        parts.panel("strap", ([0.1, 0.1], [0.2, 0.125], cells), 0.3, |x, y| flat(x, y, (y - 0.1) * 0.1));
    let right =
        parts.panel("strap", ([0.2, 0.1], [0.3, 0.125], cells), 0.3, |x, y| flat(x, y, (y - 0.1) * 0.1));
    parts.seam((0..3).map(|j| [left + j * 9 + 8, right + j * 9]).collect(), false);
    // The front's points are 1.25 cm apart, and so are the strap's.
    parts.seam(
        (0..9).flat_map(|i| [[left + i, 8 * 33 + 8 + i], [right + i, 8 * 33 + 16 + i]]).collect(),
        false,
    );
    let garment = parts.garment();
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    assert_eq!(proxy.info().left_out.len(), 2);
    let wave = |x: f64, y: f64, h: f64| {
        Vec3::new(1.1 * x, y + 0.02 * (9.0 * x).sin(), h + 0.03 * (20.0 * x * y).cos())
    };
    let points = proxy.lift(&proxy.gather(&moved(&garment, wave)));
    let mut sewn = 0;
    let mut first = vec![None; garment.groups.weld_count];
    for v in 0..points.len() {
        let weld = garment.groups.weld_of_vertex[v] as usize;
        let at = *first[weld].get_or_insert(points[v]);
        assert_eq!(at, points[v], "vertex {v}");
        sewn += usize::from(garment.panel_of_vertex[v] > 0 && garment.panel_of_vertex[v] < 3);
    }
    assert_eq!(sewn, 54);
    let skin = proxy.skin(&ramp(proxy.garment()), &garment.points, &|_, row, _| row.to_vec());
    for v in 0..points.len() {
        let weld = |v: usize| garment.groups.weld_of_vertex[v];
        let first = (0..=v).find(|&u| weld(u) == weld(v)).unwrap();
        assert_eq!(skin.joint_weights[2 * v..2 * v + 2], skin.joint_weights[2 * first..2 * first + 2]);
    }
}

/// Weights of two joints that go from one to the other along x.
fn ramp(garment: &Garment) -> Skin {
    let mut skin = Skin { influences: 2, ..Skin::default() };
    for p in &garment.points {
        let w = p.x / 0.4;
        skin.joint_indices.extend(if w > 0.5 { [1, 0] } else { [0, 1] });
        skin.joint_weights.extend([w.max(1.0 - w), w.min(1.0 - w)]);
    }
    skin
}

#[test]
fn details_have_the_weights_of_the_spot_that_they_are_bound_to() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let skin = proxy.skin(&ramp(proxy.garment()), &garment.points, &|_, row, _| row.to_vec());
    for v in 0..garment.points.len() {
        let of_one: f64 =
            (2 * v..2 * v + 2).filter(|&i| skin.joint_indices[i] == 1).map(|i| skin.joint_weights[i]).sum();
        assert!((of_one - garment.points[v].x / 0.4).abs() < 1e-12, "vertex {v}");
        assert!((skin.joint_weights[2 * v..2 * v + 2].iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn which_of_a_details_joints_stay_is_for_the_rig_to_say() {
    let garment = pocketed("pocket", flat);
    let proxy = Proxy::new(&garment, &Params::default()).unwrap();
    let count = proxy.garment().points.len();
    let joint_indices = (0..count as u32).map(|v| v % 5).collect();
    let of_proxy = Skin { influences: 1, joint_indices, joint_weights: vec![1.0; count] };
    let asked = std::cell::RefCell::new(Vec::new());
    let cap = |p: &Vec3, row: &[(u32, f64)], most: usize| {
        assert_eq!(most, 1);
        assert!((row.iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-12);
        asked.borrow_mut().push((*p, row.len()));
        vec![(9, 1.0)]
    };
    let skin = proxy.skin(&of_proxy, &garment.points, &cap);
    let of_detail = |v: &usize| garment.panel_of_vertex[*v] == 1;
    let details: Vec<usize> = (0..garment.points.len()).filter(of_detail).collect();
    assert!(details.iter().all(|&v| skin.joint_indices[v] == 9));
    let asked = asked.into_inner();
    assert_eq!(asked.len(), details.len());
    assert!(
        asked.iter().any(|a| a.1 == 3)
            && asked.iter().all(|a| details.iter().any(|&v| garment.points[v] == a.0))
    );
}

fn left_out(garment: &Garment, params: &Params) -> Vec<String> {
    let proxy = Proxy::new(garment, params).unwrap();
    proxy.info().left_out.iter().map(|l| l.label.clone()).collect()
}

#[test]
fn role_then_keep_then_label_then_geometry_decide() {
    let by_label = pocketed("pocket", flat);
    let by_place = pocketed("thing", flat);
    let (defaults, none) =
        (Params::default(), Params { leave_out: Vec::new(), automatic: false, ..Params::default() });
    assert_eq!(left_out(&by_label, &defaults), ["pocket"]);
    assert_eq!(left_out(&by_place, &defaults), ["thing"]);
    assert_eq!(left_out(&by_place, &none), [""; 0]);
    assert_eq!(left_out(&by_label, &Params { enabled: false, ..Params::default() }), [""; 0]);
    let keep = Params { keep: vec!["pock*".into()], ..Params::default() };
    assert_eq!(left_out(&by_label, &keep), [""; 0]);
    let named = Params { leave_out: vec!["thing".into()], ..none.clone() };
    assert_eq!(left_out(&by_place, &named), ["thing"]);
    let thin = Params { thickness: 0.9 * H, ..Params::default() };
    assert_eq!(left_out(&by_place, &thin), [""; 0]);
    let with_role = |role| {
        let mut garment = by_place.clone();
        garment.panels[1].role = role;
        garment
    };
    assert_eq!(left_out(&with_role(Role::Detail), &none), ["thing"]);
    assert_eq!(left_out(&with_role(Role::Shell), &named), [""; 0]);
    let mut loose = by_place.clone();
    loose.groups = crate::model::SeamGroups::new(loose.points.len(), &[], &[]);
    assert_eq!(left_out(&loose, &defaults), [""; 0], "lies there, but is not sewn on");
}

#[test]
fn a_panel_that_carries_on_the_shell_is_no_detail() {
    // A strap sewn edge to edge to the upper edge of a front.
    let mut parts = Rectangles::default();
    parts.panel("front", FRONT, 0.0, |x, y| flat(x, y, 0.0));
    let first = parts.panel("strap", ([0.1, 0.4], [0.15, 0.6], [4, 8]), 0.0, |x, y| flat(x, y, 0.0));
    parts.seam((0..5).map(|i| [first + i, 32 * 33 + 8 + i]).collect(), false);
    let proxy_of = |garment: &Garment| Proxy::new(garment, &Params::default()).map(|p| p.info().clone());
    let garment = parts.garment();
    let info = proxy_of(&garment).unwrap();
    assert_eq!((info.left_out.len(), info.shell_after_all), (0, vec!["strap_1".to_owned()]));
    // The same without the seam has nothing to be bound to.
    let mut loose = garment;
    loose.groups = crate::model::SeamGroups::new(loose.points.len(), &[], &[]);
    let error = proxy_of(&loose).unwrap_err();
    let Error::Far { panel, distance, .. } = &error else { panic!("{error}") };
    assert_eq!(panel, "strap_1");
    assert!((distance - 0.2).abs() < 1e-12);
    assert!(error.to_string().contains("/Shirt: panel 'strap_1'"), "{error}");
}

#[test]
fn a_garment_of_details_alone_is_refused() {
    let mut garment = pocketed("pocket", flat);
    garment.panels[0].label = "Patch_front".into();
    let error = Proxy::new(&garment, &Params::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("/Shirt: nothing is left"), "{error}");
    assert!(error.to_string().contains("'Patch_front', 'pocket'"), "{error}");
    let bad = Params { reach: f64::NAN, ..Params::default() };
    assert!(matches!(Proxy::new(&garment, &bad), Err(Error::Setting { name: "reach", .. })));
}

#[test]
fn a_part_keeps_what_was_tied() {
    let garment = pocketed("pocket", flat);
    let all = Part::new(&garment, &[true, true]);
    assert_eq!(all.garment, garment);
    let shell = Part::new(&garment, &[true, false]).garment;
    assert_eq!(shell.groups.node_count, shell.points.len());
    assert!(shell.seams.is_empty());
    let pocket = Part::new(&garment, &[false, true]).garment;
    assert_eq!((pocket.points.len(), pocket.triangles.len()), (90, 144));
    // Border vertices that shared an anchor stay tied to the first of them.
    let groups = |g: &Garment| (0..90).map(|v| g.groups.node_of_vertex[v]).collect::<Vec<_>>();
    let whole: Vec<u32> = (0..90).map(|v| garment.groups.node_of_vertex[v + FRONT_POINTS as usize]).collect();
    let own = groups(&pocket);
    assert!((0..90).all(|a| (0..90).all(|b| (whole[a] == whole[b]) == (own[a] == own[b]))));
}
