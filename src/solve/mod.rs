//! Linear algebra that several stages share, on the device.
//!
//! Vectors are `f32` buffers. Dot products follow a fixed two-level tree, and the scalars of
//! the conjugate gradient method stay on the device between checks.
//! [`cholesky`], [`block_cholesky`], [`host_cg`] and [`two_level`] are the exception: they stay on the host, in `f64`.

pub mod block_cholesky;
pub mod bsr;
pub mod cg;
pub mod cholesky;
pub mod dense;
pub mod host_cg;
pub mod two_level;
pub mod vector;
