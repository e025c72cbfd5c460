//! Which adapters this machine has, which of them compute rightly, and which to take.

use std::sync::{Mutex, MutexGuard, OnceLock};

use serde::Serialize;

use super::{DeviceChoice, DeviceError, gpu};

/// Oldest Mesa whose results are trusted: before it, llvmpipe ends a shader's loop after
/// 65,535 turns without a word, and is several times slower.
const OLDEST_MESA: u32 = 24;
const BACKENDS: wgpu::Backends =
    wgpu::Backends::VULKAN.union(wgpu::Backends::METAL).union(wgpu::Backends::DX12);

/// An adapter of this machine, as `dressform devices` lists it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AdapterInfo {
    /// The adapter's name.
    pub name: String,
    /// `discrete`, `integrated`, `virtual`, `other` or `software`.
    pub kind: &'static str,
    /// The driver's name and version.
    pub driver: String,
    /// Whether kernels can run on it.
    pub usable: bool,
    /// Why not.
    pub reason: Option<String>,
}

impl AdapterInfo {
    fn is_hardware(&self) -> bool {
        matches!(self.kind, "discrete" | "integrated" | "virtual")
    }
}

/// An adapter and what is known of it.
#[derive(Debug)]
struct Found {
    adapter: wgpu::Adapter,
    info: AdapterInfo,
}

/// The drivers, loaded once and never unloaded.
///
/// NVIDIA's driver for Linux races and hangs where instances are made and dropped, or devices made,
/// on several threads at once ([wgpu's issue 5930](https://github.com/gfx-rs/wgpu/issues/5930)).
fn instance() -> &'static wgpu::Instance {
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    INSTANCE.get_or_init(|| {
        wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: BACKENDS,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        })
    })
}

/// Held by who asks drivers for adapters or devices, for the same reason.
fn alone() -> MutexGuard<'static, ()> {
    static OPENING: Mutex<()> = Mutex::new(());
    OPENING.lock().unwrap_or_else(|e| e.into_inner())
}

/// All adapters, best first.
fn find() -> Vec<Found> {
    let mut found: Vec<Found> = gpu::block_on(instance().enumerate_adapters(BACKENDS))
        .into_iter()
        .map(|adapter| {
            let info = describe(&adapter.get_info(), &adapter.limits());
            Found { adapter, info }
        })
        .collect();
    let kinds = ["discrete", "integrated", "virtual", "other", "software"];
    found.sort_by_key(|f| (!f.info.usable, kinds.iter().position(|&k| k == f.info.kind)));
    found
}

fn describe(info: &wgpu::AdapterInfo, limits: &wgpu::Limits) -> AdapterInfo {
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other",
    };
    let reason = refusal(&info.driver_info).or_else(|| missing(limits));
    AdapterInfo {
        name: info.name.clone(),
        kind,
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        usable: reason.is_none(),
        reason,
    }
}

/// Why a driver is not trusted, from what it says of itself ("Mesa 22.3.6 (LLVM 15.0.6)").
fn refusal(driver_info: &str) -> Option<String> {
    let (_, after) = driver_info.split_once("Mesa ")?;
    let version: String = after.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    let major: u32 = version.split('.').next()?.parse().ok()?;
    (major < OLDEST_MESA).then(|| {
        format!(
            "Mesa {version} is older than Mesa {OLDEST_MESA}, and such drivers end shader loops \
             after 65,535 turns without saying so; install Mesa {OLDEST_MESA} or later, or use the CPU"
        )
    })
}

/// What an adapter lacks of WebGPU's default limits, within which all kernels stay.
fn missing(limits: &wgpu::Limits) -> Option<String> {
    let needed = wgpu::Limits::default();
    let checks = [
        (
            "storage buffers in a shader",
            u64::from(limits.max_storage_buffers_per_shader_stage),
            u64::from(needed.max_storage_buffers_per_shader_stage),
        ),
        (
            "workgroups in a dimension",
            u64::from(limits.max_compute_workgroups_per_dimension),
            u64::from(needed.max_compute_workgroups_per_dimension),
        ),
        (
            "bytes in a storage buffer",
            limits.max_storage_buffer_binding_size,
            needed.max_storage_buffer_binding_size,
        ),
    ];
    let short = checks.iter().find(|(_, has, needs)| has < needs);
    short.map(|(what, has, needs)| format!("it allows {has} {what}, and {needs} are needed"))
}

/// Every adapter, usable or not, best first.
pub(super) fn list() -> Vec<AdapterInfo> {
    let _alone = alone();
    find().into_iter().map(|f| f.info).collect()
}

/// Opens the adapter that a choice means, or says in a note why it is the CPU.
///
/// # Errors
/// No adapter fits, or the one that fits is refused or does not open.
pub(super) fn open(choice: &DeviceChoice) -> Result<Result<gpu::Gpu, String>, DeviceError> {
    let _alone = alone();
    let found = find();
    match choice {
        DeviceChoice::Cpu => Ok(Err(String::new())),
        DeviceChoice::Auto => Ok(open_hardware(found)),
        DeviceChoice::Gpu => open_first(&found, "gpu", |_| true).map(Ok),
        DeviceChoice::Named(name) => {
            let wanted = name.to_lowercase();
            open_first(&found, name, |info| info.name.to_lowercase().contains(&wanted)).map(Ok)
        }
    }
}

fn open_first(
    found: &[Found],
    wanted: &str,
    fits: impl Fn(&AdapterInfo) -> bool,
) -> Result<gpu::Gpu, DeviceError> {
    let Some(first) = found.iter().find(|f| fits(&f.info)) else {
        let found = found.iter().map(|f| f.info.name.clone()).collect();
        return Err(DeviceError::NoAdapter { wanted: wanted.to_owned(), found });
    };
    match &first.info.reason {
        Some(reason) => {
            Err(DeviceError::Refused { adapter: first.info.name.clone(), reason: reason.clone() })
        }
        None => gpu::Gpu::open(&first.adapter, &first.info),
    }
}

/// The best hardware adapter that opens, or why none did.
fn open_hardware(found: Vec<Found>) -> Result<gpu::Gpu, String> {
    let mut reasons = Vec::new();
    for Found { adapter, info } in found.into_iter().filter(|f| f.info.is_hardware()) {
        match &info.reason {
            Some(reason) => reasons.push(format!("adapter '{}' is refused: {reason}", info.name)),
            None => match gpu::Gpu::open(&adapter, &info) {
                Ok(gpu) => return Ok(gpu),
                Err(error) => reasons.push(error.to_string()),
            },
        }
    }
    if reasons.is_empty() {
        reasons.push("no hardware GPU was found".to_owned());
    }
    Err(format!("running on the CPU: {}", reasons.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_mesa_is_refused_and_others_are_not() {
        let reason = refusal("Mesa 22.3.6 (LLVM 15.0.6)").expect("refused");
        assert!(reason.contains("Mesa 22.3.6") && reason.contains("65,535"), "{reason}");
        assert!(refusal("Mesa 23.2.1-1ubuntu3.1~22.04.2").is_some());
        assert_eq!(refusal("Mesa 24.0.0-devel"), None);
        assert_eq!(refusal("Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)"), None);
        assert_eq!(refusal("535.183.01"), None);
        assert_eq!(refusal(""), None);
    }

    #[test]
    fn small_limits_are_named() {
        let mut limits = wgpu::Limits::default();
        assert_eq!(missing(&limits), None);
        limits.max_storage_buffers_per_shader_stage = 4;
        assert_eq!(
            missing(&limits).as_deref(),
            Some("it allows 4 storage buffers in a shader, and 8 are needed")
        );
    }
}
