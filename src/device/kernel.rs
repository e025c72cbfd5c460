//! A kernel: two twins with one name.

use super::HostArgs;

/// Invocations in a workgroup, on every kernel.
pub const WORKGROUP: u32 = 64;

/// How a kernel uses a storage buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// `var<storage, read>`
    Read,
    /// `var<storage, read_write>`
    Write,
}

/// A WGSL shader and the Rust function that computes the same.
#[derive(Debug)]
pub struct Kernel {
    /// Name, unique in the crate.
    pub name: &'static str,
    /// WGSL source pieces, concatenated: shared structs and functions first, the entry last.
    pub wgsl: &'static [&'static str],
    /// Storage buffers in binding order (bindings 1..).
    pub access: &'static [Access],
    /// The CPU twin.
    pub host: fn(&mut HostArgs<'_>),
}

impl Kernel {
    /// The shader's whole source.
    pub fn source(&self) -> String {
        self.wgsl.concat()
    }
}
