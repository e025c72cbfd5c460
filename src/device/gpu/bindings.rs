//! Buffers, and the groups in which they are bound to kernels.
//!
//! Making a bind group costs 11 of the 13 microseconds that recording a dispatch takes, and
//! solvers bind the same buffers again and again: so groups are kept. A group keeps its
//! buffers alive, therefore a dropped buffer leaves its number, and the groups that name it
//! go before anything is bound or allocated again.

use std::collections::{HashMap, HashSet};
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::super::{Access, Binding, DeviceError, Kernel, Storage};
use super::pipeline::Pipeline;

/// Storage buffers that a kernel may have, by WebGPU's default limits.
const MOST: usize = 8;

type Dropped = Arc<Mutex<Vec<u64>>>;

/// A buffer with a number that no other has.
#[derive(Debug)]
pub(in super::super) struct GpuBuffer {
    pub raw: wgpu::Buffer,
    number: u64,
    dropped: Dropped,
}

impl Drop for GpuBuffer {
    fn drop(&mut self) {
        self.dropped.lock().unwrap_or_else(|e| e.into_inner()).push(self.number);
    }
}

/// A kernel's address, the bytes of its parameters, and its buffers' numbers.
type Key = (usize, usize, [u64; MOST]);

/// Bind groups by what they bind.
#[derive(Debug, Default)]
pub(super) struct Groups {
    made: HashMap<Key, wgpu::BindGroup>,
    dropped: Dropped,
}

impl Groups {
    /// Numbers a buffer.
    pub fn adopt(&self, raw: wgpu::Buffer) -> GpuBuffer {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        GpuBuffer { raw, number, dropped: Arc::clone(&self.dropped) }
    }

    /// Lets go of the groups whose buffers were dropped.
    pub fn purge(&mut self) {
        let dropped = std::mem::take(&mut *self.dropped.lock().unwrap_or_else(|e| e.into_inner()));
        if !dropped.is_empty() {
            let dropped: HashSet<u64> = dropped.into_iter().collect();
            self.made.retain(|(_, _, numbers), _| !numbers.iter().any(|n| dropped.contains(n)));
        }
    }

    /// The group of a kernel's run, with `size` bytes of parameters.
    pub fn get(
        &mut self,
        device: &wgpu::Device,
        kernel: &'static Kernel,
        pipeline: &Pipeline,
        parameters: (&wgpu::Buffer, usize),
        buffers: &[&GpuBuffer],
    ) -> &wgpu::BindGroup {
        self.purge();
        let mut numbers = [0; MOST];
        numbers.iter_mut().zip(buffers).for_each(|(number, buffer)| *number = buffer.number);
        let key = (std::ptr::from_ref(kernel).addr(), parameters.1, numbers);
        self.made.entry(key).or_insert_with(|| bind(device, kernel, pipeline, parameters, buffers))
    }
}

fn bind(
    device: &wgpu::Device,
    kernel: &Kernel,
    pipeline: &Pipeline,
    (parameters, size): (&wgpu::Buffer, usize),
    buffers: &[&GpuBuffer],
) -> wgpu::BindGroup {
    let parameters =
        wgpu::BufferBinding { buffer: parameters, offset: 0, size: NonZeroU64::new(size as u64) };
    let storage = buffers.iter().map(|buffer| buffer.raw.as_entire_buffer_binding());
    let entries: Vec<_> = std::iter::once(parameters)
        .chain(storage)
        .zip(0..)
        .map(|(buffer, binding)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(buffer),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(kernel.name),
        layout: &pipeline.layout,
        entries: &entries,
    })
}

/// The buffers of a run, none of them written and bound a second time.
pub(super) fn resolve<'a>(
    kernel: &Kernel,
    bindings: &[Binding<'a>],
) -> Result<Vec<&'a GpuBuffer>, DeviceError> {
    if bindings.len() > MOST {
        let message = format!("kernel '{}' has {} buffers, {MOST} are allowed", kernel.name, bindings.len());
        return Err(DeviceError::Rejected(message));
    }
    let mut buffers: Vec<&GpuBuffer> = Vec::with_capacity(bindings.len());
    for binding in bindings {
        let Storage::Gpu(buffer) = binding.storage else {
            return Err(DeviceError::Foreign { label: binding.label });
        };
        buffers.push(buffer);
    }
    for (i, binding) in bindings.iter().enumerate() {
        let written = kernel.access[i] == Access::Write;
        let again = |(j, buffer): (usize, &&GpuBuffer)| j != i && buffer.number == buffers[i].number;
        if written && buffers.iter().enumerate().any(again) {
            return Err(DeviceError::Aliased { kernel: kernel.name, label: binding.label });
        }
    }
    Ok(buffers)
}
