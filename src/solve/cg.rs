//! Preconditioned conjugate gradients [Hestenes and Stiefel 1952; Saad 2003, alg. 9.1].
//!
//! The scalars stay on the device; the host reads them every few iterations. The
//! tolerance is on the preconditioned residual norm `sqrt(r . M^-1 r)`, relative to the
//! right-hand side's.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::vector::{Count, Dot};
use crate::device::{Access, Buffer, Device, DeviceError, HostArgs, INDEX_WGSL, Kernel};

/// Iterations between two looks at the residual, if not told otherwise.
const CHECK: usize = 8;
/// Elements that an update kernel's CPU twin gives one task.
const GRAIN: usize = 1 << 15;

/// A linear map on vectors of one length.
pub trait Operator {
    /// `y = A x`.
    ///
    /// # Errors
    /// A device's failure.
    fn apply(&self, device: &Device, x: &Buffer<f32>, y: &Buffer<f32>) -> Result<(), DeviceError>;
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CgParams {
    /// Relative preconditioned residual to reach.
    pub tolerance: f64,
    /// Most iterations.
    pub max_iterations: usize,
}

/// What a solve achieved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CgInfo {
    /// Iterations run.
    pub iterations: usize,
    /// Relative preconditioned residual at the end, by CG's recurrence.
    pub residual: f64,
    /// Whether the tolerance was reached.
    pub converged: bool,
}

/// The account of a solve whose right-hand side is zero.
const NOTHING_TO_DO: CgInfo = CgInfo { iterations: 0, residual: 0.0, converged: true };

/// `struct Scalars` in cg.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Scalars {
    rz: f32,
    alpha: f32,
    beta: f32,
    curvature: f32,
}

static CG_ALPHA: Kernel = Kernel {
    name: "cg_alpha",
    wgsl: &[INDEX_WGSL, include_str!("cg_scalars.wgsl"), include_str!("cg_alpha.wgsl")],
    access: &[Access::Read, Access::Write],
    host: |args| {
        let curvature = sum(args.read::<f32>(0));
        let s = &mut args.write::<Scalars>(1)[0];
        s.curvature = curvature;
        s.alpha = if curvature > 0.0 { s.rz / curvature } else { 0.0 };
    },
};

static CG_BETA: Kernel = Kernel {
    name: "cg_beta",
    wgsl: &[INDEX_WGSL, include_str!("cg_scalars.wgsl"), include_str!("cg_beta.wgsl")],
    access: &[Access::Read, Access::Write],
    host: |args| {
        let rz = sum(args.read::<f32>(0));
        let s = &mut args.write::<Scalars>(1)[0];
        s.beta = if s.rz > 0.0 { rz / s.rz } else { 0.0 };
        s.rz = rz;
    },
};

static CG_ADVANCE: Kernel = Kernel {
    name: "cg_advance",
    wgsl: &[INDEX_WGSL, include_str!("cg_advance.wgsl")],
    access: &[Access::Read, Access::Read, Access::Read, Access::Write, Access::Write],
    host: |args| {
        let alpha = args.read::<Scalars>(0)[0].alpha;
        let (p, q) = (args.read::<f32>(1), args.read::<f32>(2));
        let (x, r) = (args.write::<f32>(3), args.write::<f32>(4));
        let chunks = x.par_chunks_mut(GRAIN).zip(r.par_chunks_mut(GRAIN));
        chunks.zip(p.par_chunks(GRAIN).zip(q.par_chunks(GRAIN))).for_each(|((x, r), (p, q))| {
            for i in 0..x.len() {
                x[i] += alpha * p[i];
                r[i] -= alpha * q[i];
            }
        });
    },
};

static CG_DIRECTION: Kernel = Kernel {
    name: "cg_direction",
    wgsl: &[INDEX_WGSL, include_str!("cg_direction.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: |args| {
        let beta = args.read::<Scalars>(0)[0].beta;
        let z = args.read::<f32>(1);
        let p = args.write::<f32>(2);
        p.par_chunks_mut(GRAIN).zip(z.par_chunks(GRAIN)).for_each(|(p, z)| {
            for i in 0..p.len() {
                p[i] = z[i] + beta * p[i];
            }
        });
    },
};

static RESIDUAL: Kernel = Kernel {
    name: "residual",
    wgsl: &[INDEX_WGSL, include_str!("residual.wgsl")],
    access: &[Access::Read, Access::Read, Access::Write],
    host: |args: &mut HostArgs<'_>| {
        let (b, q) = (args.read::<f32>(0), args.read::<f32>(1));
        let r = args.write::<f32>(2);
        for i in 0..r.len() {
            r[i] = b[i] - q[i];
        }
    },
};

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&CG_ALPHA, &CG_BETA, &CG_ADVANCE, &CG_DIRECTION, &RESIDUAL];

