//! Both halves of every kernel of `solve` against an f64 reference.
//!
//! A result of `ops` roundings in f32 differs from the exact one by at most
//! `ops eps / (1 - ops eps)` times the sum of its terms' magnitudes [Higham 2002, 3.1]. The
//! references are computed in f64 with those magnitudes beside them.

mod common;

use common::stencil::{self, Stencil};
use common::{Random, words};
use dressform::device::{Device, Kernel};
use dressform::solve::bsr::{BlockDiagonal, Bsr};
use dressform::solve::cg::{Cg, CgInfo, CgParams};
use dressform::solve::{bsr, cg, dense, vector};

/// Input for a kernel, and what must come out of it.
struct Case {
    invocations: usize,
    params: [u32; 4],
    buffers: Vec<Vec<u32>>,
    expected: Vec<Expected>,
    /// Roundings in one result.
    ops: usize,
}

/// A written buffer's exact values, each with the sum of its terms' magnitudes.
struct Expected {
    slot: usize,
    values: Vec<(f64, f64)>,
}

fn product(a: f32, b: f32) -> f64 {
    f64::from(a) * f64::from(b)
}

/// Adds a term to a value and to its magnitude.
fn add(sum: &mut (f64, f64), term: f64) {
    *sum = (sum.0 + term, sum.1 + term.abs());
}

fn dot_partial() -> Case {
    let n = 70_003;
    let mut random = Random::new(1);
    let (x, y) = (random.vector(n), random.vector(n));
    let (lanes, turns) = (256, 64);
    let blocks = n.div_ceil(lanes * turns);
    let mut values = vec![(0.0, 0.0); blocks * lanes];
    for i in 0..n {
        add(&mut values[i / (lanes * turns) * lanes + i % lanes], product(x[i], y[i]));
    }
    Case {
        invocations: values.len(),
        params: [n as u32, blocks as u32, 0, 0],
        buffers: vec![words(&x), words(&y), vec![7; values.len()]],
        expected: vec![Expected { slot: 2, values }],
        ops: turns + 1,
    }
}

/// The scalars `[rz, alpha, beta, curvature]` and 1024 partial sums.
fn scalars() -> (Vec<f32>, [f32; 4], (f64, f64)) {
    let partials: Vec<f32> = Random::new(2).vector(1024).iter().map(|p| p + 0.5).collect();
    let mut sum = (0.0, 0.0);
    partials.iter().for_each(|&p| add(&mut sum, f64::from(p)));
    (partials, [3.25, 0.5, 0.25, 2.0], sum)
}

fn scalar_case(values: impl Fn([f32; 4], (f64, f64)) -> Vec<(f64, f64)>) -> Case {
    let (partials, before, sum) = scalars();
    // The quotient carries the sum's relative error, magnitude over value.
    let ops = partials.len() / 4 + 2 + 4;
    let values = values(before, sum);
    Case {
        invocations: 1,
        params: [partials.len() as u32, 1, 0, 0],
        buffers: vec![words(&partials), words(&before)],
        expected: vec![Expected { slot: 1, values }],
        ops,
    }
}

fn kept(value: f32) -> (f64, f64) {
    (f64::from(value), 0.0)
}

fn cg_alpha() -> Case {
    scalar_case(|[rz, _, beta, _], (sum, size)| {
        let alpha = f64::from(rz) / sum;
        vec![kept(rz), (alpha, 2.0 * alpha.abs() * size / sum), kept(beta), (sum, size)]
    })
}

fn cg_beta() -> Case {
    scalar_case(|[rz, alpha, _, curvature], (sum, size)| {
        let beta = sum / f64::from(rz);
        vec![(sum, size), kept(alpha), (beta, beta.abs() * size / sum), kept(curvature)]
    })
}

fn cg_advance() -> Case {
    let n = 10_001;
    let mut random = Random::new(3);
    let [p, q, x, r] = std::array::from_fn(|_| random.vector(n));
    let alpha = 0.37f32;
    let values = |at: &[f32], sign: f32, along: &[f32]| {
        (0..n)
            .map(|i| {
                let mut sum = (0.0, 0.0);
                add(&mut sum, f64::from(at[i]));
                add(&mut sum, product(sign * alpha, along[i]));
                sum
            })
            .collect()
    };
    let expected = vec![
        Expected { slot: 3, values: values(&x, 1.0, &p) },
        Expected { slot: 4, values: values(&r, -1.0, &q) },
    ];
    let scalars = words(&[1.0, alpha, 2.0, 3.0]);
    Case {
        invocations: n,
        params: [n as u32, 1, 0, 0],
        buffers: vec![scalars, words(&p), words(&q), words(&x), words(&r)],
        expected,
        ops: 2,
    }
}

