//! Held girths on a tube around a cylinder.

use super::*;
use crate::measure::ease::{measured, ring};
use crate::measure::hold::{HeldGirth, Hold, SourceEase};
use crate::measure::section::Plane;
use crate::measure::{Girth, Landmark, Landmarks};

/// A tube of radius `r` about the Y axis, 0.6 m around in the pattern.
fn tube(r: f64) -> Garment {
    let mut sheet = strip();
    sheet.sew(0, 0);
    let turn = std::f64::consts::TAU / 0.6;
    sheet.garment(|p| Vec3::new((p.x * turn).cos() * r, p.y, -(p.x * turn).sin() * r))
}

fn waist(body_m: f64) -> Landmarks {
    let plane = Plane::level(0.1301);
    let centre = Vec3::new(0.0, 0.1301, 0.0);
    let landmark = Landmark { girth: Girth::Waist, side: None, plane, centre, beside: Vec::new(), body_m };
    Landmarks { found: vec![landmark], missing: Vec::new() }
}

/// The tube's ease after a refit to radius `r` about a body of girth `body_m`.
fn refit(held: HeldGirth, r: f64, body_m: f64) -> (f64, Info) {
    let (garment, source, target) = (tube(0.095), waist(0.55), waist(body_m));
    let points = tube(r).points;
    let hold = Hold { waist: held, ..Hold::default() };
    let holding = Holding { source: &source, target: &target, hold: &hold };
    let (pattern, info) = run_holding(&garment, &points, &Params::default(), Some(&holding)).unwrap();
    let ring = ring(&garment, &points, &pattern, &target.found[0]).unwrap();
    (measured(&ring, &points, &pattern, body_m).ease_m, info)
}

#[test]
fn a_girth_without_a_hold_follows_the_carried_shape() {
    let (ease, info) = refit(HeldGirth::default(), 0.19, 1.15);
    assert!((ease - (1.2 - 1.15)).abs() < 1e-6 && info.converged, "{ease} {info:?}");
}

#[test]
fn a_held_girth_has_its_ease() {
    let absolute = HeldGirth { absolute: Some(0.12), ..HeldGirth::default() };
    let relative = HeldGirth { relative: Some(-0.05), ..HeldGirth::default() };
    let [as_is, scaled] = [SourceEase::Absolute, SourceEase::Relative]
        .map(|source| HeldGirth { source, ..HeldGirth::default() });
    for (held, wanted) in [(absolute, 0.12), (relative, -0.0575), (as_is, 0.05), (scaled, 0.05 / 0.55 * 1.15)]
    {
        let (ease, info) = refit(held, 0.19, 1.15);
        assert!((ease - wanted).abs() < 2e-4, "{ease} {wanted}");
        assert!(info.converged && info.flipped_triangles == 0 && info.seam_mismatch_max < 1e-4, "{info:?}");
    }
}
