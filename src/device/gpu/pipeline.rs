//! Compiled kernels, once for each kernel and device.

use std::collections::HashMap;

use super::super::{Access, DeviceError, Kernel};
use super::faults::Faults;

/// A compiled kernel and the layout of its bindings.
#[derive(Clone, Debug)]
pub(super) struct Pipeline {
    pub compute: wgpu::ComputePipeline,
    pub layout: wgpu::BindGroupLayout,
}

/// By the kernel's address: kernels are statics.
#[derive(Debug, Default)]
pub(super) struct Pipelines {
    compiled: HashMap<usize, Pipeline>,
}

impl Pipelines {
    /// The kernel's pipeline, compiled when first asked for.
    ///
    /// # Errors
    /// The shader does not compile.
    pub fn get(
        &mut self,
        device: &wgpu::Device,
        faults: &Faults,
        kernel: &'static Kernel,
    ) -> Result<Pipeline, DeviceError> {
        let key = std::ptr::from_ref(kernel).addr();
        if let Some(pipeline) = self.compiled.get(&key) {
            return Ok(pipeline.clone());
        }
        let pipeline = compile(device, kernel);
        faults.check()?;
        self.compiled.insert(key, pipeline.clone());
        Ok(pipeline)
    }
}

fn compile(device: &wgpu::Device, kernel: &Kernel) -> Pipeline {
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(kernel.name),
        entries: &entries(kernel),
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(kernel.name),
        bind_group_layouts: &[Some(&layout)],
        ..Default::default()
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(kernel.name),
        source: wgpu::ShaderSource::Wgsl(kernel.source().into()),
    });
    let compute = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(kernel.name),
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions {
            // No kernel has workgroup memory that relies on zeros.
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    });
    Pipeline { compute, layout }
}

/// Binding 0: parameters. Bindings 1..: storage buffers.
fn entries(kernel: &Kernel) -> Vec<wgpu::BindGroupLayoutEntry> {
    let parameters = wgpu::BufferBindingType::Uniform;
    let storage = kernel
        .access
        .iter()
        .map(|access| wgpu::BufferBindingType::Storage { read_only: matches!(access, Access::Read) });
    std::iter::once(parameters)
        .chain(storage)
        .zip(0..)
        .map(|(ty, binding)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: binding == 0, min_binding_size: None },
            count: None,
        })
        .collect()
}
