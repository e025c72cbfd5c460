//! Closed forms, an ADMM as second solver, finite differences, and bad input.

mod girths;
mod outlines;

use super::*;
use crate::model::garment::GarmentSource;
use crate::model::{AuthoredSeam, Panel};

/// Grid panels of `nx` x `ny` cells, each `(width, height, origin)`, laid out in the plane z = 0.
struct Sheet {
    source: GarmentSource,
    rows: u32,
    columns: u32,
}

impl Sheet {
    fn new(nx: u32, ny: u32) -> Sheet {
        let source = GarmentSource { name: "sheet".into(), path: "/sheet".into(), ..Default::default() };
        Sheet { source, rows: ny + 1, columns: nx + 1 }
    }

    /// Adds a panel `width` x `height` with its lower corner at `origin`; alternating diagonals.
    fn panel(&mut self, origin: Vec2, width: f64, height: f64) {
        let base = self.source.mesh.points.len() as u32;
        let panel = self.source.panels.len() as u32;
        self.source.panels.push(Panel { name: format!("panel{panel}"), ..Default::default() });
        let (nx, ny) = (self.columns - 1, self.rows - 1);
        let uv =
            |i: u32, j: u32| origin + Vec2::new(width * i as f64 / nx as f64, height * j as f64 / ny as f64);
        for j in 0..=ny {
            for i in 0..=nx {
                let p = uv(i, j);
                self.source.mesh.points.push(Vec3::new(p.x, p.y, 0.0));
            }
        }
        let at = |i: u32, j: u32| base + j * (nx + 1) + i;
        for j in 0..ny {
            for i in 0..nx {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let order = if (i + j) % 2 == 0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
                for tri in order {
                    self.source.mesh.triangles.push(tri.map(|k| at(corners[k].0, corners[k].1)));
                    self.source.corner_pattern.push(tri.map(|k| uv(corners[k].0, corners[k].1)));
                    self.source.panel_of_triangle.push(panel);
                }
            }
        }
    }

    /// Sews the right side of panel `a` to the left side of panel `b`.
    fn sew(&mut self, a: u32, b: u32) {
        let per_panel = self.rows * self.columns;
        let pairs = (0..self.rows)
            .map(|j| [a * per_panel + (j + 1) * self.columns - 1, b * per_panel + j * self.columns])
            .collect();
        self.source.seams.push(AuthoredSeam { name: format!("s{a}{b}"), pairs, offset: false });
    }

    fn garment(self, place: impl Fn(Vec2) -> Vec3) -> Garment {
        let mut garment = Garment::from_source(self.source).unwrap();
        garment.points = garment.pattern.iter().map(|&p| place(p)).collect();
        garment
    }
}

fn strip() -> Sheet {
    let mut sheet = Sheet::new(12, 6);
    sheet.panel(Vec2::zeros(), 0.6, 0.3);
    sheet
}

/// Two strips sewn side by side; the second stands apart in the pattern.
fn pair() -> Sheet {
    let mut sheet = Sheet::new(8, 6);
    sheet.panel(Vec2::zeros(), 0.4, 0.3);
    sheet.panel(Vec2::new(0.6, 0.0), 0.4, 0.3);
    sheet.sew(0, 1);
    sheet
}

/// On a cylinder of radius `r` about the x axis, stretched by `sx` and `sy`.
fn rolled(r: f64, sx: f64, sy: f64) -> impl Fn(Vec2) -> Vec3 {
    move |p| {
        let angle = p.y * sy / r;
        Vec3::new(p.x * sx, r * angle.sin(), r * angle.cos())
    }
}

fn largest_difference(a: &[Vec2], b: &[Vec2]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
}

/// Largest relative deviation of triangle edges from those of the original scaled by `s`.
fn shape_error(garment: &Garment, pattern: &[Vec2], s: Vec2) -> f64 {
    let mut worst: f64 = 0.0;
    for tri in &garment.triangles {
        for k in 0..3 {
            let (i, j) = (tri[k] as usize, tri[(k + 1) % 3] as usize);
            let rest = (garment.pattern[j] - garment.pattern[i]).component_mul(&s);
            worst = worst.max((pattern[j] - pattern[i] - rest).norm() / rest.norm());
        }
    }
    worst
}

/// Deterministic noise in [-1, 1].
fn noise(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    ((*seed >> 33) as f64 / (1u64 << 31) as f64) * 2.0 - 1.0
}

