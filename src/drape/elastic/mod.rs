//! Elastic energies of cloth (paper section 5.2, Intrinsic Energies): stretch, bending, seams.
//!
//! - [`stretch`]: anisotropic warp/weft/shear energy of [Kim 2020] with its analytic
//!   eigensystem, one element for each triangle.
//! - [`element`]: bending from the triangle's shape operator in warp/weft axes
//!   [Gingold 2004], and bending springs at seams [Bridson 2003], both made of [`hinge`]s.
//!
//! [`Elastic`] evaluates them for the nodes' displacements `u` from a reference that the host
//! holds in `f64` ([`Elastic::rebase`]). Positions never reach the device: edges are
//! reference edges plus differences of displacements, and strains and energies are changes
//! from the reference's own, which come from `f64`. So at `u = 0` forces are right to a
//! relative 1e-6 however far from the origin the cloth is, and differences of energies
//! between close displacements are not lost in their sum. A vertex moves as its node does:
//! seam offsets are part of the reference and turn only when it is rebased.
//!
//! All energies depend on shape alone: rigid motion gives no force, and the order of a
//! triangle's corners does not matter. Forces of every element sum to zero and have no
//! torque.
//!
//! # Kernels
//! Elements are linearised each on its own, then nodes and blocks gather what is theirs
//! ([`gather`]): `stretch_linearise`, `hinge_linearise`, `bend_linearise`, then
//! `*_gradient`, `*_blocks` and `mirror_blocks`. The formulas stand once in Rust, generic
//! over the float type (`f32` in the CPU twins, `f64` in [`Elastic::judge`]), and once in
//! WGSL.

pub mod bending;
pub mod element;
pub mod gather;
pub mod hinge;
mod judge;
pub mod membrane;
mod soften;
pub mod stretch;
#[cfg(test)]
pub(crate) mod tests;

use bytemuck::{Pod, Zeroable};
use nalgebra::Vector3;
use thiserror::Error;

use super::cloth::{Cloth, Hinge};
use crate::device::{Buffer, Device, DeviceError, Kernel};
use crate::model::Vec3;
use crate::solve::bsr::Bsr;
use gather::Assembly;
use judge::Judge;
pub use judge::Measured;

/// Elements that a kernel's CPU twin gives one task.
const GRAIN: usize = 512;

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[
    &membrane::STRETCH_ENERGY,
    &membrane::STRETCH_LINEARISE,
    &bending::HINGE_ANGLE,
    &bending::HINGE_LINEARISE,
    &bending::BEND_ENERGY,
    &bending::BEND_LINEARISE,
    &gather::STRETCH_GRADIENT,
    &gather::BEND_GRADIENT,
    &gather::STRETCH_BLOCKS,
    &gather::BEND_BLOCKS,
    &gather::MIRROR,
];

/// Why an energy cannot be evaluated.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// The device failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// An array has the wrong length.
    #[error("{what} has {found} elements, {expected} expected")]
    Length { what: &'static str, found: usize, expected: usize },
    /// The reference holds a coordinate that is not finite.
    #[error("vertex {0} of the reference is not finite")]
    NotFinite(usize),
    /// The cloth has more elements than an index on the device can name.
    #[error("{0} triangles and seam edges are more than can be indexed")]
    TooLarge(usize),
    /// No reference was set.
    #[error("rebase was not called before the energy was asked for")]
    NoReference,
}

/// `struct Count` in the shaders: number of invocations, and of triangles.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Count {
    n: u32,
    triangles: u32,
    pad: [u32; 2],
}

impl Count {
    fn new(n: usize) -> Count {
        Count { n: n as u32, triangles: 0, pad: [0; 2] }
    }
}

fn vector(v: &[f32; 3]) -> Vector3<f32> {
    Vector3::new(v[0], v[1], v[2])
}

/// Constants and scratch on the device.
#[derive(Debug)]
struct Buffers {
    triangle_nodes: Buffer<[u32; 3]>,
    triangle_rest: Buffer<[f32; 8]>,
    triangle_reference: Buffer<[f32; 9]>,
    hinge_nodes: Buffer<[u32; 4]>,
    hinge_rest: Buffer<[f32; 4]>,
    hinge_reference: Buffer<[f32; 9]>,
    element_hinges: Buffer<[u32; 3]>,
    element_weights: Buffer<[f32; 9]>,
    element_reference: Buffer<[f32; 3]>,
    bends: Buffer<f32>,
    bend_gradients: Buffer<[f32; 12]>,
    stretch: Buffer<f32>,
    bend: Buffer<f32>,
    energies: Buffer<f32>,
    upper: Buffer<[f32; 9]>,
    block_source: Buffer<u32>,
    stretch_nodes: [Buffer<u32>; 2],
    bend_nodes: [Buffer<u32>; 2],
    stretch_blocks: [Buffer<u32>; 2],
    bend_blocks: [Buffer<u32>; 2],
}

