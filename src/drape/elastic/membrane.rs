//! Kernels of stretch and shear, over triangles. Formulas: [`super::stretch`].

use nalgebra::Vector3;
use rayon::prelude::*;

use super::stretch::{self, Stretch, StretchReference, StretchRest};
use super::{Count, GRAIN, vector};
use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};

/// Floats of a triangle's derivatives: `dE/dF` (6), `ww` (xx xy xz yy yz zz), `ff` (the
/// same), `wf` (row-major).
pub const DERIVATIVES: usize = 27;

/// Energies less those of the reference. Elements past the triangles get 0.
pub static STRETCH_ENERGY: Kernel = Kernel {
    name: "stretch_energy",
    wgsl: &[INDEX_WGSL, include_str!("stretch.wgsl"), include_str!("stretch_energy.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stretch_energy,
};

/// First and second derivatives in `F`.
pub static STRETCH_LINEARISE: Kernel = Kernel {
    name: "stretch_linearise",
    wgsl: &[INDEX_WGSL, include_str!("stretch.wgsl"), include_str!("stretch_linearise.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Read, Access::Write],
    host: stretch_linearise,
};

/// Constants of a triangle as the kernels read them.
pub fn pack_rest(rest: &StretchRest<f64>) -> [f32; 8] {
    let [[a, b], [c, d]] = rest.shape;
    let [warp, weft, shear] = rest.stiffness;
    [a, b, c, d, warp, weft, shear, 0.0].map(|x| x as f32)
}

/// A triangle's reference as the kernels read it.
pub fn pack_reference(reference: &StretchReference<f64>) -> [f32; 9] {
    let ([w, f], [a, b, c]) = (reference.columns, reference.invariants);
    [w.x, w.y, w.z, f.x, f.y, f.z, a, b, c].map(|x| x as f32)
}

/// Constants of a triangle from what the kernels read.
pub fn unpack_rest(r: &[f32; 8]) -> StretchRest<f32> {
    StretchRest { shape: [[r[0], r[1]], [r[2], r[3]]], stiffness: [r[4], r[5], r[6]] }
}

/// The stretch of triangle `t` displaced by `u`.
fn stretch_at(args: &HostArgs<'_>, t: usize) -> (StretchRest<f32>, Stretch<f32>) {
    let rest = unpack_rest(&args.read::<[f32; 8]>(1)[t]);
    let r = &args.read::<[f32; 9]>(2)[t];
    let reference = StretchReference {
        columns: [Vector3::new(r[0], r[1], r[2]), Vector3::new(r[3], r[4], r[5])],
        invariants: [r[6], r[7], r[8]],
    };
    let u = args.read::<[f32; 3]>(3);
    let [u0, u1, u2] = args.read::<[u32; 3]>(0)[t].map(|node| vector(&u[node as usize]));
    let change = stretch::columns(&rest, [u1 - u0, u2 - u0]);
    (rest, stretch::stretch(&reference, change))
}

fn stretch_energy(args: &mut HostArgs<'_>) {
    let triangles = args.params::<Count>().triangles as usize;
    let energies = args.write::<f32>(4);
    let args = &*args;
    energies.par_iter_mut().with_min_len(GRAIN).enumerate().for_each(|(t, energy)| {
        *energy = 0.0;
        if t < triangles {
            let (rest, s) = stretch_at(args, t);
            *energy = stretch::energy_change(&rest, &s);
        }
    });
}

fn stretch_linearise(args: &mut HostArgs<'_>) {
    let derivatives = args.write::<f32>(4);
    let args = &*args;
    derivatives.par_chunks_exact_mut(DERIVATIVES).with_min_len(GRAIN).enumerate().for_each(|(t, out)| {
        let (rest, s) = stretch_at(args, t);
        let [pw, pf] = stretch::gradient(&rest, &s);
        let [ww, wf, ff] = stretch::hessian(&rest, &s);
        out[..3].copy_from_slice(pw.as_slice());
        out[3..6].copy_from_slice(pf.as_slice());
        for (at, m) in [(6, ww), (12, ff)] {
            let packed = [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)]];
            out[at..at + 6].copy_from_slice(&packed);
        }
        out[18..].copy_from_slice(wf.transpose().as_slice());
    });
}