#[test]
fn unchanged_garment_gives_its_pattern_back() {
    for tidy in [Tidy::Crumpled, Tidy::All] {
        let garment = pair().garment(rolled(0.1, 1.05, 0.98));
        let (pattern, info) = run(&garment, &garment.points, &Params { tidy, ..Params::default() }).unwrap();
        assert!(largest_difference(&pattern, &garment.pattern) < 1e-6);
        assert!(info.strain_change_p99 < 1e-6 && info.seam_mismatch_max < 1e-6, "{info:?}");
        assert!((info.area_ratio - 1.0).abs() < 1e-6);
        assert_eq!((info.flipped_triangles, info.repaired, info.chains), (0, Repair::None, 1));
    }
}

#[test]
fn scaled_garment_scales_its_pattern() {
    let garment = pair().garment(rolled(0.1, 1.02, 1.0));
    let target: Vec<Vec3> = garment.points.iter().map(|p| p * 1.3).collect();
    let (pattern, info) = run(&garment, &target, &Params::default()).unwrap();
    assert!(shape_error(&garment, &pattern, Vec2::new(1.3, 1.3)) < 1e-3);
    assert!((info.area_ratio - 1.69).abs() < 2e-3, "{info:?}");
}

#[test]
fn stretched_strip_follows_along_each_axis() {
    let garment = strip().garment(rolled(0.1, 1.0, 1.0));
    let target: Vec<Vec3> = garment.pattern.iter().map(|&p| rolled(0.15, 1.4, 0.8)(p)).collect();
    let (pattern, info) = run(&garment, &target, &Params::default()).unwrap();
    // Chords are shorter than arcs by (dy / r)^2 / 24: 1.04e-2 on the source, 0.30e-2 on the
    // target, and `keep` carries the source's over.
    let error = shape_error(&garment, &pattern, Vec2::new(1.4, 0.8));
    assert!((error - 7.4e-3).abs() < 2e-4, "{error}");
    assert!(info.strain_change_p99 < 1e-6, "{info:?}");
}

#[test]
fn tight_garment_keeps_its_strain_and_loose_gives_it_up() {
    let flat = |s: f64| move |p: Vec2| Vec3::new(p.x * s, p.y, 0.0);
    let garment = strip().garment(flat(1.1));
    let target: Vec<Vec3> = garment.points.iter().map(|p| p * 1.2).collect();
    let strain = |fit: Fit| {
        let (pattern, info) = run(&garment, &target, &Params { fit, ..Params::default() }).unwrap();
        let s = frame::stretches(&garment, &pattern, &target).unwrap();
        let warp = s.iter().map(|s| s[(0, 0)]).fold((f64::MAX, 0.0f64), |(l, h), w| (l.min(w), h.max(w)));
        (warp, info.strain_change_p99)
    };
    let ((low, high), change) = strain(Fit::Keep);
    assert!((low - 1.1).abs() < 1e-4 && (high - 1.1).abs() < 1e-4 && change < 1e-4, "{low} {high}");
    let ((low, high), _) = strain(Fit::Loose);
    assert!((low - 1.0).abs() < 1e-4 && (high - 1.0).abs() < 1e-4, "{low} {high}");
}

#[test]
fn binding_agrees_with_the_pseudo_inverse() {
    let garment = strip().garment(rolled(0.1, 1.07, 0.95));
    let target: Vec<Vec3> = garment.pattern.iter().map(|&p| rolled(0.2, 1.2, 1.1)(p)).collect();
    let bindings = frame::bind(&garment, &target, Fit::Keep, &[]).unwrap();
    for (t, binding) in bindings.iter().enumerate() {
        let rest = frame::edges_2d(garment.pattern_corners(&garment.pattern, t)).try_inverse().unwrap();
        let space = |p: &[Vec3]| frame::edges_3d(garment.triangles[t].map(|v| p[v as usize]));
        let (f_ref, f_target) = (space(&garment.points) * rest, space(&target) * rest);
        let rotation = f_target * frame::stretch(&f_target).try_inverse().unwrap();
        let e = space(&target);
        let b =
            (e.transpose() * e).try_inverse().unwrap() * e.transpose() * rotation * frame::stretch(&f_ref);
        for k in 0..2 {
            assert!((b.row(k).transpose() - binding.gradients[k + 1]).norm() < 1e-9 * b.norm());
        }
    }
}

/// A sewn pair on a bumpy target: strain, outline and seams all have something to say.
fn bumpy() -> (Garment, Vec<Vec3>) {
    let garment = pair().garment(rolled(0.1, 1.03, 1.0));
    let target = garment.points.iter().map(|p| p * (1.15 + 0.2 * (9.0 * p.x + 4.0 * p.y).sin())).collect();
    (garment, target)
}

/// Weight of straight runs in the forms below.
const STRAIGHT: f64 = 1.7;

fn form(garment: &Garment, target: &[Vec3], weight: f64) -> (energy::Quadratic, Outline) {
    let bindings = frame::bind(garment, target, Fit::Keep, &[]).unwrap();
    let outline = Outline::new(garment, &Runs::new(garment));
    let weights = Weights { outline: weight, straight: STRAIGHT, anchor: 1e-6 };
    (energy::assemble(garment, &bindings, &outline, weights), outline)
}