fn cg_direction() -> Case {
    let n = 10_001;
    let mut random = Random::new(4);
    let [z, p] = std::array::from_fn(|_| random.vector(n));
    let beta = 0.83f32;
    let values = (0..n)
        .map(|i| {
            let mut sum = (0.0, 0.0);
            add(&mut sum, f64::from(z[i]));
            add(&mut sum, product(beta, p[i]));
            sum
        })
        .collect();
    Case {
        invocations: n,
        params: [n as u32, 1, 0, 0],
        buffers: vec![words(&[1.0, 2.0, beta, 3.0]), words(&z), words(&p)],
        expected: vec![Expected { slot: 2, values }],
        ops: 2,
    }
}

fn residual() -> Case {
    let n = 10_001;
    let mut random = Random::new(5);
    let [b, q] = std::array::from_fn(|_| random.vector(n));
    let values =
        (0..n).map(|i| (f64::from(b[i]) - f64::from(q[i]), f64::from(b[i].abs() + q[i].abs()))).collect();
    Case {
        invocations: n,
        params: [n as u32, 1, 0, 0],
        buffers: vec![words(&b), words(&q), vec![0; n]],
        expected: vec![Expected { slot: 2, values }],
        ops: 1,
    }
}

fn blocks_times(s: &Stencil, x: &[f32], row: usize, k: usize, column: usize, out: &mut [(f64, f64)]) {
    let block = if s.blocks.is_empty() { &s.inverse[k] } else { &s.blocks[k] };
    for i in 0..3 {
        for j in 0..3 {
            add(&mut out[3 * row + i], product(block[3 * i + j], x[3 * column + j]));
        }
    }
}

fn bsr_multiply() -> Case {
    let s = stencil::springs(9);
    let x = Random::new(6).vector(3 * s.rows());
    let mut values = vec![(0.0, 0.0); x.len()];
    for row in 0..s.rows() {
        for k in s.row_start[row] as usize..s.row_start[row + 1] as usize {
            blocks_times(&s, &x, row, k, s.columns[k] as usize, &mut values);
        }
    }
    let buffers = vec![
        s.row_start.clone(),
        s.columns.clone(),
        words(s.blocks.as_flattened()),
        words(&x),
        vec![0; x.len()],
    ];
    Case {
        invocations: s.rows(),
        params: [s.rows() as u32, 0, 0, 0],
        buffers,
        expected: vec![Expected { slot: 4, values }],
        ops: 4 * 27,
    }
}

fn block_multiply() -> Case {
    let s = Stencil { blocks: vec![], ..stencil::springs(9) };
    let x = Random::new(7).vector(3 * s.rows());
    let mut values = vec![(0.0, 0.0); x.len()];
    (0..s.rows()).for_each(|row| blocks_times(&s, &x, row, row, row, &mut values));
    Case {
        invocations: s.rows(),
        params: [s.rows() as u32, 0, 0, 0],
        buffers: vec![words(s.inverse.as_flattened()), words(&x), vec![0; x.len()]],
        expected: vec![Expected { slot: 2, values }],
        ops: 4,
    }
}

fn dense_multiply() -> Case {
    let n = 150;
    let mut random = Random::new(8);
    let (matrix, x) = (random.vector(n * n), random.vector(n));
    let row = |i: usize| {
        let terms = (0..n).map(|j| f64::from(matrix[n * i + j]) * f64::from(x[j]));
        (terms.clone().sum(), terms.map(f64::abs).sum())
    };
    Case {
        invocations: n,
        params: [n as u32, 0, 0, 0],
        expected: vec![Expected { slot: 2, values: (0..n).map(row).collect() }],
        buffers: vec![words(&matrix), words(&x), vec![0; n]],
        ops: n + 1,
    }
}

