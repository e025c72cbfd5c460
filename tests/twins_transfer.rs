//! Both halves of every kernel of `transfer` against one another.

mod common;

use common::{Random, words};
use dressform::device::{Device, Kernel};
use dressform::transfer;

const NONE: u32 = u32::MAX;
const SLOTS: usize = 27;

/// Input for a kernel, the buffer it writes, and how far two f32 results may be apart.
struct Case {
    invocations: usize,
    params: [u32; 4],
    buffers: Vec<Vec<u32>>,
    written: usize,
    bound: f32,
}

fn indices(random: &mut Random, count: usize, below: usize) -> Vec<u32> {
    (0..count).map(|_| (random.bits() % below as u64) as u32).collect()
}

fn stencil() -> Case {
    let (n, patterns, masses) = (1500, 7, 90);
    let mut random = Random::new(11);
    let neighbours = indices(&mut random, SLOTS * n, n);
    let rows =
        (0..n as u32).flat_map(|i| [i % patterns, if i % 3 == 0 { i % masses } else { NONE }]).collect();
    let mut blocks = random.vector(patterns as usize * SLOTS * 12);
    blocks.iter_mut().skip(3).step_by(4).for_each(|padding| *padding = 0.0);
    let mass = random.vector(masses as usize * SLOTS);
    let x = random.vector(3 * n);
    Case {
        invocations: n,
        params: [n as u32, 0, 0, 0],
        buffers: vec![neighbours, rows, words(&blocks), words(&mass), words(&x), vec![7; 3 * n]],
        written: 5,
        // 108 terms below 1, each rounded twice, on either device.
        bound: 2.0 * 108.0 * 108.0 * f32::EPSILON,
    }
}

fn pressure() -> Case {
    let (cells, nodes) = (1500, 400);
    let mut random = Random::new(12);
    let cell_nodes = indices(&mut random, 8 * cells, nodes);
    let shares = (0..cells as u32).map(|i| i % 9).collect();
    let u: Vec<f32> = random.vector(3 * nodes).iter().map(|v| 0.01 * v).collect();
    let (gamma, side) = (0.01f32, 0.02f32);
    Case {
        invocations: cells,
        params: [cells as u32, gamma.to_bits(), side.to_bits(), 0],
        buffers: vec![cell_nodes, shares, words(&u), vec![7; cells]],
        written: 3,
        // Gradients up to 1 in nine places: determinants up to 4 x 6 with some 40 roundings.
        bound: 40.0 * 24.0 * f32::EPSILON / gamma,
    }
}

fn residual() -> Case {
    let (nodes, cells) = (1500, 300);
    let mut random = Random::new(13);
    let mut node_cells = indices(&mut random, 8 * nodes, cells);
    node_cells.iter_mut().step_by(3).for_each(|cell| *cell = NONE);
    let vectors = [3 * nodes, 3 * nodes, cells].map(|n| words(&random.vector(n)));
    let [load, image, pressure] = vectors;
    Case {
        invocations: nodes,
        params: [nodes as u32, 0.5f32.to_bits(), 0, 0],
        buffers: vec![node_cells, load, image, pressure, vec![7; 3 * nodes]],
        written: 4,
        bound: 10.0 * 10.0 * f32::EPSILON,
    }
}

/// Nodes 0 to 199 are relaxed and read only the others, as those of one colour do.
fn relax() -> Case {
    let (n, patterns, masses, relaxed) = (1500, 7, 90, 200);
    let mut random = Random::new(14);
    let mut neighbours = indices(&mut random, SLOTS * n, n - relaxed);
    for (k, j) in neighbours.iter_mut().enumerate() {
        let own = k / SLOTS < relaxed && k % SLOTS == 13;
        *j = if own { (k / SLOTS) as u32 } else { *j + relaxed as u32 };
    }
    let rows =
        (0..n as u32).flat_map(|i| [i % patterns, if i % 3 == 0 { i % masses } else { NONE }]).collect();
    let mut blocks = random.vector(patterns as usize * SLOTS * 12);
    blocks.iter_mut().skip(3).step_by(4).for_each(|padding| *padding = 0.0);
    let order = (0..n as u32).rev().collect();
    let [mass, inverse, b, x] =
        [masses as usize * SLOTS, 9 * n, 3 * n, 3 * n].map(|n| words(&random.vector(n)));
    Case {
        invocations: relaxed,
        params: [relaxed as u32, (n - relaxed) as u32, 0, 0],
        buffers: vec![neighbours, rows, words(&blocks), mass, order, inverse, b, x],
        written: 7,
        // A row as in `stencil`, then three times an entry below 1.
        bound: 3.0 * 2.0 * 110.0 * 110.0 * f32::EPSILON,
    }
}

