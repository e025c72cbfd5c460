//! The GPU device, through wgpu (Vulkan, Metal, DX12).

mod batch;
mod bindings;
mod faults;
mod pipeline;

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use bytemuck::Pod;

use super::{AdapterInfo, Binding, DeviceError, Kernel, WORKGROUP};
use batch::{Batch, CAPACITY};
pub(super) use bindings::GpuBuffer;
use bindings::Groups;
use faults::Faults;
use pipeline::Pipelines;

/// Buffers are padded to this, so that copies are aligned and structs of up to four words fit.
const PADDING: u64 = 16;
/// Smallest buffer: an empty one is still bound, at a size that holds one element of any kernel.
const SMALLEST: u64 = 256;
/// Workgroups in a dimension, by WebGPU's default limits.
const GROUPS: usize = 65_535;
/// Longest wait for what was submitted. A batch takes milliseconds on hardware and seconds on a
/// software adapter; who waits longer waits for a driver that hangs.
const PATIENCE: Duration = Duration::from_secs(300);
/// Largest write that is recorded in a batch, in bytes; a larger one is worth a submission.
const SMALL_WRITE: usize = 4 << 10;
/// Read-backs up to this size, in bytes, share one staging buffer.
const SMALL_READ: u64 = 64 << 10;

/// Waits for one of wgpu's futures; off the web they are ready when they are made.
pub(super) fn block_on<F: Future>(future: F) -> F::Output {
    let mut future = std::pin::pin!(future);
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    loop {
        match future.as_mut().poll(&mut context) {
            std::task::Poll::Ready(output) => return output,
            std::task::Poll::Pending => std::thread::yield_now(),
        }
    }
}

#[derive(Debug)]
pub(super) struct Gpu {
    pub info: AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: Arc<Faults>,
    state: Mutex<State>,
}

/// What changes with every command; one thread at a time.
#[derive(Debug)]
struct State {
    pipelines: Pipelines,
    groups: Groups,
    batch: Batch,
    readback: Option<wgpu::Buffer>,
}

fn padded(bytes: usize) -> u64 {
    (bytes as u64).next_multiple_of(PADDING).max(SMALLEST)
}

/// Workgroups in x and y for a number of invocations.
fn grid(invocations: usize) -> Option<[u32; 2]> {
    let groups = invocations.div_ceil(WORKGROUP as usize);
    let y = groups.div_ceil(GROUPS);
    let x = groups.div_ceil(y.max(1));
    // The invocation's index must fit 32 bits.
    u32::try_from(x * y * WORKGROUP as usize).ok().map(|_| [x as u32, y as u32])
}

