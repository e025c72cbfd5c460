//! The cycle against what it is made of, and its rate over the cell size.

use nalgebra::DMatrix;

use super::*;
use crate::geometry::Surface;
use crate::geometry::surface::tests::sphere;
use crate::model::{TriMesh, Vec3};
use crate::solve::cg::{Cg, CgParams};
use crate::transfer::Params;
use crate::transfer::activity::{self, Band, narrow_band};
use crate::transfer::boundary::Boundary;
use crate::transfer::domain::Lattice;

/// The band around a ball of 0.12 m that is to be pulled along, and its system.
fn ball(cell: f64, band: f64) -> (Domain, Boundary, Terms) {
    let mut mesh = sphere(24, 36);
    mesh.points.iter_mut().for_each(|p| *p *= 0.12);
    let surface = Surface::new(mesh);
    let displacement: Vec<Vec3> = surface.mesh().points.iter().map(|p| Vec3::new(p.y, 0.02, -p.x)).collect();
    let (lo, hi) = TriMesh::bounds(surface.mesh()).unwrap();
    let lattice = Lattice { origin: lo.add_scalar(-0.3 * cell), cell };
    let active = narrow_band(&surface, lattice, Band { width: band, fade: 0.5 * band }, &lo, &hi);
    let domain = activity::domain(lattice, &active).unwrap();
    let params = Params::default();
    let beta = 4.0 * params.nu / (cell * cell);
    let boundary = Boundary::new(&domain, &surface, &displacement, &active, beta, 2);
    let terms = Terms::new(&domain, params.nu, params.gamma, &boundary);
    (domain, boundary, terms)
}

fn dense(domain: &Domain, terms: &Terms, free: impl Fn(usize) -> bool) -> DMatrix<f64> {
    let n = 3 * domain.nodes.len();
    let mut matrix = DMatrix::zeros(n, n);
    for (cell, nodes) in domain.cell_nodes.iter().enumerate() {
        let mut k = terms.elements[terms.element_of_cell[cell] as usize];
        if let Some((_, mass)) = terms.masses.iter().find(|(c, _)| *c as usize == cell) {
            for (r, c) in (0..24).flat_map(|r| (0..24).map(move |c| (r, c))).filter(|(r, c)| r % 3 == c % 3) {
                k[(r, c)] += mass[r / 3][c / 3];
            }
        }
        for (r, c) in (0..24).flat_map(|r| (0..24).map(move |c| (r, c))) {
            let (i, j) = (nodes[r / 3] as usize, nodes[c / 3] as usize);
            if free(i) && free(j) {
                matrix[(3 * i + r % 3, 3 * j + c % 3)] += k[(r, c)];
            }
        }
    }
    matrix
}

#[test]
fn coarse_systems_are_the_fine_one_through_interpolation() {
    let (fine, _, terms) = ball(0.05, 0.1);
    let fixed: Vec<bool> = (0..fine.nodes.len()).map(|i| i % 7 == 0).collect();
    let coarse = coarser(&fine);
    let links = links(&fine, &fixed, &coarse);
    let mut interpolation = DMatrix::<f64>::zeros(3 * fine.nodes.len(), 3 * coarse.nodes.len());
    for (i, parents) in links.parents.iter().enumerate().filter(|(i, _)| !fixed[*i]) {
        for (&parent, c) in parents.iter().flat_map(|p| (0..3).map(move |c| (p, c))) {
            interpolation[(3 * i + c, 3 * parent as usize + c)] += 0.125;
        }
    }
    for (j, children) in links.children.iter().enumerate() {
        for (k, &child) in children.iter().enumerate().filter(|(_, c)| **c != u32::MAX) {
            let weight: f64 =
                [k / 9, k / 3 % 3, k % 3].iter().map(|&o| if o == 1 { 1.0 } else { 0.5 }).product();
            assert_eq!(interpolation[(3 * child as usize, 3 * j)], weight);
        }
    }
    let exact = interpolation.transpose() * dense(&fine, &terms, |i| !fixed[i]) * &interpolation;
    let found = dense(&coarse, &galerkin(&fine, &terms, &fixed, &coarse), |_| true);
    assert!((&found - &exact).abs().max() < 1e-12 * exact.abs().max());
}

#[test]
fn the_cycle_is_symmetric_and_positive() {
    let (domain, _, terms) = ball(0.03, 0.07);
    let fixed: Vec<bool> = (0..domain.nodes.len()).map(|i| i % 11 == 0).collect();
    let device = Device::cpu();
    let stencil = Stencil::new(&device, &domain, &terms, &fixed).unwrap();
    let multigrid = Multigrid::new(&device, &domain, &terms, &fixed).unwrap();
    assert!(multigrid.nodes().len() > 2, "{:?}", multigrid.nodes());
    let n = 3 * domain.nodes.len();
    let probe = |seed: f64| -> Vec<f32> {
        let value = |k: usize| if fixed[k / 3] { 0.0 } else { ((k as f64 + seed) * 12.9898).sin() as f32 };
        (0..n).map(value).collect()
    };
    let cycle = |x: &[f32]| {
        let (b, y) = (device.upload("b", x).unwrap(), device.zeros("y", n).unwrap());
        multigrid.over(&stencil).apply(&device, &b, &y).unwrap();
        device.read::<f32>(&y).unwrap()
    };
    let dot =
        |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
    let (a, b) = (probe(0.3), probe(700.7));
    let (va, vb) = (cycle(&a), cycle(&b));
    let size = dot(&a, &va).sqrt() * dot(&b, &vb).sqrt();
    assert!(dot(&a, &va) > 0.0 && (dot(&a, &vb) - dot(&b, &va)).abs() < 1e-5 * size);
}

#[test]
fn iterations_do_not_grow_as_cells_shrink() {
    let iterations = |cell: f64| {
        let (domain, boundary, terms) = ball(cell, 0.08);
        let device = Device::cpu();
        let stencil = Stencil::new(&device, &domain, &terms, &[]).unwrap();
        let multigrid = Multigrid::new(&device, &domain, &terms, &[]).unwrap();
        let load: Vec<f32> =
            boundary.load.iter().flat_map(|f| [f.x as f32, f.y as f32, f.z as f32]).collect();
        let b = device.upload("load", &load).unwrap();
        let x = device.zeros("solution", load.len()).unwrap();
        let limits = CgParams { tolerance: 1e-4, max_iterations: 100 };
        let cg = Cg::new(&device, load.len()).unwrap().looking_every(1);
        let cycle = multigrid.over(&stencil);
        let (info, _) = cg.solve_from_zero(&device, &stencil, &cycle, &b, &x, &limits).unwrap();
        assert!(info.converged);
        info.iterations
    };
    let counts = [0.04, 0.03, 0.02, 0.0125].map(iterations);
    let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
    assert!(*most < 15 && *most <= least + least / 2, "{counts:?}");
}