fn start() -> Case {
    let (n, first) = (1500, 190);
    let mut random = Random::new(15);
    let order = (0..n as u32).map(|i| (7 * i) % n as u32).collect();
    let [inverse, b] = [9 * n, 3 * n].map(|n| words(&random.vector(n)));
    Case {
        invocations: n,
        params: [n as u32, first, 0, 0],
        buffers: vec![order, inverse, b, vec![7; 3 * n]],
        written: 3,
        bound: 3.0 * 3.0 * f32::EPSILON,
    }
}

fn restrict() -> Case {
    let (coarse, fine) = (300, 1500);
    let mut random = Random::new(16);
    let mut children = indices(&mut random, 27 * coarse, fine);
    children.iter_mut().step_by(4).for_each(|child| *child = NONE);
    let [b, image] = [3 * fine, 3 * fine].map(|n| words(&random.vector(n)));
    Case {
        invocations: coarse,
        params: [coarse as u32, 0, 0, 0],
        buffers: vec![children, b, image, vec![7; 3 * coarse]],
        written: 3,
        bound: 2.0 * 28.0 * 16.0 * f32::EPSILON,
    }
}

fn prolong() -> Case {
    let (coarse, fine) = (300, 1500);
    let mut random = Random::new(17);
    let mut parents = indices(&mut random, 8 * fine, coarse);
    parents.chunks_mut(8).step_by(5).for_each(|parents| parents.fill(NONE));
    let [below, x] = [3 * coarse, 3 * fine].map(|n| words(&random.vector(n)));
    Case {
        invocations: fine,
        params: [fine as u32, 0, 0, 0],
        buffers: vec![parents, below, x],
        written: 2,
        bound: 9.0 * 2.0 * f32::EPSILON,
    }
}

fn case_of(kernel: &Kernel) -> Case {
    match kernel.name {
        "transfer_relax" => relax(),
        "transfer_start" => start(),
        "transfer_restrict" => restrict(),
        "transfer_prolong" => prolong(),
        "transfer_stencil" => stencil(),
        "transfer_pressure" => pressure(),
        "transfer_residual" => residual(),
        name => panic!("kernel '{name}' has no case"),
    }
}

#[test]
fn every_kernel_of_transfer_agrees_with_its_twin() {
    let gpu = common::gpu("every_kernel_of_transfer_agrees_with_its_twin");
    for kernel in transfer::KERNELS {
        let case = case_of(kernel);
        let run = |device: &Device| {
            let out = common::run(device, kernel, case.invocations, &case.params, &case.buffers);
            let again = common::run(device, kernel, case.invocations, &case.params, &case.buffers);
            assert_eq!(out, again, "kernel '{}': not the same bytes twice", kernel.name);
            out[case.written].iter().map(|&bits| f32::from_bits(bits)).collect::<Vec<_>>()
        };
        let expected = run(&Device::cpu());
        assert!(expected.iter().any(|v| v.abs() > 0.5), "kernel '{}' computes something", kernel.name);
        let Some(gpu) = &gpu else { continue };
        for (i, (found, expected)) in run(gpu).iter().zip(&expected).enumerate() {
            let apart = (found - expected).abs();
            assert!(apart <= case.bound, "kernel '{}': element {i} is {found}, not {expected}", kernel.name);
        }
    }
}