/// The elastic energy of a cloth, its gradient and Hessian.
#[derive(Debug)]
pub struct Elastic {
    judge: Judge,
    buffers: Buffers,
    gradient: Buffer<f32>,
    hessian: Bsr,
    diagonal: Vec<u32>,
    reference_energy: Option<f64>,
}

impl Elastic {
    /// Uploads what is constant of a cloth. Needs a [`Elastic::rebase`] before it can be asked.
    ///
    /// # Errors
    /// More elements than 32-bit indices reach, or the device fails.
    pub fn new(device: &Device, cloth: &Cloth) -> Result<Elastic, Error> {
        let judge = Judge::new(cloth);
        let (triangles, elements) = (judge.triangle_nodes.len(), judge.elements.len());
        if elements >= u32::MAX as usize / bending::DERIVATIVES.max(64) {
            return Err(Error::TooLarge(elements));
        }
        let assembly = Assembly::new(cloth.node_count, &judge.triangle_nodes, &judge.elements);
        let lists = |label, lists: &gather::Lists| -> Result<[Buffer<u32>; 2], DeviceError> {
            Ok([device.upload(label, &lists.start)?, device.upload(label, &lists.items)?])
        };
        let map = |f: fn(&element::BendElement) -> [f32; 9]| judge.elements.iter().map(f).collect::<Vec<_>>();
        let stretch_rest: Vec<[f32; 8]> = judge.stretch.iter().map(membrane::pack_rest).collect();
        let hinge_rest: Vec<[f32; 4]> = judge.hinge_rest.iter().map(bending::pack_rest).collect();
        let hinges: Vec<[u32; 3]> = judge.elements.iter().map(|e| e.hinges).collect();
        let buffers = Buffers {
            triangle_nodes: device.upload("triangle nodes", &judge.triangle_nodes)?,
            triangle_rest: device.upload("triangle rest", &stretch_rest)?,
            triangle_reference: device.zeros("triangle reference", triangles)?,
            hinge_nodes: device.upload("hinge nodes", &judge.hinge_nodes)?,
            hinge_rest: device.upload("hinge rest", &hinge_rest)?,
            hinge_reference: device.zeros("hinge reference", judge.hinges.len())?,
            element_hinges: device.upload("element hinges", &hinges)?,
            element_weights: device
                .upload("element weights", &map(|e| flat(&e.weights).map(|w| w as f32)))?,
            element_reference: device.zeros("element reference", elements)?,
            bends: device.zeros("hinge bends", judge.hinges.len())?,
            bend_gradients: device.zeros("hinge gradients", judge.hinges.len())?,
            stretch: device.zeros("stretch derivatives", triangles * membrane::DERIVATIVES)?,
            bend: device.zeros("bend derivatives", elements * bending::DERIVATIVES)?,
            energies: device.zeros("elastic energies", elements)?,
            upper: device.zeros("upper blocks", assembly.upper)?,
            block_source: device.upload("block source", &assembly.source)?,
            stretch_nodes: lists("stretch by node", &assembly.stretch_nodes)?,
            bend_nodes: lists("bend by node", &assembly.bend_nodes)?,
            stretch_blocks: lists("stretch by block", &assembly.stretch_blocks)?,
            bend_blocks: lists("bend by block", &assembly.bend_blocks)?,
        };
        Ok(Elastic {
            buffers,
            gradient: device.zeros("elastic gradient", 3 * cloth.node_count)?,
            hessian: Bsr::new(device, &assembly.row_start, &assembly.columns)?,
            diagonal: assembly.diagonal,
            reference_energy: None,
            judge,
        })
    }

    /// Makes `reference` (vertex positions [m], seam offsets included) the place from which
    /// displacements count.
    ///
    /// # Errors
    /// `reference` has another length than the cloth has vertices or holds a number that is
    /// not finite, or the device fails.
    pub fn rebase(&mut self, device: &Device, reference: &[Vec3]) -> Result<(), Error> {
        self.judge.check(reference)?;
        self.rebase_to(device, &self.judge.measure(reference))
    }