impl Gpu {
    /// Opens an adapter with WebGPU's default limits, but with buffers as large as it allows.
    pub fn open(adapter: &wgpu::Adapter, info: &AdapterInfo) -> Result<Gpu, DeviceError> {
        let best = adapter.limits();
        let required_limits = wgpu::Limits {
            max_buffer_size: best.max_buffer_size,
            max_storage_buffer_binding_size: best.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("dressform"), required_limits, ..Default::default() };
        let (device, queue) = block_on(adapter.request_device(&descriptor)).map_err(|error| {
            DeviceError::Refused { adapter: info.name.clone(), reason: error.to_string() }
        })?;
        let faults = Arc::new(Faults::default());
        let (errors, losses) = (Arc::clone(&faults), Arc::clone(&faults));
        device.on_uncaptured_error(Arc::new(move |error| errors.report(error)));
        device.set_device_lost_callback(move |reason, message| {
            losses.lose(if message.is_empty() { format!("{reason:?}") } else { message });
        });
        let batch = Batch::new(&device);
        faults.check()?;
        let state =
            State { pipelines: Pipelines::default(), groups: Groups::default(), batch, readback: None };
        Ok(Gpu { info: info.clone(), device, queue, faults, state: Mutex::new(state) })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// A buffer of `bytes` bytes, that of `data` or zeros.
    pub fn buffer(
        &self,
        label: &'static str,
        bytes: usize,
        data: Option<&[u8]>,
    ) -> Result<GpuBuffer, DeviceError> {
        use wgpu::BufferUsages as Usage;
        let size = padded(bytes);
        let limits = self.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if size > limit {
            return Err(DeviceError::TooLarge { label, bytes: bytes as u64, limit });
        }
        let mut state = self.state(); // held, so that a fault is told to the call that caused it
        state.groups.purge();
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC,
            mapped_at_creation: data.is_some_and(|data| !data.is_empty()),
        });
        self.faults.check()?;
        if let Some(data) = data.filter(|data| !data.is_empty()) {
            match buffer.get_mapped_range_mut(..) {
                Ok(mut view) => view.slice(..data.len()).copy_from_slice(data),
                Err(error) => return Err(DeviceError::Rejected(error.to_string())),
            }
            buffer.unmap();
            self.faults.check()?;
        }
        Ok(state.groups.adopt(buffer))
    }

    /// Overwrites a buffer from its start, after the kernels that were run before.
    pub fn write(&self, buffer: &wgpu::Buffer, data: &[u8]) -> Result<(), DeviceError> {
        if data.is_empty() {
            return Ok(());
        }
        let mut state = self.state();
        let size = data.len().next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT as usize);
        if !state.batch.is_open() || size > SMALL_WRITE {
            state.batch.submit(&self.queue);
            if size == data.len() {
                self.queue.write_buffer(buffer, 0, data);
            } else {
                let mut padded = data.to_vec();
                padded.resize(size, 0);
                self.queue.write_buffer(buffer, 0, &padded);
            }
        } else {
            let State { batch, .. } = &mut *state;
            batch.reserve(&self.queue, size);
            let offset = u64::from(batch.push(data, size));
            let from = batch.parameters.clone();
            batch.encoder(&self.device).copy_buffer_to_buffer(&from, offset, buffer, 0, size as u64);
        }
        self.faults.check()
    }

    /// Copies a buffer to another of the same size.
    pub fn copy(&self, from: &wgpu::Buffer, to: &wgpu::Buffer) -> Result<(), DeviceError> {
        if from == to {
            return Ok(());
        }
        let mut state = self.state();
        state.batch.encoder(&self.device).copy_buffer_to_buffer(from, 0, to, 0, from.size());
        self.faults.check()
    }

    /// Submits what is recorded and waits until it has run.
    pub fn finish(&self) -> Result<(), DeviceError> {
        self.state().batch.submit(&self.queue);
        self.wait()
    }

    fn wait(&self) -> Result<(), DeviceError> {
        let waited =
            self.device.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) });
        self.faults.check()?;
        match waited {
            Ok(_) => Ok(()),
            Err(wgpu::PollError::Timeout) => {
                Err(DeviceError::Lost(format!("no answer for {} s", PATIENCE.as_secs())))
            }
            Err(error) => Err(DeviceError::Lost(error.to_string())),
        }
    }

    /// The first `out.len()` elements of a buffer.
    pub fn read<T: Pod>(&self, buffer: &wgpu::Buffer, out: &mut [T]) -> Result<(), DeviceError> {
        let out: &mut [u8] = bytemuck::cast_slice_mut(out);
        if out.is_empty() {
            return self.faults.check();
        }
        let size = (out.len() as u64).next_multiple_of(PADDING);
        let mut state = self.state();
        let staging = self.staging(&mut state, size)?;
        state.batch.encoder(&self.device).copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
        state.batch.submit(&self.queue);
        staging.slice(..size).map_async(wgpu::MapMode::Read, |_| {}); // the view below tells
        self.wait()?;
        match staging.get_mapped_range(..size) {
            Ok(view) => out.copy_from_slice(&view[..out.len()]),
            Err(error) => return Err(DeviceError::Lost(error.to_string())),
        }
        staging.unmap();
        self.faults.check()
    }

    fn staging(&self, state: &mut State, size: u64) -> Result<wgpu::Buffer, DeviceError> {
        if let Some(buffer) = state.readback.as_ref().filter(|_| size <= SMALL_READ) {
            return Ok(buffer.clone());
        }
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size: size.max(SMALL_READ),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        self.faults.check()?;
        if size <= SMALL_READ {
            state.readback = Some(buffer.clone());
        }
        Ok(buffer)
    }

    /// Records a kernel's run.
    pub fn run(
        &self,
        kernel: &'static Kernel,
        invocations: usize,
        params: &[u8],
        bindings: &[Binding<'_>],
    ) -> Result<(), DeviceError> {
        let buffers = bindings::resolve(kernel, bindings)?;
        let grid = grid(invocations).ok_or_else(|| {
            DeviceError::Rejected(format!("kernel '{}': {invocations} invocations", kernel.name))
        })?;
        let size = params.len().next_multiple_of(PADDING as usize).max(PADDING as usize);
        if size > CAPACITY {
            return Err(DeviceError::Rejected(format!("kernel '{}': {size} parameter bytes", kernel.name)));
        }
        let mut state = self.state();
        let State { pipelines, groups, batch, .. } = &mut *state;
        let pipeline = pipelines.get(&self.device, &self.faults, kernel)?;
        batch.reserve(&self.queue, size);
        let offset = batch.push(params, size);
        let group = groups.get(&self.device, kernel, &pipeline, (&batch.parameters, size), &buffers);
        batch.dispatch(&self.device, &pipeline.compute, group, offset, grid);
        if batch.is_full() {
            batch.submit(&self.queue);
        }
        self.faults.check()
    }

    /// Breaks the device, as pulling its plug would.
    pub fn lose(&self) {
        self.device.destroy();
        // The loss is told by the next poll; what it returns tells nothing more.
        drop(self.device.poll(wgpu::PollType::wait_indefinitely()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grid_covers_all_invocations_within_limits() {
        for n in [1, 64, 65, 65_535 * 64, 65_535 * 64 + 1, 500_000_000] {
            let [x, y] = grid(n).expect("fits");
            assert!(x as usize <= GROUPS && y as usize <= GROUPS, "{n}: {x} x {y}");
            let covered = x as usize * y as usize * WORKGROUP as usize;
            assert!(covered >= n && covered < n + (x as usize + 1) * WORKGROUP as usize, "{n}: {covered}");
        }
        assert_eq!(grid(u32::MAX as usize + 1), None);
    }
}
