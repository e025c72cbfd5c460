//! How a kernel runs, on a GPU through wgpu or on the CPU. Nothing here knows cloth.
//!
//! A [`Kernel`] is a pair of twins with one name: a WGSL compute shader and a Rust function
//! over the same buffers. Stages are written once against the pair; [`Device::run`] picks
//! the twin.
//!
//! # Conventions that both twins keep
//! - Binding 0 of group 0 is a uniform block of parameters; bindings 1.. are the storage
//!   buffers, in the order in which [`Kernel::access`] lists them.
//! - One invocation computes one element (gather, never scatter): no two invocations write
//!   the same place, there are no float atomics, and reductions follow a fixed tree. So the
//!   same input on the same adapter gives the same bytes.
//! - The entry point is `main`, with [`WORKGROUP`] invocations in x. The invocation's index
//!   is `gid.x + gid.y * (num_workgroups.x * WORKGROUP)`, and indices at or past
//!   the number of invocations (the parameters say it) return at once.

mod adapter;
mod error;
mod gpu;
mod host;
mod kernel;
mod workers;

pub use adapter::AdapterInfo;
pub use error::DeviceError;
pub use host::HostArgs;
pub use kernel::{Access, Kernel, WORKGROUP};
pub use workers::on_worker;

/// WGSL for an invocation's index; goes first in [`Kernel::wgsl`].
pub const INDEX_WGSL: &str = include_str!("index.wgsl");

use std::marker::PhantomData;

use bytemuck::Pod;
use serde::Serialize;

/// Which device to open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceChoice {
    /// A hardware GPU where there is one, else the CPU.
    Auto,
    /// The native CPU twins.
    Cpu,
    /// Any GPU adapter, software ones included.
    Gpu,
    /// The GPU adapter whose name contains this, case-insensitively.
    Named(String),
}

impl std::str::FromStr for DeviceChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "auto" => DeviceChoice::Auto,
            "cpu" => DeviceChoice::Cpu,
            "gpu" => DeviceChoice::Gpu,
            name => DeviceChoice::Named(name.to_owned()),
        })
    }
}

/// What a device is, for logs and results.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DeviceInfo {
    /// `cpu` or `gpu`.
    pub kind: &'static str,
    /// The adapter's name.
    pub name: String,
    /// The adapter's driver and its version, for a GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// Why it is not what one might have expected: what `auto` passed over.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Where kernels run.
#[derive(Debug)]
pub struct Device {
    inner: Inner,
}

#[derive(Debug)]
enum Inner {
    Cpu { note: Option<String> },
    Gpu(Box<gpu::Gpu>),
}

/// A typed array on a device, of a length that is fixed when it is made.
#[derive(Debug)]
pub struct Buffer<T> {
    storage: Storage,
    len: usize,
    label: &'static str,
    element: PhantomData<T>,
}

#[derive(Debug)]
enum Storage {
    Host(host::HostBuffer),
    Gpu(gpu::GpuBuffer),
}

/// A [`Buffer`] of any element type, as [`Device::run`] takes it.
pub trait AnyBuffer {
    #[doc(hidden)]
    fn binding(&self) -> Binding<'_>;
}

#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct Binding<'a> {
    storage: &'a Storage,
    label: &'static str,
}

impl<T: Pod> AnyBuffer for Buffer<T> {
    fn binding(&self) -> Binding<'_> {
        Binding { storage: &self.storage, label: self.label }
    }
}

impl<T> Buffer<T> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no element.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl Device {
    /// The native CPU.
    pub fn cpu() -> Device {
        Device { inner: Inner::Cpu { note: None } }
    }

    /// Opens a device. `Auto` never fails: where no hardware GPU opens it is the CPU, and
    /// [`DeviceInfo::note`] says why.
    ///
    /// # Errors
    /// No adapter that fits the choice, or one that is refused (see [`DeviceError`]).
    pub fn open(choice: &DeviceChoice) -> Result<Device, DeviceError> {
        if *choice == DeviceChoice::Cpu {
            return Ok(Device::cpu());
        }
        Ok(match adapter::open(choice)? {
            Ok(gpu) => Device { inner: Inner::Gpu(Box::new(gpu)) },
            Err(note) => Device { inner: Inner::Cpu { note: Some(note) } },
        })
    }

    /// All GPU adapters of this machine, usable or not, best first.
    pub fn list() -> Vec<AdapterInfo> {
        adapter::list()
    }

    /// What this device is.
    pub fn info(&self) -> DeviceInfo {
        match &self.inner {
            Inner::Cpu { note } => {
                let name = format!("{} threads", rayon::current_num_threads());
                DeviceInfo { kind: "cpu", name, driver: None, note: note.clone() }
            }
            Inner::Gpu(gpu) => {
                let (name, driver) = (gpu.info.name.clone(), Some(gpu.info.driver.clone()));
                DeviceInfo { kind: "gpu", name, driver, note: None }
            }
        }
    }

