//! Stencils on the device: force vectors, blocks of second derivatives and their products.
//!
//! A [`Stencil`] of energy `e(s)` has the positive semi-definite block `B ~ d2e/ds2`, so that
//! the Hessian on nodes `i, j` is `w_i w_j B`. Contact has `B = e''(d) n n^T` (the curvature
//! of the distance itself is left out: it is negative in the normal's plane); friction acts on
//! the part of `s` across `n`.
//!
//! Kernels: one pass over stencils evaluates `f` and `B`, one gathers diagonal blocks and
//! inverts them, and a product is one pass over stencils and one gather over nodes.

use bytemuck::Zeroable;

use super::kernels::{Packed, STENCIL_DIAGONAL, STENCIL_EVALUATE, STENCIL_GATHER, STENCIL_PRODUCT, Sizes};
use super::stencil::Stencil;
use crate::device::{Buffer, Device, DeviceError};
use crate::model::Vec3;
use crate::solve::bsr::{BlockDiagonal, Bsr};

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
    fn places(s: &Stencil) -> impl Iterator<Item = usize> {
        let weights = s.weights;
        (0..4).filter(move |&k| weights[k] != 0.0)
    }
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
    use crate::drape::contact::stencil::Kind;

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

    /// A spring that is pulled, hardly pulled, slack, and one without a slack length.
    #[test]
    fn tension_blocks_are_the_derivative_of_its_force() {
        let pulled = |vector: Vec3, slack: f64| Stencil {
            kind: Kind::Tension,
            nodes: [0, 1, 2, 3],
            weights: [1.0, -1.0, 0.0, 0.0],
            normal: vector.try_normalize(0.0).unwrap_or_else(Vec3::x),
            gap: vector.norm(),
            radius: slack,
            stiffness: 300.0,
        };
        let along = Vec3::new(0.6, -0.5, 0.62).normalize();
        let cases = [(0.02, 0.015), (0.02, 0.019_9), (0.02, 0.03), (0.02, 0.0)];
        let device = Device::cpu();
        for (length, slack) in cases {
            let vector = along * length;
            let list = [pulled(vector, slack)];
            let stencils = Stencils::new(&device, 4, &list, &[Vec3::zeros(); 4]).unwrap();
            let b = stencils.second_derivatives(&device).unwrap()[0].map(f64::from);
            let block = nalgebra::Matrix3::new(b[0], b[5], b[4], b[5], b[1], b[3], b[4], b[3], b[2]);
            for c in 0..3 {
                let by = Vec3::ith(c, 1e-7);
                let force = |v: Vec3| pulled(v, slack).evaluate(&[]).1;
                let column = (force(vector + by) - force(vector - by)) / 2e-7;
                assert!(
                    (column - block.column(c)).norm() < 1e-4 * 300.0,
                    "{length} {slack}: {column} {block}"
                );
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
