//! Stencils on the device: force vectors, blocks of second derivatives and their products.
//!
//! A [`Stencil`] of energy `e(s)` has the positive semi-definite block `B ~ d2e/ds2`, so that
//! the Hessian on nodes `i, j` is `w_i w_j B`. Contact has `B = e''(d) n n^T` (the curvature
//! of the distance itself is left out: it is negative in the normal's plane); friction acts on
//! the part of `s` across `n`.
//!
//! Kernels: one pass over stencils evaluates `f` and `B`, one gathers diagonal blocks and
//! inverts them, and a product is one pass over stencils and one gather over nodes.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::stencil::{Kind, Stencil};
use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};
use crate::model::Vec3;
use crate::solve::bsr::{BlockDiagonal, Bsr};

/// Elements that a CPU task takes.
const GRAIN: usize = 512;

/// `struct Stencil` in stencil.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Packed {
    nodes: [u32; 4],
    weights: [f32; 4],
    normal: [f32; 3],
    gap: f32,
    radius: f32,
    stiffness: f32,
    kind: u32,
    pad: u32,
}

/// `struct Sizes` in stencil.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Sizes {
    n: u32,
    /// 1 / h^2 [1/s^2]
    inertia: f32,
    pad: [u32; 2],
}

const SHARED: &str = include_str!("stencil.wgsl");

