//! Kernels of stencils with their CPU twins: force vectors, blocks of second derivatives, the
//! gathering and inversion of diagonal blocks, and products. What they compute: [`super::operator`].

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::stencil::Kind;
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};

/// Elements that a CPU task takes.
const GRAIN: usize = 512;

/// `struct Stencil` in stencil.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Packed {
    pub nodes: [u32; 4],
    pub weights: [f32; 4],
    pub normal: [f32; 3],
    pub gap: f32,
    pub radius: f32,
    pub stiffness: f32,
    pub kind: u32,
    pub pad: u32,
}

/// `struct Sizes` in stencil.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Sizes {
    pub n: u32,
    /// 1 / h^2 [1/s^2]
    pub inertia: f32,
    pub pad: [u32; 2],
}

const SHARED: &str = include_str!("stencil.wgsl");

pub static STENCIL_EVALUATE: Kernel = Kernel {
    name: "stencil_evaluate",
    wgsl: &[INDEX_WGSL, SHARED, include_str!("stencil_evaluate.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write, Access::Write],
    host: |args| {
        let (stencils, moved) = (args.read::<Packed>(0), args.read::<[f32; 3]>(1));
        let force = args.write::<[f32; 3]>(2);
        let block = args.write::<[f32; 6]>(3);
        let out = force.par_iter_mut().zip(block.par_iter_mut());
        out.zip(stencils).with_min_len(GRAIN).for_each(|((f, b), s)| (*f, *b) = evaluate(s, moved));
    },
};

/// First and second derivative of the contact potentials; `barrier` and `spring` in WGSL.
fn slopes(s: &Packed) -> (f32, f32) {
    let (d, r, k) = (s.gap, s.radius, s.stiffness);
    if d >= r {
        return (0.0, 0.0);
    }
    if s.kind == Kind::Spring as u32 {
        let (x, reach) = (r - d, 3.0 * r);
        return if x <= reach { (-k * x, k) } else { (-k * reach, k * reach / x) };
    }
    let tau = 0.5 * r;
    if d >= tau {
        return (-k * (r - d), k);
    }
    let c = d.max(0.01 * r);
    let (g, h) = (-k * tau * tau / c, k * tau * tau / (c * c));
    (g + h * (d - c), h)
}

/// Force and block of a spring longer than its slack length; `pull` in WGSL.
fn pull(s: &Packed) -> ([f32; 3], [f32; 6]) {
    let n = s.normal;
    let longer = (s.gap - s.radius).max(0.0);
    let across = if s.gap > 0.0 { s.stiffness * longer / s.gap } else { s.stiffness };
    let along = if longer > 0.0 || s.radius == 0.0 { s.stiffness - across } else { 0.0 };
    let block = [
        across + along * n[0] * n[0],
        across + along * n[1] * n[1],
        across + along * n[2] * n[2],
        along * n[1] * n[2],
        along * n[0] * n[2],
        along * n[0] * n[1],
    ];
    (n.map(|c| s.stiffness * longer * c), block)
}

fn evaluate(s: &Packed, moved: &[[f32; 3]]) -> ([f32; 3], [f32; 6]) {
    let n = s.normal;
    let outer = |a: f32, t: [f32; 3]| {
        [a * t[0] * t[0], a * t[1] * t[1], a * t[2] * t[2], a * t[1] * t[2], a * t[0] * t[2], a * t[0] * t[1]]
    };
    if s.kind == Kind::Force as u32 {
        return (n.map(|c| s.stiffness * c), [0.0; 6]);
    }
    if s.kind == Kind::Tension as u32 {
        return pull(s);
    }
    if s.kind != Kind::Friction as u32 {
        let (g, h) = slopes(s);
        return (n.map(|c| g * c), outer(h, n));
    }
    let mut slip = [0.0f32; 3];
    for k in 0..4 {
        for c in 0..3 {
            slip[c] += s.weights[k] * moved[s.nodes[k] as usize][c];
        }
    }
    let along = slip[0] * n[0] + slip[1] * n[1] + slip[2] * n[2];
    for c in 0..3 {
        slip[c] -= along * n[c];
    }
    let y = (slip[0] * slip[0] + slip[1] * slip[1] + slip[2] * slip[2]).sqrt();
    let (across, onward) = if y >= s.radius {
        (s.stiffness / y, 0.0)
    } else {
        let q = y / s.radius;
        (s.stiffness * (2.0 - q) / s.radius, s.stiffness * (2.0 - 2.0 * q) / s.radius)
    };
    let t = if y > 0.0 { slip.map(|c| c / y) } else { slip };
    let (normal, tangent) = (outer(-across, n), outer(onward - across, t));
    let mut b = [across, across, across, 0.0, 0.0, 0.0];
    for k in 0..6 {
        b[k] += normal[k] + tangent[k];
    }
    (slip.map(|c| across * c), b)
}

pub static STENCIL_DIAGONAL: Kernel = Kernel {
    name: "stencil_diagonal",
    wgsl: &[INDEX_WGSL, SHARED, include_str!("stencil_diagonal.wgsl")],
    access: &[
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Write,
    ],
    host: |args| {
        let inertia = args.params::<Sizes>().inertia;
        let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
        let (weights, block) = (args.read::<f32>(2), args.read::<[f32; 6]>(3));
        let (mass, at) = (args.read::<f32>(4), args.read::<u32>(5));
        let elastic = args.read::<[f32; 9]>(6);
        let out = args.write::<[f32; 9]>(7);
        out.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(node, out)| {
            let e = &elastic[at[node] as usize];
            let m = mass[node] * inertia;
            let mut d =
                [e[0] + m, e[4] + m, e[8] + m, 0.5 * (e[5] + e[7]), 0.5 * (e[2] + e[6]), 0.5 * (e[1] + e[3])];
            for &item in &items[start[node] as usize..start[node + 1] as usize] {
                let w = weights[item as usize];
                for k in 0..6 {
                    d[k] += w * w * block[item as usize / 4][k];
                }
            }
            *out = inverse(&d);
        });
    },
};

/// Inverse of a symmetric block (xx, yy, zz, yz, xz, xy).
fn inverse(d: &[f32; 6]) -> [f32; 9] {
    let [a, b, c, p, q, r] = *d;
    let m = [b * c - p * p, a * c - q * q, a * b - r * r, q * r - a * p, p * r - b * q, p * q - c * r];
    let det = a * m[0] + r * m[5] + q * m[4];
    let i = 1.0 / det;
    [m[0] * i, m[5] * i, m[4] * i, m[5] * i, m[1] * i, m[3] * i, m[4] * i, m[3] * i, m[2] * i]
}

pub static STENCIL_PRODUCT: Kernel = Kernel {
    name: "stencil_product",
    wgsl: &[INDEX_WGSL, SHARED, include_str!("stencil_product.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: |args| {
        let (stencils, block) = (args.read::<Packed>(0), args.read::<[f32; 6]>(1));
        let x = args.read::<[f32; 3]>(2);
        let y = args.write::<[f32; 3]>(3);
        y.par_iter_mut().with_min_len(4 * GRAIN).enumerate().for_each(|(i, y)| {
            let (s, b) = (&stencils[i], &block[i]);
            let mut v = [0.0f32; 3];
            for k in 0..4 {
                for c in 0..3 {
                    v[c] += s.weights[k] * x[s.nodes[k] as usize][c];
                }
            }
            *y = [
                b[0] * v[0] + b[5] * v[1] + b[4] * v[2],
                b[5] * v[0] + b[1] * v[1] + b[3] * v[2],
                b[4] * v[0] + b[3] * v[1] + b[2] * v[2],
            ];
        });
    },
};

pub static STENCIL_GATHER: Kernel = Kernel {
    name: "stencil_gather",
    wgsl: &[INDEX_WGSL, SHARED, include_str!("stencil_gather.wgsl")],
    access: &[
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Read,
        Access::Write,
    ],
    host: stencil_gather,
};

fn stencil_gather(args: &mut HostArgs<'_>) {
    let inertia = args.params::<Sizes>().inertia;
    let (start, items) = (args.read::<u32>(0), args.read::<u32>(1));
    let (weights, part) = (args.read::<f32>(2), args.read::<[f32; 3]>(3));
    let (mass, x) = (args.read::<f32>(4), args.read::<[f32; 3]>(5));
    let y = args.write::<[f32; 3]>(6);
    y.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(node, y)| {
        let m = mass[node] * inertia;
        for c in 0..3 {
            y[c] += m * x[node][c];
        }
        for &item in &items[start[node] as usize..start[node + 1] as usize] {
            let (w, p) = (weights[item as usize], &part[item as usize / 4]);
            for c in 0..3 {
                y[c] += w * p[c];
            }
        }
    });
}

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&STENCIL_EVALUATE, &STENCIL_DIAGONAL, &STENCIL_PRODUCT, &STENCIL_GATHER];
