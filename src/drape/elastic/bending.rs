//! Kernels of bending: angles of hinges, then elements made of hinges. Formulas:
//! [`super::hinge`], [`super::element`].

use nalgebra::Vector3;
use rayon::prelude::*;

use super::hinge::{self, HingeRest};
use super::{GRAIN, element, vector};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};

/// Floats of an element's derivatives: its three amounts, then for each of six nodes the
/// gradients of the three amounts.
pub const DERIVATIVES: usize = 57;

/// The bends of hinges.
pub static HINGE_ANGLE: Kernel = Kernel {
    name: "hinge_angle",
    wgsl: &[INDEX_WGSL, include_str!("hinge.wgsl"), include_str!("hinge_angle.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: hinge_angle,
};

/// The bends of hinges and the gradients of their angles.
pub static HINGE_LINEARISE: Kernel = Kernel {
    name: "hinge_linearise",
    wgsl: &[INDEX_WGSL, include_str!("hinge.wgsl"), include_str!("hinge_linearise.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write, Access::Write],
    host: hinge_linearise,
};

/// Energies less those of the reference, added to what is there.
pub static BEND_ENERGY: Kernel = Kernel {
    name: "bend_energy",
    wgsl: &[INDEX_WGSL, include_str!("bend_energy.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: bend_energy,
};

/// The amounts of elements and their gradients.
pub static BEND_LINEARISE: Kernel = Kernel {
    name: "bend_linearise",
    wgsl: &[INDEX_WGSL, include_str!("bend_linearise.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: bend_linearise,
};

/// Constants of a hinge as the kernels read them.
pub fn pack_rest(rest: &HingeRest<f64>) -> [f32; 4] {
    [rest.angle, rest.floor_edge, rest.floor_normal[0], rest.floor_normal[1]].map(|x| x as f32)
}

/// The rest constants of hinge `h` and its edge vectors, displaced by `u`.
fn hinge_at(args: &HostArgs<'_>, h: usize) -> (HingeRest<f32>, [Vector3<f32>; 3]) {
    let [angle, floor_edge, floor_a, floor_b] = args.read::<[f32; 4]>(1)[h];
    let rest = HingeRest { angle, floor_edge, floor_normal: [floor_a, floor_b] };
    let r = &args.read::<[f32; 9]>(2)[h];
    let u = args.read::<[f32; 3]>(3);
    let [u0, u1, u2, u3] = args.read::<[u32; 4]>(0)[h].map(|node| vector(&u[node as usize]));
    let edge = |at: usize, to: Vector3<f32>| Vector3::new(r[at], r[at + 1], r[at + 2]) + (to - u0);
    (rest, [edge(0, u1), edge(3, u2), edge(6, u3)])
}

fn hinge_angle(args: &mut HostArgs<'_>) {
    let bends = args.write::<f32>(4);
    let args = &*args;
    bends.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(h, bend)| {
        let (rest, [e, a, b]) = hinge_at(args, h);
        *bend = hinge::bend(rest.angle, hinge::angle(&e, &a, &b));
    });
}

fn hinge_linearise(args: &mut HostArgs<'_>) {
    let (bends, gradients) = (args.write::<f32>(4), args.write::<[f32; 12]>(5));
    let args = &*args;
    let hinges = bends.par_iter_mut().zip(gradients.par_iter_mut());
    hinges.with_min_len(GRAIN).enumerate().for_each(|(h, (bend, out))| {
        let (rest, [e, a, b]) = hinge_at(args, h);
        *bend = hinge::bend(rest.angle, hinge::angle(&e, &a, &b));
        for (out, g) in out.chunks_exact_mut(3).zip(hinge::gradient(&rest, &e, &a, &b)) {
            out.copy_from_slice(g.as_slice());
        }
    });
}

fn bend_energy(args: &mut HostArgs<'_>) {
    let (hinges, weights) = (args.read::<[u32; 3]>(0), args.read::<[f32; 9]>(1));
    let (bends, reference) = (args.read::<f32>(2), args.read::<[f32; 3]>(3));
    let energies = args.write::<f32>(4);
    energies.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(e, energy)| {
        let amounts = element::amounts(&hinges[e], &weights[e], |h| bends[h]);
        let mut sum = 0.0;
        for (c, r) in amounts.iter().zip(&reference[e]) {
            sum += (c - r) * (c + r);
        }
        *energy += 0.5 * sum;
    });
}

fn bend_linearise(args: &mut HostArgs<'_>) {
    let (hinges, weights) = (args.read::<[u32; 3]>(0), args.read::<[f32; 9]>(1));
    let (bends, gradients) = (args.read::<f32>(2), args.read::<[f32; 12]>(3));
    let derivatives = args.write::<f32>(4);
    derivatives.par_chunks_exact_mut(DERIVATIVES).with_min_len(GRAIN).enumerate().for_each(|(e, out)| {
        out[..3].copy_from_slice(&element::amounts(&hinges[e], &weights[e], |h| bends[h]));
        let rows = element::amount_gradients(&hinges[e], &weights[e], |h| {
            let g = &gradients[h];
            [0, 3, 6, 9].map(|k| Vector3::new(g[k], g[k + 1], g[k + 2]))
        });
        for (out, row) in out[3..].chunks_exact_mut(3).zip(rows.iter().flatten()) {
            out.copy_from_slice(row.as_slice());
        }
    });
}