/// Sums in the order of the WGSL twin: four running sums, then those.
fn sum(partials: &[f32]) -> f32 {
    let mut sums = [0.0f32; 4];
    for quad in partials.chunks(4) {
        for (s, p) in sums.iter_mut().zip(quad) {
            *s += p;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Conjugate gradients with the work vectors for systems of one size.
#[derive(Debug)]
pub struct Cg {
    dot: Dot,
    scalars: Buffer<Scalars>,
    r: Buffer<f32>,
    z: Buffer<f32>,
    p: Buffer<f32>,
    q: Buffer<f32>,
    check: usize,
}

impl Cg {
    /// Work vectors for `n` unknowns.
    ///
    /// # Errors
    /// As [`Device::zeros`].
    pub fn new(device: &Device, n: usize) -> Result<Cg, DeviceError> {
        Ok(Cg {
            dot: Dot::new(device, n)?,
            scalars: device.zeros("cg scalars", 1)?,
            r: device.zeros("cg residual", n)?,
            z: device.zeros("cg preconditioned residual", n)?,
            p: device.zeros("cg direction", n)?,
            q: device.zeros("cg image", n)?,
            check: CHECK,
        })
    }

    /// Looks at the residual after every `turns` iterations: each, where they are dear.
    #[must_use]
    pub fn looking_every(self, turns: usize) -> Cg {
        Cg { check: turns.max(1), ..self }
    }

    /// Solves `A x = b` from the `x` given, with `M^-1` as preconditioner.
    ///
    /// A solve that does not reach its tolerance is no error: `CgInfo` says it.
    ///
    /// # Errors
    /// A device's failure.
    pub fn solve(
        &self,
        device: &Device,
        a: &dyn Operator,
        m_inverse: &dyn Operator,
        b: &Buffer<f32>,
        x: &Buffer<f32>,
        params: &CgParams,
    ) -> Result<CgInfo, DeviceError> {
        let scale = self.precondition(device, m_inverse, b)?;
        if scale == 0.0 {
            device.write(x, &vec![0.0; b.len()])?;
            return Ok(NOTHING_TO_DO);
        }
        a.apply(device, x, &self.q)?;
        device.run(&RESIDUAL, b.len(), &self.dot.count, &[b, &self.q, &self.r])?;
        m_inverse.apply(device, &self.r, &self.z)?;
        self.iterate(device, a, m_inverse, x, scale, params)
    }

    /// Solves `A x = b` from zero. Besides the account the norm `sqrt(b . M^-1 b)`, which the
    /// tolerance is relative to. What the last iteration permitted leaves is not looked at:
    /// that would cost one more application of the preconditioner.
    ///
    /// # Errors
    /// A device's failure.
    pub fn solve_from_zero(
        &self,
        device: &Device,
        a: &dyn Operator,
        m_inverse: &dyn Operator,
        b: &Buffer<f32>,
        x: &Buffer<f32>,
        params: &CgParams,
    ) -> Result<(CgInfo, f64), DeviceError> {
        device.write(x, &vec![0.0; b.len()])?;
        let scale = self.precondition(device, m_inverse, b)?;
        if scale == 0.0 {
            return Ok((NOTHING_TO_DO, 0.0));
        }
        device.copy(b, &self.r)?;
        let unseen = CgParams { max_iterations: params.max_iterations.saturating_sub(1), ..*params };
        let mut info = self.iterate(device, a, m_inverse, x, scale, &unseen)?;
        if !info.converged && info.iterations < params.max_iterations && info.residual.is_finite() {
            self.advance(device, a, x)?;
            info.iterations += 1;
        }
        Ok((info, scale))
    }

    /// Leaves `M^-1 b` in `z`; the norm `sqrt(b . M^-1 b)` is the scale of the tolerance.
    fn precondition(
        &self,
        device: &Device,
        m_inverse: &dyn Operator,
        b: &Buffer<f32>,
    ) -> Result<f64, DeviceError> {
        m_inverse.apply(device, b, &self.z)?;
        Ok(self.dot.dot(device, b, &self.z)?.max(0.0).sqrt())
    }

    /// Iterates from the residual in `r` and its preconditioned image in `z`.
    fn iterate(
        &self,
        device: &Device,
        a: &dyn Operator,
        m_inverse: &dyn Operator,
        x: &Buffer<f32>,
        scale: f64,
        params: &CgParams,
    ) -> Result<CgInfo, DeviceError> {
        let (n, count) = (x.len(), self.dot.count);
        device.copy(&self.z, &self.p)?;
        let rz = self.dot.dot(device, &self.r, &self.z)?;
        device.write(&self.scalars, &[Scalars { rz: rz as f32, ..Scalars::default() }])?;
        let mut info = CgInfo { iterations: 0, residual: rz.max(0.0).sqrt() / scale, converged: false };
        loop {
            info.converged = info.residual <= params.tolerance;
            if info.converged || info.iterations >= params.max_iterations || !info.residual.is_finite() {
                return Ok(info);
            }
            let turns = self.check.min(params.max_iterations - info.iterations);
            for _ in 0..turns {
                self.advance(device, a, x)?;
                m_inverse.apply(device, &self.r, &self.z)?;
                self.dot.run(device, &self.r, &self.z)?;
                let partials = &self.dot.partials;
                device.run(&CG_BETA, 1, &Count::new(partials.len()), &[partials, &self.scalars])?;
                device.run(&CG_DIRECTION, n, &count, &[&self.scalars, &self.z, &self.p])?;
            }
            info.iterations += turns;
            let s = device.read(&self.scalars)?[0];
            info.residual = f64::from(s.rz).max(0.0).sqrt() / scale;
            if s.curvature <= 0.0 && info.residual > params.tolerance {
                return Ok(info); // not positive definite: x stands where curvature was lost
            }
        }
    }

    /// Moves `x` along the direction to where the error is smallest in `A`'s norm.
    fn advance(&self, device: &Device, a: &dyn Operator, x: &Buffer<f32>) -> Result<(), DeviceError> {
        a.apply(device, &self.p, &self.q)?;
        self.dot.run(device, &self.p, &self.q)?;
        let partials = &self.dot.partials;
        device.run(&CG_ALPHA, 1, &Count::new(partials.len()), &[partials, &self.scalars])?;
        device.run(&CG_ADVANCE, x.len(), &self.dot.count, &[&self.scalars, &self.p, &self.q, x, &self.r])
    }
}
