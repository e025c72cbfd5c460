//! Commands that wait to be submitted together.
//!
//! A submission costs 0.3 to 0.9 ms on a software adapter and tens of microseconds on
//! hardware, so dispatches are recorded into one compute pass until someone reads, or the
//! batch is full. wgpu places the barriers between dispatches.
//!
//! Parameters of all dispatches of a batch lie side by side in one uniform buffer, each
//! bound with its own dynamic offset. They are collected on the host and written when the
//! batch is submitted: a queue write takes effect after everything submitted before and
//! before the commands submitted with it, so no dispatch sees another's parameters. A small
//! [`super::Gpu::write`] in the middle of a batch goes the same way, as a recorded copy out
//! of that buffer, and so keeps its place among the dispatches.

/// Bytes of parameters in a batch: WebGPU's default limit for a uniform binding.
pub(super) const CAPACITY: usize = 64 << 10;
/// Dispatches in a batch: the device starts on them while the host records the next.
const DISPATCHES: usize = 64;

#[derive(Debug)]
pub(super) struct Batch {
    /// Parameters on the device, `CAPACITY` bytes.
    pub parameters: wgpu::Buffer,
    /// Parameters of the open batch.
    bytes: Vec<u8>,
    /// Where a dynamic offset may lie.
    alignment: usize,
    open: Option<Open>,
    dispatches: usize,
}

/// The pass is declared first, for it must end before its encoder does.
#[derive(Debug)]
struct Open {
    pass: Option<wgpu::ComputePass<'static>>,
    encoder: wgpu::CommandEncoder,
}

impl Batch {
    pub fn new(device: &wgpu::Device) -> Batch {
        use wgpu::BufferUsages as Usage;
        Batch {
            parameters: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("parameters"),
                size: CAPACITY as u64,
                usage: Usage::UNIFORM | Usage::COPY_DST | Usage::COPY_SRC,
                mapped_at_creation: false,
            }),
            bytes: Vec::with_capacity(CAPACITY),
            alignment: device.limits().min_uniform_buffer_offset_alignment as usize,
            open: None,
            dispatches: 0,
        }
    }

    pub fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Makes room for `size` bytes of parameters, if need be by submitting what is there.
    pub fn reserve(&mut self, queue: &wgpu::Queue, size: usize) {
        if self.bytes.len() + size > CAPACITY {
            self.submit(queue);
        }
    }

    /// Adds parameters, padded to `size`, for which room was reserved; returns their offset.
    pub fn push(&mut self, bytes: &[u8], size: usize) -> u32 {
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize((offset + size).next_multiple_of(self.alignment).min(CAPACITY), 0);
        offset as u32
    }

    fn open(&mut self, device: &wgpu::Device) -> &mut Open {
        self.open.get_or_insert_with(|| Open {
            pass: None,
            encoder: device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None }),
        })
    }

    /// The encoder, outside of any pass.
    pub fn encoder(&mut self, device: &wgpu::Device) -> &mut wgpu::CommandEncoder {
        let open = self.open(device);
        open.pass = None;
        &mut open.encoder
    }

    /// Records one dispatch.
    pub fn dispatch(
        &mut self,
        device: &wgpu::Device,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        offset: u32,
        [x, y]: [u32; 2],
    ) {
        let open = self.open(device);
        let pass = open.pass.get_or_insert_with(|| {
            let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes: None };
            open.encoder.begin_compute_pass(&descriptor).forget_lifetime()
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[offset]);
        pass.dispatch_workgroups(x, y, 1);
        self.dispatches += 1;
    }

    pub fn is_full(&self) -> bool {
        self.dispatches >= DISPATCHES
    }

    /// Submits what was recorded.
    pub fn submit(&mut self, queue: &wgpu::Queue) {
        let Some(Open { pass, encoder }) = self.open.take() else { return };
        drop(pass);
        if !self.bytes.is_empty() {
            queue.write_buffer(&self.parameters, 0, &self.bytes);
        }
        queue.submit([encoder.finish()]);
        self.bytes.clear();
        self.dispatches = 0;
    }
}
