//! The transfer on bodies whose answer is known.

mod kept;
pub(super) mod shapes;
mod steps;

use nalgebra::{DMatrix, Matrix3};

use super::activity::Active;
use super::boundary::Boundary;
use super::domain::{Domain, Kind, Lattice, WHOLE};
use super::element::{self, corner};
use super::field::Problem;
use super::stencil::Stencil;
use super::terms::{self, Terms};
use super::*;
use crate::geometry::Surface;
use crate::solve::cg::Operator;
use shapes::{block, joined, mapped, sphere};

fn transfer(source: &TriMesh, target: &TriMesh, garment: &[Vec3], params: &Params) -> Output {
    let input = Input { source, target, garments: vec![garment] };
    run(&Device::cpu(), &input, params).unwrap()
}

fn farthest(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
}

/// Every cell of a domain as if the surface cut it.
fn all_cut(domain: &Domain, surface: &Surface) -> Vec<Active> {
    let active = |&cell: &domain::Coordinates| {
        let centre = domain.lattice.centre(cell);
        let (distance, winding) = (surface.closest(&centre).distance, surface.winding_number(&centre));
        Active { cell, kind: Kind::Open, cut: true, distance, winding, share: WHOLE }
    };
    domain.cells.iter().map(active).collect()
}

fn pseudo_random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
}

/// A small domain of mixed kinds with a hole, and its system.
fn small_domain() -> Domain {
    let lattice = Lattice { origin: Vec3::zeros(), cell: 0.02 };
    let mut cells = Vec::new();
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                if [i, j, k] != [1, 1, 1] {
                    cells.push(([i, j, k], if i == 0 { Kind::Deep } else { Kind::Open }));
                }
            }
        }
    }
    Domain::new(lattice, cells).unwrap()
}

#[test]
fn the_operator_is_the_assembled_matrix() {
    let domain = small_domain();
    let p = Params::default();
    let ball = Surface::new(sphere(Vec3::repeat(0.031), 0.02, 3));
    let still = vec![Vec3::zeros(); ball.mesh().points.len()];
    let boundary = Boundary::new(&domain, &ball, &still, &all_cut(&domain, &ball), p.beta, 2);
    assert!(!boundary.masses.is_empty());
    let n = 3 * domain.nodes.len();
    let mut dense = DMatrix::<f64>::zeros(n, n);
    for (cell, nodes) in domain.cell_nodes.iter().enumerate() {
        let (_, outside) = boundary.outside[cell];
        let outside = f64::from(outside) / f64::from(WHOLE);
        let viscosity = terms::INSIDE + (1.0 - terms::INSIDE) * outside;
        let mut k = element::viscous(p.cell, p.nu) * viscosity + element::schur(p.cell, p.gamma) * outside;
        if let Some((_, mass)) = boundary.masses.iter().find(|(c, _)| *c as usize == cell) {
            k +=
                element::ElementMatrix::from_fn(|r, c| if r % 3 == c % 3 { mass[r / 3][c / 3] } else { 0.0 });
        }
        for (r, c) in (0..24).flat_map(|r| (0..24).map(move |c| (r, c))) {
            dense[(3 * nodes[r / 3] as usize + r % 3, 3 * nodes[c / 3] as usize + c % 3)] += k[(r, c)];
        }
    }
    assert!((&dense - dense.transpose()).abs().max() < 1e-12 * dense.abs().max());
    let device = Device::cpu();
    let terms = Terms::new(&domain, p.nu, p.gamma, &boundary);
    let stencil = Stencil::new(&device, &domain, &terms, &[]).unwrap();
    let mut seed = 7;
    let x: Vec<f32> = (0..n).map(|_| pseudo_random(&mut seed) as f32).collect();
    let (bx, by) = (device.upload("x", &x).unwrap(), device.zeros("y", n).unwrap());
    stencil.apply(&device, &bx, &by).unwrap();
    let exact = &dense * nalgebra::DVector::from_iterator(n, x.iter().map(|&x| f64::from(x)));
    for (found, exact_row) in device.read::<f32>(&by).unwrap().iter().zip(exact.iter()) {
        // 27 blocks of 3 in f32, relative to the largest terms of a row.
        assert!((f64::from(*found) - exact_row).abs() < 81.0 * 6e-8 * dense.abs().max());
    }
}

