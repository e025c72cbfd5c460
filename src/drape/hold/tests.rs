//! What is found on the source; derivatives; what an elastic and a tether do.

use super::ties::Hold;
use super::*;
use crate::device::Device;
use crate::drape::elastic::tests::Noise;
use crate::drape::{Input, Params as Drape};
use crate::model::{GarmentSource, TriMesh, Vec2};

const RADIUS: f64 = 0.1;
/// Radius that the cloth of a [`tube`] is cut for [m]: loose on the cylinder.
const CUT: f64 = 0.105;

/// A tube about the y-axis of two panels (`waistband_l`, `waistband_r`), `gap` [m] outside of
/// [`cylinder`]; where it is `open` the second panel ends short of the first.
fn tube(gap: f64, open: bool) -> Garment {
    let (around, rows, h) = (24u32, 3u32, 0.02);
    let mut source = GarmentSource { name: "band".into(), ..GarmentSource::default() };
    let columns = around + u32::from(open);
    for row in 0..=rows {
        for column in 0..columns {
            let turn = std::f64::consts::TAU * f64::from(column) / f64::from(around);
            let r = RADIUS + gap;
            source.mesh.points.push(Vec3::new(r * turn.cos(), h * f64::from(row), -r * turn.sin()));
        }
    }
    let side = std::f64::consts::TAU * CUT / f64::from(around);
    for column in 0..around {
        for row in 0..rows {
            let at = |c: u32, r: u32| (row + r) * columns + (column + c) % columns;
            let uv = |c: u32, r: u32| Vec2::new(side * f64::from(column + c), h * f64::from(row + r));
            for t in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                source.mesh.triangles.push(t.map(|(c, r)| at(c, r)));
                source.corner_pattern.push(t.map(|(c, r)| uv(c, r)));
                source.panel_of_triangle.push(u32::from(2 * column >= around));
            }
        }
    }
    for label in ["waistband_l", "waistband_r"] {
        source.panels.push(Panel { label: label.into(), ..Panel::default() });
    }
    Garment::from_source(source).unwrap()
}