/// Cases by kernel.
type Cases = [(&'static str, fn() -> Case)];

const CASES: &Cases = &[
    ("dot_partial", dot_partial),
    ("cg_alpha", cg_alpha),
    ("cg_beta", cg_beta),
    ("cg_advance", cg_advance),
    ("cg_direction", cg_direction),
    ("residual", residual),
    ("bsr_multiply", bsr_multiply),
    ("block_multiply", block_multiply),
    ("dense_multiply", dense_multiply),
];

fn check(device: &Device, kernel: &'static Kernel, case: &Case) {
    let out = common::run(device, kernel, case.invocations, &case.params, &case.buffers);
    let again = common::run(device, kernel, case.invocations, &case.params, &case.buffers);
    assert_eq!(out, again, "kernel '{}' on {}: not the same bytes twice", kernel.name, device.info().name);
    let share = case.ops as f64 * f64::from(f32::EPSILON) / 2.0;
    for Expected { slot, values } in &case.expected {
        assert_eq!(values.len(), out[*slot].len());
        for (i, (&(value, size), &bits)) in values.iter().zip(&out[*slot]).enumerate() {
            let found = f64::from(f32::from_bits(bits));
            let bound = share / (1.0 - share) * size;
            assert!(
                (found - value).abs() <= bound,
                "kernel '{}' on {}: element {i} of buffer {slot} is {found:e}, not {value:e} to {bound:e}",
                kernel.name,
                device.info().name,
            );
        }
    }
}

#[test]
fn every_kernel_of_solve_agrees_with_f64() {
    let devices = common::devices("every_kernel_of_solve_agrees_with_f64");
    for kernel in [vector::KERNELS, cg::KERNELS, bsr::KERNELS, dense::KERNELS].concat() {
        let (_, case) = CASES
            .iter()
            .find(|(name, _)| *name == kernel.name)
            .unwrap_or_else(|| panic!("kernel '{}' has no case", kernel.name));
        let case = case();
        devices.iter().for_each(|device| check(device, kernel, &case));
    }
}

fn solve(device: &Device, s: &Stencil, b: &[f32], tolerance: f64) -> (Vec<f32>, CgInfo) {
    let mut a = Bsr::new(device, &s.row_start, &s.columns).expect("matrix");
    a.blocks = device.upload("blocks", &s.blocks).expect("upload");
    let inverse = BlockDiagonal { blocks: device.upload("inverse", &s.inverse).expect("upload") };
    let cg = Cg::new(device, b.len()).expect("work vectors");
    let b = device.upload("b", b).expect("upload");
    let x = device.zeros("x", b.len()).expect("zeros");
    let params = CgParams { tolerance, max_iterations: 400 };
    let info = cg.solve(device, &a, &inverse, &b, &x, &params).expect("solve");
    (device.read(&x).expect("read"), info)
}

#[test]
fn conjugate_gradients_solve_the_same_system_on_both() {
    let s = stencil::springs(16);
    let b = Random::new(8).vector(3 * s.rows());
    let exact: Vec<f64> = b.iter().map(|&v| f64::from(v)).collect();
    let tolerance = 1e-5;
    let mut iterations = Vec::new();
    for device in common::devices("conjugate_gradients_solve_the_same_system_on_both") {
        let (x, info) = solve(&device, &s, &b, tolerance);
        assert!(info.converged && info.residual <= tolerance, "{info:?}");
        // The recurrence's residual drifts from the true one by a rounding of A x a turn.
        let x64: Vec<f64> = x.iter().map(|&v| f64::from(v)).collect();
        let r: Vec<f64> = exact.iter().zip(&s.multiply(&x64)).map(|(b, q)| b - q).collect();
        let true_residual = s.norm(&r) / s.norm(&exact);
        let turns = info.iterations as f64;
        let drift = turns * f64::from(f32::EPSILON) * s.norm(&s.sizes(&x64)) / s.norm(&exact);
        assert!(true_residual <= tolerance + drift, "{true_residual:e} on {}", device.info().name);
        assert!(drift < 1e-3, "the bound says something: {drift:e}");
        let (again, _) = solve(&device, &s, &b, tolerance);
        assert_eq!(words(&x), words(&again), "the same bytes on {}", device.info().name);
        iterations.push(info.iterations);
    }
    let (least, most) = (iterations.iter().min(), iterations.iter().max());
    assert!(most <= least.map(|l| l + 8).as_ref(), "one look at the residual apart at most: {iterations:?}");
}