#[test]
fn what_is_asked_for_grows_by_what_is_missed() {
    let domain = small_domain();
    let ball = Surface::new(sphere(Vec3::repeat(0.031), 0.02, 3));
    let shift = Vec3::new(0.003, -0.001, 0.002);
    let wanted = vec![shift; ball.mesh().points.len()];
    let new = || Boundary::new(&domain, &ball, &wanted, &all_cut(&domain, &ball), 1e6, 2);
    let (still, met) = (vec![Vec3::zeros(); domain.nodes.len()], vec![shift; domain.nodes.len()]);
    let first = new();
    let mut missed = new();
    missed.augment(&domain, &still);
    let mut reached = new();
    reached.augment(&domain, &met);
    for ((a, b), c) in first.load.iter().zip(&missed.load).zip(&reached.load) {
        assert!((a * 2.0 - b).norm() <= 1e-12 * b.norm() && (a - c).norm() <= 1e-12 * a.norm());
    }
}

/// Solves with the outer nodes of a solid block of cells held at `map(x) - x`, the rest free.
fn solve_block(map: impl Fn(&Vec3) -> Vec3, params: &Params) -> (Vec<Vec3>, Vec<Vec3>) {
    let lattice = Lattice { origin: Vec3::zeros(), cell: params.cell };
    let n = 5;
    let cells = (0..n * n * n).map(|c| ([c / (n * n), c / n % n, c % n], Kind::Open)).collect();
    let domain = Domain::new(lattice, cells).unwrap();
    let fixed: Vec<bool> = domain.nodes.iter().map(|node| node.iter().any(|&c| c == 0 || c == n)).collect();
    let place = |node: &domain::Coordinates| Vec3::from(node.map(|c| f64::from(c) * params.cell));
    let exact: Vec<Vec3> = domain.nodes.iter().map(|node| map(&place(node)) - place(node)).collect();
    let mut u: Vec<Vec3> =
        exact.iter().zip(&fixed).map(|(u, &f)| if f { *u } else { Vec3::zeros() }).collect();
    let device = Device::cpu();
    let problem = Problem::new(&device, params, &domain, Boundary::default(), &fixed, &u).unwrap();
    let info = problem.solve(&mut u).unwrap();
    assert!(info.converged, "{info:?}");
    (u, exact)
}

#[test]
fn affine_maps_pass_the_patch_test() {
    let params = Params { inner_tolerance: 1e-7, ..Params::default() };
    let grow = Matrix3::new(1.2, 0.1, 0.0, -0.05, 1.1, 0.2, 0.1, 0.0, 1.05);
    let shrink = Matrix3::new(0.8, 0.1, 0.0, -0.05, 0.9, 0.2, 0.1, 0.0, 0.7);
    for m in [grow, shrink] {
        let (u, exact) = solve_block(|x| m * x + Vec3::new(0.03, -0.02, 0.01), &params);
        assert!(farthest(&u, &exact) < 1e-6, "{}", farthest(&u, &exact));
    }
}

#[test]
fn moved_and_turned_bodies_take_the_garment_along() {
    let source = sphere(Vec3::new(0.1, 1.0, -0.2), 0.12, 4);
    let garment = sphere(Vec3::new(0.1, 1.0, -0.2), 0.15, 3).points;
    let turn = *nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.1).matrix();
    let motions = [
        (1e-5, Matrix3::identity(), Vec3::zeros()),
        (1e-6, Matrix3::identity(), Vec3::new(0.7, -0.2, 1.3)),
        (1e-6, turn, Vec3::new(0.2, 0.1, 0.0)),
    ];
    for (tolerance, linear, shift) in motions {
        let map = |p: &Vec3| linear * p + shift;
        let out = transfer(&source, &mapped(&source, map), &garment, &Params::default());
        let expected: Vec<Vec3> = garment.iter().map(map).collect();
        assert!(farthest(&out.garments[0], &expected) < tolerance);
        assert!(out.infos[0].converged && (out.infos[0].determinant_min - 1.0).abs() < 1e-6);
    }
}