    /// As [`Elastic::rebase`] to where this was [`Elastic::measure`]d.
    ///
    /// # Errors
    /// The device fails.
    pub fn rebase_to(&mut self, device: &Device, measured: &Measured) -> Result<(), Error> {
        let Measured { stretch, hinge_edges, amounts, energy } = measured;
        let stretch: Vec<[f32; 9]> = stretch.iter().map(membrane::pack_reference).collect();
        let edges: Vec<[f32; 9]> =
            hinge_edges.iter().map(|edges| std::array::from_fn(|i| edges[i / 3][i % 3] as f32)).collect();
        let amounts: Vec<[f32; 3]> = amounts.iter().map(|a| a.map(|x| x as f32)).collect();
        device.write(&self.buffers.triangle_reference, &stretch)?;
        device.write(&self.buffers.hinge_reference, &edges)?;
        device.write(&self.buffers.element_reference, &amounts)?;
        self.reference_energy = Some(*energy);
        Ok(())
    }

    /// Makes the cloth and its seams `factor` times as stiff in bending as their fabrics are (at least
    /// 1, which is as they are). What is more than theirs resists bends from the hinges' angles
    /// `about` [rad], as [`Elastic::angles`] has them. Needs a [`Elastic::rebase`] before the device
    /// can be asked.
    ///
    /// # Errors
    /// The device fails.
    pub fn press(&mut self, device: &Device, factor: f64, about: &[f64]) -> Result<(), Error> {
        self.judge.press(factor, about);
        let weights: Vec<[f32; 9]> = self.judge.weights.iter().map(|w| w.map(|w| w as f32)).collect();
        let rest: Vec<[f32; 4]> = self.judge.hinge_rest.iter().map(bending::pack_rest).collect();
        device.write(&self.buffers.element_weights, &weights)?;
        device.write(&self.buffers.hinge_rest, &rest)?;
        self.reference_energy = None;
        Ok(())
    }

    /// Angles of all hinges [rad] at vertex positions [m].
    ///
    /// # Panics
    /// If `points` has another length than the cloth has vertices.
    pub fn angles(&self, points: &[Vec3]) -> Vec<f64> {
        let angle = |hinge: &Hinge| {
            let [edge, a, b] = hinge.edges(points);
            hinge::angle(&edge, &a, &b)
        };
        self.judge.hinges.iter().map(angle).collect()
    }

    /// The energy [J] where the nodes are displaced by `u` [m], shape `[nodes * 3]`.
    ///
    /// It is the reference's energy in `f64` plus the sum in `f64` of every element's change.
    ///
    /// # Errors
    /// There is no reference, `u` has the wrong length, or the device fails.
    pub fn energy(&self, device: &Device, u: &Buffer<f32>) -> Result<f64, Error> {
        let reference = self.ready(u)?;
        let b = &self.buffers;
        let count = Count { triangles: b.triangle_nodes.len() as u32, ..Count::new(b.energies.len()) };
        device.run(
            &membrane::STRETCH_ENERGY,
            b.energies.len(),
            &count,
            &[&b.triangle_nodes, &b.triangle_rest, &b.triangle_reference, u, &b.energies],
        )?;
        device.run(
            &bending::HINGE_ANGLE,
            b.bends.len(),
            &Count::new(b.bends.len()),
            &[&b.hinge_nodes, &b.hinge_rest, &b.hinge_reference, u, &b.bends],
        )?;
        device.run(
            &bending::BEND_ENERGY,
            b.energies.len(),
            &count,
            &[&b.element_hinges, &b.element_weights, &b.bends, &b.element_reference, &b.energies],
        )?;
        Ok(reference + device.read(&b.energies)?.iter().map(|&e| f64::from(e)).sum::<f64>())
    }

    /// Computes gradient and Hessian where the nodes are displaced by `u` [m].
    ///
    /// The gradient is exact; the Hessian is positive semi-definite (stretch projected,
    /// bending Gauss-Newton).
    ///
    /// # Errors
    /// As [`Elastic::energy`].
    pub fn linearise(&mut self, device: &Device, u: &Buffer<f32>) -> Result<(), Error> {
        self.assemble_hessian(device, u)?;
        let b = &self.buffers;
        let nodes = self.hessian.rows;
        let run = |kernel, buffers: &[&dyn crate::device::AnyBuffer]| {
            device.run(kernel, nodes, &Count::new(nodes), buffers)
        };
        let [start, items] = &b.stretch_nodes;
        run(&gather::STRETCH_GRADIENT, &[start, items, &b.triangle_rest, &b.stretch, &self.gradient])?;
        let [start, items] = &b.bend_nodes;
        run(&gather::BEND_GRADIENT, &[start, items, &b.bend, &self.gradient])?;
        Ok(())
    }