#[test]
fn energy_is_what_its_formula_says_and_its_gradient_agrees() {
    let (garment, target) = bumpy();
    let (form, outline) = form(&garment, &target, 0.7);
    let n = garment.points.len();
    let mut seed = 7;
    let u: Vec<f64> = (0..form.right.len()).map(|_| noise(&mut seed)).collect();

    let mut expected = 0.0;
    for (t, b) in frame::bind(&garment, &target, Fit::Keep, &[]).unwrap().iter().enumerate() {
        let p = garment.pattern_corners(&energy::positions(&u, n), t);
        let f: Matrix2<f64> = (0..3).map(|k| p[k] * b.gradients[k].transpose()).sum();
        expected += 0.5 * b.area * (f - Matrix2::identity()).norm_squared();
    }
    let x = energy::positions(&u, n);
    for hood in &outline.neighbourhoods {
        for (j, rest) in &hood.arms {
            let z = x[*j as usize] - x[hood.vertex as usize];
            expected +=
                0.5 * outline.arm_weight(0.7, hood, rest) * (z - rest * u[2 * n + hood.scale]).norm_squared();
        }
    }
    let first = 2 * n + outline.scales;
    assert!(!outline.straight.is_empty());
    for (r, run) in outline.straight.iter().enumerate() {
        for ([i, j], rest) in &run.edges {
            let l = rest.norm();
            let turn = rest.perp(&(x[*j as usize] - x[*i as usize])) / (l * l);
            expected += 0.5 * STRAIGHT * run.reference_length * l * (turn - u[first + r]).powi(2);
        }
    }
    let value = form.value(&u);
    assert!((value - expected).abs() < 1e-5 * expected, "{value} {expected}"); // the anchor is the rest

    // Central differences of a quadratic are exact up to rounding.
    let gradient = form.gradient(&u);
    for i in (0..u.len()).step_by(11) {
        let at = |h: f64| {
            let mut v = u.clone();
            v[i] += h;
            form.value(&v)
        };
        let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
        assert!((slope - gradient[i]).abs() < 1e-8 * value, "{i}: {slope} {}", gradient[i]);
    }
}

/// The paper's alternation, with u += D x - z and |D x - z + u|^2.
#[test]
fn admm_with_its_dual_sign_put_right_reaches_the_direct_solution() {
    let (garment, target) = bumpy();
    let weight = 0.7;
    let (full, outline) = form(&garment, &target, weight);
    let mut direct = full.right.clone();
    SparseCholesky::new(direct.len(), &full.matrix).unwrap().solve(&mut direct);

    let n = garment.points.len();
    let arms: Vec<(usize, usize, Vec2, f64, usize)> = outline
        .neighbourhoods
        .iter()
        .flat_map(|h| {
            let outline = &outline;
            h.arms.iter().map(move |(j, rest)| {
                (*j as usize, h.vertex as usize, *rest, outline.arm_weight(weight, h, rest), h.scale)
            })
        })
        .collect();
    // E(x) plus the penalty 1/2 w |D x - z + u|^2, with the energy's own weights as penalties.
    let (mut base, _) = form(&garment, &target, 0.0);
    for &(j, i, _, w, _) in &arms {
        for axis in 0..2 {
            base.matrix.add_outer(w, &[(axis * n + j, 1.0), (axis * n + i, -1.0)]);
        }
    }
    let factor = SparseCholesky::new(base.right.len(), &base.matrix).unwrap();
    let mut z: Vec<Vec2> = arms.iter().map(|a| a.2).collect();
    let mut u = vec![Vec2::zeros(); arms.len()];
    let mut x = Vec::new();
    for _ in 0..20000 {
        let mut right = base.right.clone();
        for (k, &(j, i, _, w, _)) in arms.iter().enumerate() {
            for axis in 0..2 {
                let pull = w * (z[k] - u[k])[axis];
                right[axis * n + j] += pull;
                right[axis * n + i] -= pull;
            }
        }
        factor.solve(&mut right);
        x = energy::positions(&right, n);
        // argmin_z 1/2 w |z - S r|^2 + 1/2 w |y - z|^2 with y = D x + u: S fits y, z is midway.
        let y: Vec<Vec2> = arms.iter().zip(&u).map(|(a, u)| x[a.0] - x[a.1] + u).collect();
        let mut sums = vec![(0.0, 0.0); outline.scales];
        for (a, y) in arms.iter().zip(&y) {
            sums[a.4].0 += a.3 * y.dot(&a.2);
            sums[a.4].1 += a.3 * a.2.norm_squared();
        }
        let mut change: f64 = 0.0;
        for (k, a) in arms.iter().enumerate() {
            let new = (y[k] + a.2 * (sums[a.4].0 / sums[a.4].1)) * 0.5;
            change = change.max((new - z[k]).norm());
            z[k] = new;
            u[k] = y[k] - new;
        }
        if change < 1e-13 {
            break;
        }
    }
    let difference = largest_difference(&x, &energy::positions(&direct, n));
    assert!(difference < 1e-8, "{difference}");
}