    /// A buffer that holds a copy of `data`.
    ///
    /// # Errors
    /// Too large for the device, or the device is out of memory or lost.
    pub fn upload<T: Pod>(&self, label: &'static str, data: &[T]) -> Result<Buffer<T>, DeviceError> {
        let bytes = bytemuck::cast_slice(data);
        let storage = match &self.inner {
            Inner::Cpu { .. } => Storage::Host(host::HostBuffer::new(bytes)),
            Inner::Gpu(gpu) => Storage::Gpu(gpu.buffer(label, bytes.len(), Some(bytes))?),
        };
        Ok(Buffer { storage, len: data.len(), label, element: PhantomData })
    }

    /// A buffer of `len` zeros.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn zeros<T: Pod>(&self, label: &'static str, len: usize) -> Result<Buffer<T>, DeviceError> {
        let bytes = len * size_of::<T>();
        let storage = match &self.inner {
            Inner::Cpu { .. } => Storage::Host(host::HostBuffer::zeros(bytes)),
            Inner::Gpu(gpu) => Storage::Gpu(gpu.buffer(label, bytes, None)?),
        };
        Ok(Buffer { storage, len, label, element: PhantomData })
    }

    /// Overwrites the whole buffer, after the kernels that were run before.
    ///
    /// # Errors
    /// `data` has another length than the buffer, or the device is lost.
    pub fn write<T: Pod>(&self, buffer: &Buffer<T>, data: &[T]) -> Result<(), DeviceError> {
        if data.len() != buffer.len {
            return Err(DeviceError::Length { label: buffer.label, found: data.len(), expected: buffer.len });
        }
        let bytes = bytemuck::cast_slice(data);
        match (&self.inner, &buffer.storage) {
            (Inner::Cpu { .. }, Storage::Host(host)) => host.write(bytes),
            (Inner::Gpu(gpu), Storage::Gpu(buffer)) => gpu.write(&buffer.raw, bytes)?,
            _ => return Err(DeviceError::Foreign { label: buffer.label }),
        }
        Ok(())
    }

    /// A copy of the buffer's elements; waits for the kernels that write it.
    ///
    /// # Errors
    /// The device is lost.
    pub fn read<T: Pod>(&self, buffer: &Buffer<T>) -> Result<Vec<T>, DeviceError> {
        match (&self.inner, &buffer.storage) {
            (Inner::Cpu { .. }, Storage::Host(host)) => Ok(host.read()),
            (Inner::Gpu(gpu), Storage::Gpu(storage)) => {
                let mut out = vec![T::zeroed(); buffer.len];
                gpu.read(&storage.raw, &mut out)?;
                Ok(out)
            }
            _ => Err(DeviceError::Foreign { label: buffer.label }),
        }
    }

    /// Copies all of `from` to `to`, which has the same length.
    ///
    /// # Errors
    /// The lengths differ, or the device is lost.
    pub fn copy<T: Pod>(&self, from: &Buffer<T>, to: &Buffer<T>) -> Result<(), DeviceError> {
        if from.len != to.len {
            return Err(DeviceError::Length { label: to.label, found: from.len, expected: to.len });
        }
        match (&self.inner, &from.storage, &to.storage) {
            (Inner::Cpu { .. }, Storage::Host(from), Storage::Host(to)) => to.copy_from(from),
            (Inner::Gpu(gpu), Storage::Gpu(from), Storage::Gpu(to)) => gpu.copy(&from.raw, &to.raw)?,
            _ => return Err(DeviceError::Foreign { label: to.label }),
        }
        Ok(())
    }

    /// Runs `invocations` of a kernel over `buffers`, in the order of [`Kernel::access`].
    ///
    /// Runs are ordered: each sees what the ones before it wrote. A GPU may only record
    /// them until something is read, so a fault may be told by a later call.
    ///
    /// # Errors
    /// The number of buffers is wrong, one buffer is bound twice while written, or the device
    /// is lost or out of memory.
    pub fn run<P: Pod>(
        &self,
        kernel: &'static Kernel,
        invocations: usize,
        params: &P,
        buffers: &[&dyn AnyBuffer],
    ) -> Result<(), DeviceError> {
        if buffers.len() != kernel.access.len() {
            return Err(DeviceError::Bindings {
                kernel: kernel.name,
                found: buffers.len(),
                expected: kernel.access.len(),
            });
        }
        if invocations == 0 {
            return Ok(());
        }
        let bindings: Vec<Binding<'_>> = buffers.iter().map(|b| b.binding()).collect();
        let params = bytemuck::bytes_of(params);
        match &self.inner {
            Inner::Cpu { .. } => host::run(kernel, invocations, params, &bindings),
            Inner::Gpu(gpu) => gpu.run(kernel, invocations, params, &bindings),
        }
    }

    /// Waits until everything that was run is done, for measurements.
    ///
    /// # Errors
    /// The device is lost, or a run failed.
    pub fn finish(&self) -> Result<(), DeviceError> {
        match &self.inner {
            Inner::Cpu { .. } => Ok(()),
            Inner::Gpu(gpu) => gpu.finish(),
        }
    }

    /// Breaks a GPU device, as a driver's crash would, for tests of what comes after.
    #[doc(hidden)]
    pub fn lose(&self) {
        if let Inner::Gpu(gpu) = &self.inner {
            gpu.lose();
        }
    }
}
