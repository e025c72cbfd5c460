//! The smoother: block Gauss-Seidel in eight colours.
//!
//! Nodes whose coordinates agree in their parities do not meet in any cell, so those of one
//! colour are relaxed at once and the result does not depend on their order.

use rayon::prelude::*;

use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};
use crate::transfer::domain::Domain;
use crate::transfer::stencil::{ROW_WGSL, Rows, Stencil};

/// Colours.
const COLOURS: usize = 8;
/// Nodes that a CPU task takes.
const GRAIN: usize = 256;

/// `struct Colour` in relax.wgsl and start.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Colour {
    n: u32,
    first: u32,
    pad: [u32; 2],
}

pub static RELAX: Kernel = Kernel {
    name: "transfer_relax",
    wgsl: &[INDEX_WGSL, include_str!("relax.wgsl"), ROW_WGSL],
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
    host: relax,
};

fn relax(args: &mut HostArgs<'_>) {
    let colour: Colour = args.params();
    let matrix = Rows::of(args);
    let nodes = &args.read::<u32>(4)[colour.first as usize..][..colour.n as usize];
    let (inverse, b) = (args.read::<[f32; 9]>(5), args.read::<[f32; 3]>(6));
    let x = args.write::<[f32; 3]>(7);
    let relaxed = |&i: &u32| {
        let i = i as usize;
        let image = matrix.multiply(i, x);
        let r: [f32; 3] = std::array::from_fn(|k| b[i][k] - image[k]);
        let step = multiply(&inverse[i], r);
        std::array::from_fn(|k| x[i][k] + step[k])
    };
    let values: Vec<[f32; 3]> = nodes.par_iter().with_min_len(GRAIN).map(relaxed).collect();
    for (&i, value) in nodes.iter().zip(values) {
        x[i as usize] = value;
    }
}

fn multiply(m: &[f32; 9], v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| m[3 * k] * v[0] + m[3 * k + 1] * v[1] + m[3 * k + 2] * v[2])
}

pub static START: Kernel = Kernel {
    name: "transfer_start",
    wgsl: &[INDEX_WGSL, include_str!("start.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: |args| {
        let colour: Colour = args.params();
        let (order, inverse) = (args.read::<u32>(0), args.read::<[f32; 9]>(1));
        let (b, x) = (args.read::<[f32; 3]>(2), args.write::<[f32; 3]>(3));
        x.fill([0.0; 3]);
        for &i in &order[..colour.first as usize] {
            x[i as usize] = multiply(&inverse[i as usize], b[i as usize]);
        }
    },
};

/// What a sweep relaxes: `matrix x = b`.
#[derive(Clone, Copy)]
pub struct System<'a> {
    pub matrix: &'a Stencil,
    pub b: &'a Buffer<f32>,
    pub x: &'a Buffer<f32>,
}

/// The nodes of a grid by colour.
#[derive(Debug)]
pub struct Smoother {
    order: Buffer<u32>,
    /// First place of each colour in the order, and its end.
    starts: [usize; COLOURS + 1],
}

impl Smoother {
    /// Sorts the nodes of `domain`.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(device: &Device, domain: &Domain) -> Result<Smoother, DeviceError> {
        let mut by_colour = vec![Vec::new(); COLOURS];
        for (i, node) in domain.nodes.iter().enumerate() {
            let colour = node.iter().fold(0, |o, c| 2 * o + c.rem_euclid(2) as usize);
            by_colour[colour].push(i as u32);
        }
        let mut starts = [0; COLOURS + 1];
        for (colour, nodes) in by_colour.iter().enumerate() {
            starts[colour + 1] = starts[colour] + nodes.len();
        }
        Ok(Smoother { order: device.upload("transfer colours", &by_colour.concat())?, starts })
    }

    /// A sweep from zero, first colour first.
    ///
    /// # Errors
    /// A device's failure.
    pub fn start(&self, device: &Device, system: System<'_>) -> Result<(), DeviceError> {
        let System { matrix, b, x } = system;
        let colour = Colour { n: matrix.nodes as u32, first: self.starts[1] as u32, pad: [0; 2] };
        device.run(&START, matrix.nodes, &colour, &[&self.order, &matrix.diagonal_inverse, b, x])?;
        (1..COLOURS).try_for_each(|colour| self.relax(device, system, colour))
    }

    /// A sweep from what `x` holds, last colour first: with [`Smoother::start`] before, the
    /// two are each other's adjoint and the cycle is symmetric.
    ///
    /// # Errors
    /// A device's failure.
    pub fn finish(&self, device: &Device, system: System<'_>) -> Result<(), DeviceError> {
        (0..COLOURS).rev().try_for_each(|colour| self.relax(device, system, colour))
    }

    fn relax(&self, device: &Device, system: System<'_>, colour: usize) -> Result<(), DeviceError> {
        let System { matrix, b, x } = system;
        let (first, n) = (self.starts[colour], self.starts[colour + 1] - self.starts[colour]);
        let params = Colour { n: n as u32, first: first as u32, pad: [0; 2] };
        let buffers: [&dyn crate::device::AnyBuffer; 8] = [
            &matrix.neighbours,
            &matrix.rows,
            &matrix.patterns,
            &matrix.mass,
            &self.order,
            &matrix.diagonal_inverse,
            b,
            x,
        ];
        device.run(&RELAX, n, &params, &buffers)
    }
}
