//! Every shader of the crate is valid and says what its [`Kernel`] says. Needs no GPU.

use std::collections::HashSet;
use std::path::Path;

use dressform::device::{Access, Kernel, WORKGROUP};
use naga::{AddressSpace, Expression, Module, ShaderStage, StorageAccess, TypeInner, VectorSize};

/// WebGPU's default limit, within which every kernel stays.
const MOST_STORAGE_BUFFERS: usize = 8;

fn parse(kernel: &Kernel) -> Module {
    let source = kernel.source();
    let module = naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|e| panic!("kernel '{}': {}", kernel.name, e.emit_to_string(&source)));
    let (flags, capabilities) = (naga::valid::ValidationFlags::all(), naga::valid::Capabilities::default());
    naga::valid::Validator::new(flags, capabilities)
        .validate(&module)
        .unwrap_or_else(|e| panic!("kernel '{}': {}", kernel.name, e.emit_to_string(&source)));
    module
}

#[test]
fn kernels_are_valid_and_names_are_unique() {
    let kernels = dressform::kernels();
    assert!(kernels.len() >= 8, "the crate's list of kernels");
    let names: HashSet<_> = kernels.iter().map(|k| k.name).collect();
    assert_eq!(names.len(), kernels.len(), "names are unique: {names:?}");
    kernels.into_iter().for_each(|k| drop(parse(k)));
}

#[test]
fn bindings_are_those_of_the_kernel() {
    for kernel in dressform::kernels() {
        assert!(kernel.access.len() <= MOST_STORAGE_BUFFERS, "kernel '{}'", kernel.name);
        let mut found = vec![None; kernel.access.len()];
        for (_, variable) in parse(kernel).global_variables.iter() {
            let Some(binding) = &variable.binding else { continue };
            assert_eq!(binding.group, 0, "kernel '{}'", kernel.name);
            match variable.space {
                AddressSpace::Uniform => assert_eq!(binding.binding, 0, "kernel '{}'", kernel.name),
                AddressSpace::Storage { access } => {
                    let slot = (binding.binding as usize).checked_sub(1).filter(|&s| s < found.len());
                    let slot = slot.unwrap_or_else(|| {
                        panic!("kernel '{}': binding {} is not in its list", kernel.name, binding.binding)
                    });
                    let written = access.contains(StorageAccess::STORE);
                    found[slot] = Some(if written { Access::Write } else { Access::Read });
                }
                space => panic!("kernel '{}': {space:?} is bound", kernel.name),
            }
        }
        let expected: Vec<_> = kernel.access.iter().copied().map(Some).collect();
        assert_eq!(found, expected, "kernel '{}'", kernel.name);
    }
}

#[test]
fn entry_is_main_with_the_workgroup_of_the_device() {
    for kernel in dressform::kernels() {
        let module = parse(kernel);
        let [entry] = &module.entry_points[..] else {
            panic!("kernel '{}' has {} entries", kernel.name, module.entry_points.len())
        };
        assert_eq!((entry.name.as_str(), entry.stage), ("main", ShaderStage::Compute), "{}", kernel.name);
        assert_eq!(entry.workgroup_size, [WORKGROUP, 1, 1], "kernel '{}'", kernel.name);
    }
}

/// What would be right on one device and wrong on another.
#[test]
fn kernels_keep_to_what_both_devices_do() {
    for kernel in dressform::kernels() {
        let module = parse(kernel);
        for (_, variable) in module.global_variables.iter() {
            let shared = matches!(variable.space, AddressSpace::WorkGroup);
            assert!(!shared, "kernel '{}' shares memory in a workgroup", kernel.name);
            let TypeInner::Array { base, .. } = module.types[variable.ty].inner else { continue };
            let padded = matches!(module.types[base].inner, TypeInner::Vector { size: VectorSize::Tri, .. });
            assert!(!padded, "kernel '{}': a buffer of vec3 has a stride of four words", kernel.name);
        }
        let atomic = module.types.iter().any(|(_, ty)| matches!(ty.inner, TypeInner::Atomic(_)));
        assert!(!atomic, "kernel '{}' uses atomics", kernel.name);
        let functions = module.functions.iter().map(|(_, f)| f);
        for function in functions.chain(module.entry_points.iter().map(|e| &e.function)) {
            let asks = function.expressions.iter().any(|(_, e)| matches!(e, Expression::ArrayLength(_)));
            assert!(!asks, "kernel '{}' asks for a length, but buffers are padded", kernel.name);
        }
    }
}

#[test]
fn no_shader_is_left_out() {
    let pieces: HashSet<&str> = dressform::kernels().iter().flat_map(|k| k.wgsl.iter().copied()).collect();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut shaders = 0;
    for file in files(&root, "wgsl") {
        let text = std::fs::read_to_string(&file).expect("readable");
        assert!(pieces.contains(text.as_str()), "{} belongs to no kernel", file.display());
        shaders += 1;
    }
    assert!(shaders >= 8, "shaders under {}", root.display());
}

fn files(folder: &Path, extension: &str) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found
}