fn cylinder() -> Surface {
    let (around, mut mesh) = (96, TriMesh::default());
    for i in 0..around {
        let turn = std::f64::consts::TAU * f64::from(i) / f64::from(around);
        for y in [-0.5, 0.5] {
            mesh.points.push(Vec3::new(RADIUS * turn.cos(), y, -RADIUS * turn.sin()));
        }
        let (a, b) = (2 * i, 2 * ((i + 1) % around));
        mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
    Surface::new(mesh)
}

#[test]
fn bands_are_held_where_they_lie_on_the_source_body() {
    let body = cylinder();
    let held = |gap, open, params: &Params| find(&tube(gap, open), &body, params);
    let close = held(4e-3, false, &Params::default());
    assert_eq!(close.len(), 1, "two panels sewn together are one band");
    assert_eq!((&close[0].panels[..], close[0].kind), (&[0, 1][..], Kind::Elastic));
    assert!((close[0].source_distance_m - 4e-3).abs() < 2e-4);
    assert!(held(9e-3, false, &Params::default()).is_empty());
    assert_eq!(held(9e-3, false, &Params { when: When::Always, ..Params::default() }).len(), 1);
    assert!(held(4e-3, false, &Params { when: When::Never, ..Params::default() }).is_empty());
    assert_eq!(held(4e-3, true, &Params::default())[0].kind, Kind::Tether, "it does not close");
    let other = Params { elastic: Vec::new(), ..Params::default() };
    assert!(held(4e-3, false, &other).is_empty());
}

fn hold(garment: &Garment, kind: Kind, params: &Params) -> Hold {
    let band = Band { panels: vec![0, 1], kind, source_distance_m: 0.0 };
    Hold::new(garment, &garment.points, &garment.pattern, &[band], &[&cylinder()], 2e-3, params)
}

fn energy(hold: &Hold, x: &[Vec3]) -> f64 {
    hold.stencils(x).iter().map(|s| s.evaluate(&[]).0).sum()
}

fn gradient(hold: &Hold, x: &[Vec3]) -> Vec<Vec3> {
    let mut out = vec![Vec3::zeros(); x.len()];
    for s in hold.stencils(x) {
        let force = s.evaluate(&[]).1;
        (0..4).for_each(|k| out[s.nodes[k] as usize] += force * s.weights[k]);
    }
    out
}

#[test]
fn gradients_are_those_of_the_energies() {
    let garment = tube(2e-3, false);
    for kind in [Kind::Elastic, Kind::Tether] {
        let hold = hold(&garment, kind, &Params::default());
        let mut noise = Noise(3);
        let x: Vec<Vec3> =
            garment.groups.node_points(&garment.points).iter().map(|p| p + noise.vec3(2e-3)).collect();
        let found = gradient(&hold, &x);
        let size = found.iter().map(Vec3::amax).fold(0.0, f64::max);
        for i in 0..x.len() {
            for c in 0..3 {
                let at = |by: f64| {
                    let mut x = x.clone();
                    x[i][c] += by;
                    energy(&hold, &x)
                };
                let expected = (at(1e-7) - at(-1e-7)) / 2e-7;
                assert!((found[i][c] - expected).abs() < 1e-5 * size, "{kind:?} {i}: {expected} {found:?}");
            }
        }
    }
}

#[test]
fn an_elastic_has_its_tension_around_the_body() {
    let garment = tube(2e-3, false);
    let params = Params::default();
    let hold = hold(&garment, Kind::Elastic, &params);
    let x = garment.groups.node_points(&garment.points);
    let held = &hold.report(&x)[0];
    // Its tension is that of its height, 0.06 m, wherever it starts: it was cut to the girth.
    let expected = params.elastic_stiffness * params.elastic_stretch * 0.06;
    assert!((held.force_n / expected - 1.0).abs() < 1e-2, "{held:?} {expected}");
    assert!((held.extension / params.elastic_stretch - 1.0).abs() < 1e-2);
    // The forces of a ring point inwards and add up to 2 pi times its tension.
    let inward: f64 =
        gradient(&hold, &x).iter().zip(&x).map(|(g, p)| g.dot(&Vec3::new(p.x, 0.0, p.z).normalize())).sum();
    assert!((inward / (std::f64::consts::TAU * expected) - 1.0).abs() < 2e-2, "{inward}");
    // Slack, it does nothing.
    let slack: Vec<Vec3> = x.iter().map(|p| Vec3::new(0.8 * p.x, p.y, 0.8 * p.z)).collect();
    assert_eq!(energy(&hold, &slack), 0.0);
}

#[test]
fn a_tether_pulls_back_by_its_stiffness() {
    let garment = tube(2e-3, false);
    let params = Params::default();
    let hold = hold(&garment, Kind::Tether, &params);
    let moved: Vec<Vec3> =
        garment.groups.node_points(&garment.points).iter().map(|p| p - Vec3::y() * 1e-3).collect();
    let held = &hold.report(&moved)[0];
    let area = std::f64::consts::TAU * CUT * 0.06;
    assert!((held.force_n / (params.tether_stiffness * area * 1e-3) - 1.0).abs() < 1e-9, "{held:?}");
    assert!((held.moved_mean_m - 1e-3).abs() < 1e-12 && (held.moved_max_m - 1e-3).abs() < 1e-12);
}

/// How far a loose tube on a cylinder comes down in 6 undamped frames [m].
fn slide(held: &[Band]) -> f64 {
    let (garment, body) = (tube(4e-3, false), cylinder());
    let input = Input { colliders: &[&body], held, ..Input::alone(&garment) };
    let params = Drape { frames: 6, damping: 0.0, settle: false, ..Drape::default() };
    let out = crate::drape::run(&Device::cpu(), &input, &params).unwrap();
    assert!(out.info.converged, "{:?}", out.info);
    let mean = |points: &[Vec3]| points.iter().map(|p| p.y).sum::<f64>() / points.len() as f64;
    mean(&garment.points) - mean(&out.points)
}

#[test]
fn what_slides_off_by_itself_is_held_by_an_elastic_and_by_a_tether() {
    let band = |kind| [Band { panels: vec![0, 1], kind, source_distance_m: 0.0 }];
    let free = slide(&[]);
    assert!(free > 0.1, "{free}"); // a free fall is 0.33 m
    let (elastic, tether) = (slide(&band(Kind::Elastic)), slide(&band(Kind::Tether)));
    // The elastic closes 2 mm before friction can act; the tether gives way to the weight.
    assert!(elastic.abs() < 5e-3 && tether.abs() < 1e-3, "{elastic} {tether}");
}
