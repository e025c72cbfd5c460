//! Vectors between a grid and the next coarser one.

use rayon::prelude::*;

use crate::device::{Access, HostArgs, INDEX_WGSL, Kernel};
use crate::transfer::domain::NONE;

/// Nodes that a CPU task takes.
const GRAIN: usize = 512;

pub static RESTRICT: Kernel = Kernel {
    name: "transfer_restrict",
    wgsl: &[INDEX_WGSL, include_str!("restrict.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write],
    host: restrict,
};

fn restrict(args: &mut HostArgs<'_>) {
    let (children, b) = (args.read::<[u32; 27]>(0), args.read::<[f32; 3]>(1));
    let image = args.read::<[f32; 3]>(2);
    let coarse = args.write::<[f32; 3]>(3);
    let along = |offset: usize| if offset == 1 { 1.0 } else { 0.5 };
    coarse.par_iter_mut().with_min_len(GRAIN).zip(children).for_each(|(coarse, children)| {
        let mut sum = [0.0f32; 3];
        for (k, &child) in children.iter().enumerate().filter(|(_, child)| **child != NONE) {
            let weight = along(k / 9) * along(k / 3 % 3) * along(k % 3);
            let (b, image) = (b[child as usize], image[child as usize]);
            for c in 0..3 {
                sum[c] += weight * (b[c] - image[c]);
            }
        }
        *coarse = sum;
    });
}

pub static PROLONG: Kernel = Kernel {
    name: "transfer_prolong",
    wgsl: &[INDEX_WGSL, include_str!("prolong.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: prolong,
};

fn prolong(args: &mut HostArgs<'_>) {
    let (parents, coarse) = (args.read::<[u32; 8]>(0), args.read::<[f32; 3]>(1));
    let x = args.write::<[f32; 3]>(2);
    x.par_iter_mut().with_min_len(GRAIN).zip(parents).for_each(|(x, parents)| {
        if parents[0] == NONE {
            return;
        }
        for c in 0..3 {
            let mut sum = 0.0;
            for &parent in parents {
                sum += coarse[parent as usize][c];
            }
            x[c] += 0.125 * sum;
        }
    });
}