#[test]
fn sewn_sides_that_want_different_lengths_end_equal() {
    let garment = pair().garment(rolled(0.1, 1.0, 1.0));
    // The first panel grows along the seam, the second does not.
    let target: Vec<Vec3> = (0..garment.points.len())
        .map(|v| {
            let grow = if garment.panel_of_vertex[v] == 0 { 1.2 } else { 1.0 };
            rolled(0.1, 1.0, grow)(garment.pattern[v])
        })
        .collect();
    let open = Params { seam_iterations: 0, ..Params::default() };
    let (_, loose) = run(&garment, &target, &open).unwrap();
    let (pattern, info) = run(&garment, &target, &Params::default()).unwrap();
    assert!(loose.seam_mismatch_max > 0.02 && !loose.converged, "{loose:?}");
    assert!(info.seam_mismatch_max < 1e-4 && info.converged && info.iterations < 10, "{info:?}");
    assert!(crate::model::seam_mismatch(&garment, &pattern) < 1e-4);
}

#[test]
fn crumpled_transfer_leaves_no_flip() {
    for (amount, seed) in [(0.01, 1), (0.03, 2), (0.08, 3)] {
        let (garment, mut target) = bumpy();
        let mut seed = seed;
        for p in &mut target {
            *p += Vec3::new(noise(&mut seed), noise(&mut seed), noise(&mut seed)) * amount;
        }
        for tidy in [Tidy::Crumpled, Tidy::All, Tidy::Never] {
            let (pattern, info) = run(&garment, &target, &Params { tidy, ..Params::default() }).unwrap();
            assert_eq!(info.flipped_triangles, 0, "{amount} {tidy:?} {info:?}");
            assert!(pattern.iter().all(|p| p.iter().all(|c| c.is_finite())));
        }
    }
}

#[test]
fn every_rung_of_the_repair_leaves_upright_triangles() {
    let garment = strip().garment(rolled(0.1, 1.0, 1.0));
    let border = tidy::border(&garment);
    let inner = (0..border.len()).find(|&v| !border[v]).unwrap();
    let mut thrown = garment.pattern.clone();
    thrown[inner] += Vec2::new(0.17, 0.05); // an inner vertex far outside of its ring
    assert!(!tidy::flipped(&garment, &thrown).is_empty());
    let repaired = tidy::repair(&garment, &border, &mut thrown).unwrap();
    assert!(repaired > Repair::None && tidy::flipped(&garment, &thrown).is_empty());

    let mut folded = garment.pattern.clone();
    folded[0] += Vec2::new(0.17, 0.12); // the corner of the outline is folded over
    let repaired = tidy::repair(&garment, &border, &mut folded).unwrap();
    let left = tidy::flipped(&garment, &folded);
    assert!(repaired > Repair::None && left.is_empty(), "{repaired:?} {left:?}");

    let mut mirrored: Vec<Vec2> = garment.pattern.iter().map(|p| Vec2::new(-p.x, p.y)).collect();
    tidy::repair(&garment, &border, &mut mirrored).unwrap();
    assert!(tidy::flipped(&garment, &mirrored).is_empty());
}

#[test]
fn bad_input_is_answered_with_an_error() {
    let garment = strip().garment(rolled(0.1, 1.0, 1.0));
    let params = Params::default();
    let short = &garment.points[1..];
    assert!(matches!(run(&garment, short, &params), Err(Error::Length { .. })));
    let mut target = garment.points.clone();
    target[3].y = f64::NAN;
    assert!(matches!(run(&garment, &target, &params), Err(Error::NotFinite { element: 3, .. })));
    let point = vec![Vec3::zeros(); garment.points.len()];
    assert!(matches!(run(&garment, &point, &params), Err(Error::Degenerate { .. })));
    let mut flat = garment.clone();
    flat.points = point;
    assert!(matches!(run(&flat, &garment.points, &params), Err(Error::Degenerate { .. })));
    let mut folded = garment.clone();
    folded.pattern.iter_mut().for_each(|p| p.y = 0.0);
    assert!(matches!(run(&folded, &garment.points, &params), Err(Error::Degenerate { .. })));
    let wrong = Params { anchor_weight: 0.0, ..Params::default() };
    assert!(matches!(run(&garment, &garment.points, &wrong), Err(Error::Setting { .. })));
}
