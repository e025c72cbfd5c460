//! The CPU device: buffers in host memory, kernels as Rust functions.

use std::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError};

use bytemuck::Pod;

use super::{Access, Binding, DeviceError, Kernel, Storage};

/// Bytes with the alignment of the largest element type.
#[derive(Debug)]
pub(super) struct HostBuffer {
    words: RwLock<Vec<u128>>,
    bytes: usize,
}

impl HostBuffer {
    pub fn new(data: &[u8]) -> Self {
        let mut words = vec![0u128; data.len().div_ceil(size_of::<u128>())];
        bytemuck::cast_slice_mut::<_, u8>(&mut words)[..data.len()].copy_from_slice(data);
        HostBuffer { words: RwLock::new(words), bytes: data.len() }
    }

    pub fn zeros(bytes: usize) -> Self {
        HostBuffer { words: RwLock::new(vec![0u128; bytes.div_ceil(size_of::<u128>())]), bytes }
    }

    pub fn write(&self, data: &[u8]) {
        let mut words = self.words.write().unwrap_or_else(|e| e.into_inner());
        bytemuck::cast_slice_mut::<_, u8>(&mut words)[..data.len()].copy_from_slice(data);
    }

    pub fn read<T: Pod>(&self) -> Vec<T> {
        let words = self.words.read().unwrap_or_else(|e| e.into_inner());
        bytemuck::cast_slice(&bytemuck::cast_slice::<_, u8>(&words)[..self.bytes]).to_vec()
    }

    pub fn copy_from(&self, from: &HostBuffer) {
        let from = from.words.read().unwrap_or_else(|e| e.into_inner()).clone();
        self.words.write().unwrap_or_else(|e| e.into_inner()).copy_from_slice(&from);
    }
}

enum Guard<'a> {
    Read(RwLockReadGuard<'a, Vec<u128>>, usize),
    Write(RwLockWriteGuard<'a, Vec<u128>>, usize),
}

enum Slot<'a> {
    Read(&'a [u8]),
    Write(Option<&'a mut [u8]>),
}

/// What a CPU twin is given.
pub struct HostArgs<'a> {
    /// Number of invocations to compute.
    pub invocations: usize,
    params: &'a [u8],
    slots: Vec<Slot<'a>>,
}

impl<'a> HostArgs<'a> {
    /// The parameter block.
    pub fn params<P: Pod>(&self) -> P {
        bytemuck::pod_read_unaligned(self.params)
    }

    /// The elements of storage buffer `slot` (0 is the first, WGSL binding 1), to be read.
    ///
    /// # Panics
    /// If the kernel declares that buffer as written.
    pub fn read<T: Pod>(&self, slot: usize) -> &'a [T] {
        match &self.slots[slot] {
            Slot::Read(bytes) => bytemuck::cast_slice(bytes),
            Slot::Write(_) => panic!("buffer {slot} is declared as written"),
        }
    }

    /// The elements of storage buffer `slot`, to be written; can be taken once.
    ///
    /// # Panics
    /// If the kernel declares that buffer as read, or it was taken before.
    pub fn write<T: Pod>(&mut self, slot: usize) -> &'a mut [T] {
        match &mut self.slots[slot] {
            Slot::Read(_) => panic!("buffer {slot} is declared as read"),
            Slot::Write(bytes) => bytemuck::cast_slice_mut(bytes.take().expect("taken once")),
        }
    }
}

/// Runs a kernel's CPU twin.
pub(super) fn run(
    kernel: &'static Kernel,
    invocations: usize,
    params: &[u8],
    bindings: &[Binding<'_>],
) -> Result<(), DeviceError> {
    let mut guards = Vec::with_capacity(bindings.len());
    for (binding, access) in bindings.iter().zip(kernel.access) {
        let Storage::Host(buffer) = binding.storage else {
            return Err(DeviceError::Foreign { label: binding.label });
        };
        let aliased = || DeviceError::Aliased { kernel: kernel.name, label: binding.label };
        guards.push(match access {
            Access::Read => match buffer.words.try_read() {
                Ok(guard) => Guard::Read(guard, buffer.bytes),
                Err(TryLockError::Poisoned(e)) => Guard::Read(e.into_inner(), buffer.bytes),
                Err(TryLockError::WouldBlock) => return Err(aliased()),
            },
            Access::Write => match buffer.words.try_write() {
                Ok(guard) => Guard::Write(guard, buffer.bytes),
                Err(TryLockError::Poisoned(e)) => Guard::Write(e.into_inner(), buffer.bytes),
                Err(TryLockError::WouldBlock) => return Err(aliased()),
            },
        });
    }
    let slots = guards
        .iter_mut()
        .map(|guard| match guard {
            Guard::Read(words, bytes) => Slot::Read(&bytemuck::cast_slice(words)[..*bytes]),
            Guard::Write(words, bytes) => Slot::Write(Some(&mut bytemuck::cast_slice_mut(words)[..*bytes])),
        })
        .collect();
    (kernel.host)(&mut HostArgs { invocations, params, slots });
    Ok(())
}