static STENCIL_EVALUATE: Kernel = Kernel {
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

static STENCIL_DIAGONAL: Kernel = Kernel {
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

static STENCIL_PRODUCT: Kernel = Kernel {
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

static STENCIL_GATHER: Kernel = Kernel {
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

/// Stencils on the device, evaluated at one configuration.
#[derive(Debug)]
pub struct Stencils {
    count: usize,
    nodes: usize,
    stencils: Buffer<Packed>,
    weights: Buffer<f32>,
    start: Buffer<u32>,
    items: Buffer<u32>,
    /// Force vectors [N], shape `[stencils, 3]`.
    force: Buffer<[f32; 3]>,
    block: Buffer<[f32; 6]>,
    part: Buffer<[f32; 3]>,
}

impl Stencils {
    /// Uploads stencils over `nodes` nodes and evaluates them; `moved` are the nodes'
    /// displacements since the start of the step [m].
    ///
    /// # Errors
    /// A device's failure.
    pub fn new(
        device: &Device,
        nodes: usize,
        list: &[Stencil],
        moved: &[Vec3],
    ) -> Result<Stencils, DeviceError> {
        // A buffer is never empty: a stencil without weight stands for none.
        let mut packed: Vec<Packed> = list.iter().map(pack).collect();
        packed.resize(packed.len().max(1), Packed::zeroed());
        let (start, items) = incidence(nodes, list);
        let count = packed.len();
        let weights: Vec<f32> = packed.iter().flat_map(|s| s.weights).collect();
        let moved: Vec<[f32; 3]> = moved.iter().map(|m| [m.x as f32, m.y as f32, m.z as f32]).collect();
        let stencils = Stencils {
            count,
            nodes,
            stencils: device.upload("stencils", &packed)?,
            weights: device.upload("stencil weights", &weights)?,
            start: device.upload("stencil starts", &start)?,
            items: device.upload("stencil items", &items)?,
            force: device.zeros("stencil forces", count)?,
            block: device.zeros("stencil blocks", count)?,
            part: device.zeros("stencil parts", count)?,
        };
        let moved = device.upload("moved", &moved)?;
        let s = &stencils;
        let buffers: [&dyn crate::device::AnyBuffer; 4] = [&s.stencils, &moved, &s.force, &s.block];
        device.run(&STENCIL_EVALUATE, count, &s.sizes(count, 0.0), &buffers)?;
        Ok(stencils)
    }

    fn sizes(&self, n: usize, inertia: f64) -> Sizes {
        Sizes { n: n as u32, inertia: inertia as f32, pad: [0; 2] }
    }

    /// Adds `mass * inertia * x + sum w part` to `y`, with the stencils' forces as parts.
    ///
    /// # Errors
    /// A device's failure.
    pub fn add_gradient(
        &self,
        device: &Device,
        inertia: f64,
        mass: &Buffer<f32>,
        x: &Buffer<f32>,
        y: &Buffer<f32>,
    ) -> Result<(), DeviceError> {
        self.gather(device, inertia, mass, &self.force, x, y)
    }

    /// Adds `(mass * inertia + H) x` to `y`.
    ///
    /// # Errors
    /// A device's failure.
    pub fn add_product(
        &self,
        device: &Device,
        inertia: f64,
        mass: &Buffer<f32>,
        x: &Buffer<f32>,
        y: &Buffer<f32>,
    ) -> Result<(), DeviceError> {
        let sizes = self.sizes(self.count, 0.0);
        device.run(&STENCIL_PRODUCT, self.count, &sizes, &[&self.stencils, &self.block, x, &self.part])?;
        self.gather(device, inertia, mass, &self.part, x, y)
    }

    fn gather(
        &self,
        device: &Device,
        inertia: f64,
        mass: &Buffer<f32>,
        part: &Buffer<[f32; 3]>,
        x: &Buffer<f32>,
        y: &Buffer<f32>,
    ) -> Result<(), DeviceError> {
        let sizes = self.sizes(self.nodes, inertia);
        let buffers: [&dyn crate::device::AnyBuffer; 7] =
            [&self.start, &self.items, &self.weights, part, mass, x, y];
        device.run(&STENCIL_GATHER, self.nodes, &sizes, &buffers)
    }

    /// Second derivatives of each stencil, as upper triangles `xx yy zz yz xz xy` [N/m].
    ///
    /// # Errors
    /// A device's failure.
    pub fn second_derivatives(&self, device: &Device) -> Result<Vec<[f32; 6]>, DeviceError> {
        device.read(&self.block)
    }

    /// Writes the inverse of the whole system's diagonal blocks; `at` is the place of each
    /// row's diagonal block in `elastic`.
    ///
    /// # Errors
    /// A device's failure.
    pub fn invert_diagonal(
        &self,
        device: &Device,
        inertia: f64,
        mass: &Buffer<f32>,
        elastic: &Bsr,
        at: &Buffer<u32>,
        out: &BlockDiagonal,
    ) -> Result<(), DeviceError> {
        let sizes = self.sizes(self.nodes, inertia);
        let buffers: [&dyn crate::device::AnyBuffer; 8] =
            [&self.start, &self.items, &self.weights, &self.block, mass, at, &elastic.blocks, &out.blocks];
        device.run(&STENCIL_DIAGONAL, self.nodes, &sizes, &buffers)
    }
}

fn pack(s: &Stencil) -> Packed {
    Packed {
        nodes: s.nodes,
        weights: s.weights.map(|w| w as f32),
        normal: [s.normal.x as f32, s.normal.y as f32, s.normal.z as f32],
        gap: s.gap as f32,
        radius: s.radius as f32,
        stiffness: s.stiffness as f32,
        kind: s.kind as u32,
        pad: 0,
    }
}

/// For each node, the places (4 times the stencil, plus the slot) where it has a weight.
fn incidence(nodes: usize, list: &[Stencil]) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; nodes + 1];
    let places = |s: &Stencil| (0..4).filter(|&k| s.weights[k] != 0.0).collect::<Vec<_>>();
    for s in list {
        for k in places(s) {
            start[s.nodes[k] as usize + 1] += 1;
        }
    }
    for i in 0..nodes {
        start[i + 1] += start[i];
    }
    let mut next = start.clone();
    let mut items = vec![0u32; (start[nodes] as usize).max(1)];
    for (i, s) in list.iter().enumerate() {
        for k in places(s) {
            let at = &mut next[s.nodes[k] as usize];
            items[*at as usize] = (4 * i + k) as u32;
            *at += 1;
        }
    }
    (start, items)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> (Vec<Stencil>, Vec<Vec3>) {
        let wave = |i: usize, f: f64| (i as f64 * f).sin();
        let moved = (0..9).map(|i| Vec3::new(wave(i, 1.1), wave(i, 2.3), wave(i, 3.7)) * 1e-5).collect();
        let list = (0..40)
            .map(|i| {
                let normal = Vec3::new(wave(i, 0.7), wave(i, 1.9), 1.0).normalize();
                let kind = [Kind::Barrier, Kind::Spring, Kind::Friction, Kind::Force][i % 4];
                let t = 0.5 + 0.4 * wave(i, 5.1);
                let nodes = std::array::from_fn(|k| ((i * 5 + k * 2) % 9) as u32);
                let (gap, radius) = match kind {
                    Kind::Friction => (0.0, 1e-5),
                    _ => (2e-3 * t, 2e-3),
                };
                Stencil {
                    kind,
                    nodes,
                    weights: [t, 1.0 - t, -0.3, -0.7],
                    normal,
                    gap,
                    radius,
                    stiffness: 500.0,
                }
            })
            .collect();
        (list, moved)
    }

    /// The device's forces and blocks against the host's f64 forces and their differences.
    #[test]
    fn blocks_are_the_derivative_of_forces() {
        let (list, moved) = sample();
        let device = Device::cpu();
        let on_device = Stencils::new(&device, 9, &list, &moved).unwrap();
        let (force, block) = (device.read(&on_device.force).unwrap(), device.read(&on_device.block).unwrap());
        for (i, s) in list.iter().enumerate() {
            let (_, f) = s.evaluate(&moved);
            let scale = f.norm().max(1e-3);
            let b = block[i].map(f64::from);
            let b = nalgebra::Matrix3::new(b[0], b[5], b[4], b[5], b[1], b[3], b[4], b[3], b[2]);
            for c in 0..3 {
                assert!((f64::from(force[i][c]) - f[c]).abs() < 2e-6 * scale, "{s:?}");
                let h = 1e-9;
                let mut direction = Vec3::zeros();
                direction[c] = h;
                // The relative displacement moves by `direction` when all weights do.
                let shift = |sign: f64| {
                    let mut s = *s;
                    s.gap += sign * s.normal.dot(&direction);
                    let mut moved = moved.clone();
                    let share = direction * (sign / s.weights.iter().map(|w| w * w).sum::<f64>());
                    for k in 0..4 {
                        moved[s.nodes[k] as usize] += share * s.weights[k];
                    }
                    s.evaluate(&moved).1
                };
                let column = (shift(1.0) - shift(-1.0)) / (2.0 * h);
                assert!((column - b.column(c)).norm() < 1e-4 * b.norm().max(1.0), "{s:?} {column} {b}");
            }
        }
    }

    #[test]
    fn diagonal_is_inverse_of_product() {
        let (list, moved) = sample();
        let device = Device::cpu();
        let stencils = Stencils::new(&device, 9, &list, &moved).unwrap();
        let columns: Vec<u32> = (0..9).collect();
        let starts: Vec<u32> = (0..10).collect();
        let elastic = Bsr::new(&device, &starts, &columns).unwrap();
        let mass = device.upload("mass", &[0.3f32; 9]).unwrap();
        let at = device.upload("at", &columns).unwrap();
        let out = BlockDiagonal { blocks: device.zeros("inverse", 9).unwrap() };
        stencils.invert_diagonal(&device, 1000.0, &mass, &elastic, &at, &out).unwrap();
        let inverse = device.read(&out.blocks).unwrap();
        for node in 0..9 {
            for c in 0..3 {
                let mut unit = vec![0.0f32; 27];
                unit[3 * node + c] = 1.0;
                let x = device.upload("x", &unit).unwrap();
                let y = device.zeros::<f32>("y", 27).unwrap();
                stencils.add_product(&device, 1000.0, &mass, &x, &y).unwrap();
                let y = device.read(&y).unwrap();
                for r in 0..3 {
                    let z: f32 = (0..3).map(|j| inverse[node][3 * r + j] * y[3 * node + j]).sum();
                    assert!((z - f32::from(u8::from(r == c))).abs() < 1e-3, "{z}");
                }
            }
        }
    }
}