#[test]
fn a_growing_sphere_carries_its_shell_outwards() {
    let source = sphere(Vec3::zeros(), 0.12, 5);
    let target = mapped(&source, |p| p * (0.13 / 0.12));
    let garment = sphere(Vec3::zeros(), 0.14, 4).points;
    let out = transfer(&source, &target, &garment, &Params::default());
    let info = &out.infos[0];
    assert!(info.converged && info.gap_p99_m < 1e-3, "{info:?}");
    let radii: Vec<f64> = out.garments[0].iter().map(|p| p.norm()).collect();
    let (low, high) = radii.iter().fold((f64::MAX, 0.0f64), |(l, h), r| (l.min(*r), h.max(*r)));
    // The flow decays from 10 mm at the skin; a shell 20 mm away goes most of the way.
    assert!(low > 0.144 && high < 0.150, "{low} {high}");
    assert!(high - low < 0.001, "the lattice shows: {low} {high}");
    assert_eq!(info.points_inside, 0);
}

#[test]
fn a_rerun_gives_the_same_bytes_and_mates_change_nothing() {
    let source = sphere(Vec3::zeros(), 0.12, 4);
    let target = mapped(&source, |p| Vec3::new(1.2 * p.x, 0.9 * p.y, p.z));
    let near = sphere(Vec3::zeros(), 0.14, 3).points;
    let far = sphere(Vec3::zeros(), 0.33, 3).points;
    let both = Input { source: &source, target: &target, garments: vec![&near, &far] };
    let together = run(&Device::cpu(), &both, &Params::default()).unwrap();
    for (g, garment) in [near, far].iter().enumerate() {
        let alone = transfer(&source, &target, garment, &Params::default());
        assert_eq!(alone.garments[0], together.garments[g]);
        assert_eq!(alone.body, together.body);
    }
    assert!(together.infos[1].active_cells > together.infos[0].active_cells);
    assert!(together.infos[1].converged);
}

#[test]
fn resisting_compression_keeps_a_pinched_gap_open() {
    let plate = |y: f64| block(Vec3::new(-0.1, y, -0.1), Vec3::new(0.1, y + 0.06, 0.1), 12);
    let source = joined(plate(-0.12), plate(0.06));
    let target = mapped(&source, |p| Vec3::new(p.x, p.y - 0.04 * p.y.signum(), p.z));
    let garment: Vec<Vec3> =
        (0..81).map(|i| Vec3::new(f64::from(i / 9) - 4.0, 0.0, f64::from(i % 9) - 4.0) * 0.02).collect();
    let determinant = |gamma: f64| {
        let params = Params { gamma, outer_iterations: 1, ..Params::default() };
        let out = transfer(&source, &target, &garment, &params);
        assert!(out.infos[0].inner[0].converged, "{:?}", out.infos[0].inner);
        out.infos[0].determinant_min
    };
    let (with, without) = (determinant(0.01), determinant(1e6));
    assert!(with > without + 0.03, "{with} with, {without} without the volume term");
}

#[test]
fn bad_input_is_refused() {
    let body = sphere(Vec3::zeros(), 0.1, 2);
    let device = Device::cpu();
    let attempt = |source: &TriMesh, target: &TriMesh, garment: &[Vec3], params: &Params| {
        run(&device, &Input { source, target, garments: vec![garment] }, params).unwrap_err()
    };
    let good = Params::default();
    let mut short = body.clone();
    short.points.pop();
    assert!(matches!(attempt(&body, &short, &[], &good), Error::Topology { .. }));
    assert!(matches!(attempt(&short, &short, &[], &good), Error::Index { .. }));
    assert_eq!(attempt(&TriMesh::default(), &TriMesh::default(), &[], &good), Error::Empty);
    let nan = [Vec3::new(f64::NAN, 0.0, 0.0)];
    assert!(matches!(attempt(&body, &body, &nan, &good), Error::NotFinite { element: 0, .. }));
    let far = [Vec3::new(50.0, 0.0, 0.0)];
    let error = attempt(&body, &body, &far, &good);
    assert!(matches!(&error, Error::FarPoint { what, .. } if what == "garment 0"), "{error}");
    let huge = mapped(&body, |p| p * 1e5);
    assert!(matches!(attempt(&huge, &huge, &[], &good), Error::TooLarge { .. }));
    let thin = Params { band: 0.01, ..good.clone() };
    assert!(matches!(attempt(&body, &body, &[], &thin), Error::Setting { name: "band", .. }));
    let none = Params { gamma: 0.0, ..good };
    assert!(matches!(attempt(&body, &body, &[], &none), Error::Setting { name: "gamma", .. }));
}

#[test]
fn local_nodes_and_cells_around_a_node_mirror_each_other() {
    for o in 0..8 {
        assert_eq!(corner(7 - o), corner(o).map(|c| 1 - c));
    }
}