    /// As [`Elastic::linearise`], the Hessian alone.
    ///
    /// # Errors
    /// As [`Elastic::energy`].
    pub fn assemble_hessian(&mut self, device: &Device, u: &Buffer<f32>) -> Result<(), Error> {
        self.ready(u)?;
        let b = &self.buffers;
        let run = |kernel, n: usize, buffers: &[&dyn crate::device::AnyBuffer]| {
            device.run(kernel, n, &Count::new(n), buffers)
        };
        let (triangles, hinges, elements) =
            (b.triangle_nodes.len(), b.hinge_nodes.len(), b.element_hinges.len());
        run(
            &membrane::STRETCH_LINEARISE,
            triangles,
            &[&b.triangle_nodes, &b.triangle_rest, &b.triangle_reference, u, &b.stretch],
        )?;
        run(
            &bending::HINGE_LINEARISE,
            hinges,
            &[&b.hinge_nodes, &b.hinge_rest, &b.hinge_reference, u, &b.bends, &b.bend_gradients],
        )?;
        run(
            &bending::BEND_LINEARISE,
            elements,
            &[&b.element_hinges, &b.element_weights, &b.bends, &b.bend_gradients, &b.bend],
        )?;
        let [start, items] = &b.stretch_blocks;
        run(&gather::STRETCH_BLOCKS, b.upper.len(), &[start, items, &b.triangle_rest, &b.stretch, &b.upper])?;
        let [start, items] = &b.bend_blocks;
        run(&gather::BEND_BLOCKS, b.upper.len(), &[start, items, &b.bend, &b.upper])?;
        let blocks = &self.hessian.blocks;
        run(&gather::MIRROR, blocks.len(), &[&b.block_source, &b.upper, blocks])?;
        Ok(())
    }

    /// The gradient dE/du [N] of the last [`Elastic::linearise`], shape `[nodes * 3]`.
    pub fn gradient(&self) -> &Buffer<f32> {
        &self.gradient
    }

    /// The Hessian [N/m] of the last [`Elastic::linearise`], block rows by node.
    pub fn hessian(&self) -> &Bsr {
        &self.hessian
    }

    /// Index of each row's diagonal block among [`Bsr::blocks`], shape `[nodes]`.
    pub fn diagonal_slots(&self) -> &[u32] {
        &self.diagonal
    }

    /// Energy [J] and its gradient by node [N] at vertex positions [m], in `f64`.
    ///
    /// # Panics
    /// If `points` has another length than the cloth has vertices.
    pub fn judge(&self, points: &[Vec3]) -> (f64, Vec<Vec3>) {
        self.judge.judge(points)
    }

    /// Strains and energy at vertex positions [m], in `f64`.
    ///
    /// # Panics
    /// If `points` has another length than the cloth has vertices.
    pub fn measure(&self, points: &[Vec3]) -> Measured {
        self.judge.measure(points)
    }

    /// The energy's gradient by node [N] where it was measured, in `f64`.
    pub fn gradient_at(&self, measured: &Measured) -> Vec<Vec3> {
        self.judge.gradient(measured)
    }

    /// The energy's gradient by vertex [N] at vertex positions [m], in `f64`.
    ///
    /// # Panics
    /// If `points` has another length than the cloth has vertices.
    pub fn judge_by_vertex(&self, points: &[Vec3]) -> Vec<Vec3> {
        self.judge.by_vertex(points)
    }

    /// The reference's energy, if `u` fits.
    fn ready(&self, u: &Buffer<f32>) -> Result<f64, Error> {
        if u.len() != self.gradient.len() {
            let (found, expected) = (u.len(), self.gradient.len());
            return Err(Error::Length { what: "the displacement", found, expected });
        }
        self.reference_energy.ok_or(Error::NoReference)
    }
}

/// Weights row by row.
fn flat(weights: &[[f64; 3]; 3]) -> [f64; 9] {
    std::array::from_fn(|i| weights[i / 3][i % 3])
}
