//! A device does what its documentation says, on the CPU and on the GPU.

mod common;

use dressform::device::{Access, Buffer, Device, DeviceChoice, DeviceError, HostArgs, INDEX_WGSL, Kernel};

/// y = a y + b, in integers: exact, and its order matters.
static AFFINE: Kernel = Kernel {
    name: "test_affine",
    wgsl: &[
        INDEX_WGSL,
        "struct P { n: u32, a: u32, b: u32, pad: u32 }
        @group(0) @binding(0) var<uniform> p: P;
        @group(0) @binding(1) var<storage, read_write> y: array<u32>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
            let i = invocation(gid, groups);
            if i >= p.n { return; }
            y[i] = p.a * y[i] + p.b * i;
        }",
    ],
    access: &[Access::Write],
    host: |args| {
        let [n, a, b, _] = args.params::<[u32; 4]>();
        let y = args.write::<u32>(0);
        for i in 0..n {
            y[i as usize] = a.wrapping_mul(y[i as usize]).wrapping_add(b.wrapping_mul(i));
        }
    },
};

/// z = x, with both bound.
static TWO: Kernel = Kernel {
    name: "test_two",
    wgsl: &["@group(0) @binding(1) var<storage, read> x: array<u32>;
        @group(0) @binding(2) var<storage, read_write> z: array<u32>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) gid: vec3<u32>) { z[gid.x] = x[gid.x]; }"],
    access: &[Access::Read, Access::Write],
    host: |args| args.write::<u32>(1).copy_from_slice(args.read::<u32>(0)),
};

static BROKEN: Kernel = Kernel {
    name: "test_broken",
    wgsl: &["@compute @workgroup_size(64) fn main() { let x: u32 = 1.5; }"],
    access: &[Access::Write],
    host: |_: &mut HostArgs<'_>| {},
};

#[test]
fn data_comes_back_as_it_went() {
    for device in common::devices("data_comes_back_as_it_went") {
        for n in [0usize, 1, 3, 64, 70_001] {
            let data: Vec<u8> = (0..n).map(|i| (i * 7) as u8).collect();
            let a = device.upload("a", &data).expect("upload");
            let b: Buffer<u8> = device.zeros("b", n).expect("zeros");
            assert_eq!(device.read(&b).expect("read"), vec![0; n]);
            device.copy(&a, &b).expect("copy");
            device.copy(&b, &b).expect("copy to itself");
            assert_eq!(device.read(&b).expect("read"), data);
            let other: Vec<u8> = data.iter().rev().copied().collect();
            device.write(&b, &other).expect("write");
            assert_eq!(device.read(&b).expect("read"), other);
            assert_eq!((b.len(), b.is_empty()), (n, n == 0));
        }
    }
}

#[test]
fn commands_keep_their_order() {
    // More runs than a batch holds, with writes small and large among them.
    let results: Vec<_> = common::devices("commands_keep_their_order")
        .iter()
        .map(|device| {
            let n = 3000;
            let y = device.upload("y", &vec![1u32; n]).expect("upload");
            let small = device.upload("small", &[5u32; 16]).expect("upload");
            for turn in 0..300u32 {
                device.run(&AFFINE, n, &[n as u32, 3, turn, 0], &[&y]).expect("run");
                device.run(&AFFINE, 16, &[16u32, 7, turn, 0], &[&small]).expect("run");
                if turn % 11 == 3 {
                    device.write(&small, &[turn; 16]).expect("write");
                }
                if turn == 120 {
                    let now: Vec<u32> = (0..n as u32).collect();
                    device.write(&y, &now).expect("write");
                }
            }
            (device.read(&y).expect("read"), device.read(&small).expect("read"))
        })
        .collect();
    assert!(results.iter().all(|r| *r == results[0]));
}

#[test]
fn dropped_buffers_do_not_come_back() {
    // Bindings are kept for the next run; they must not be another buffer's.
    for device in common::devices("dropped_buffers_do_not_come_back") {
        let kept = device.upload("kept", &[1u32; 64]).expect("upload");
        for turn in 0..100u32 {
            let y = device.upload("y", &[turn; 64]).expect("upload");
            for _ in 0..2 {
                device.run(&AFFINE, 64, &[64u32, 2, 0, 0], &[&y]).expect("run");
                device.run(&AFFINE, 64, &[64u32, 3, 0, 0], &[&kept]).expect("run");
            }
            if turn % 3 > 0 {
                assert_eq!(device.read(&y).expect("read"), [4 * turn; 64]);
            }
        }
        let expected = (0..200).fold(1u32, |y, _| y.wrapping_mul(3));
        assert_eq!(device.read(&kept).expect("read"), [expected; 64]);
    }
}

#[test]
fn dispatches_past_one_dimension_reach_every_element() {
    let Some(device) = common::gpu("dispatches_past_one_dimension_reach_every_element") else { return };
    let n = 65_535 * 64 + 1000;
    let y: Buffer<u32> = device.zeros("y", n).expect("zeros");
    device.run(&AFFINE, n, &[n as u32, 1, 3, 0], &[&y]).expect("run");
    let y = device.read(&y).expect("read");
    let wrong = y.iter().zip(0u32..).position(|(&y, i)| y != i.wrapping_mul(3));
    assert_eq!(wrong, None);
}

#[test]
fn misuse_is_told_and_harms_nothing() {
    for device in common::devices("misuse_is_told_and_harms_nothing") {
        let a = device.upload("a", &[1u32; 64]).expect("upload");
        let b = device.upload("b", &[2u32; 65]).expect("upload");
        let aliased = device.run(&TWO, 64, &0u32, &[&a, &a]);
        assert_eq!(aliased, Err(DeviceError::Aliased { kernel: "test_two", label: "a" }));
        let bindings = device.run(&TWO, 64, &0u32, &[&a]);
        assert_eq!(bindings, Err(DeviceError::Bindings { kernel: "test_two", found: 1, expected: 2 }));
        let length = DeviceError::Length { label: "b", found: 64, expected: 65 };
        assert_eq!(device.copy(&a, &b), Err(length.clone()));
        assert_eq!(device.write(&b, &[0; 64]), Err(length));
        assert_eq!(device.read(&a).expect("read"), [1; 64]);
    }
}

#[test]
fn buffers_of_another_device_are_refused() {
    let Some(gpu) = common::gpu("buffers_of_another_device_are_refused") else { return };
    let cpu = Device::cpu();
    for (own, other) in [(&gpu, &cpu), (&cpu, &gpu)] {
        let y = other.upload("y", &[1u32; 64]).expect("upload");
        let foreign = Err(DeviceError::Foreign { label: "y" });
        assert_eq!(own.run(&AFFINE, 64, &[64u32, 1, 1, 0], &[&y]), foreign);
        assert_eq!(own.write(&y, &[0; 64]), foreign);
        assert_eq!(own.read(&y).map(|_| ()), foreign);
    }
}

#[test]
fn faults_of_a_gpu_are_errors() {
    let Some(device) = common::gpu("faults_of_a_gpu_are_errors") else { return };
    let y = device.upload("y", &[1u32; 64]).expect("upload");
    match device.run(&BROKEN, 64, &0u32, &[&y]) {
        Err(DeviceError::Rejected(message)) => assert!(message.contains("test_broken"), "{message}"),
        other => panic!("{other:?}"),
    }
    match device.zeros::<u32>("huge", 1 << 44) {
        Err(DeviceError::TooLarge { label: "huge", bytes, limit }) => assert!(bytes > limit),
        other => panic!("{other:?}"),
    }
    device.run(&AFFINE, 64, &[64u32, 2, 0, 0], &[&y]).expect("the device still works");
    assert_eq!(device.read(&y).expect("read"), [2; 64]);
}

#[test]
fn a_lost_device_says_so_for_ever() {
    let Some(device) = common::gpu("a_lost_device_says_so_for_ever") else { return };
    let y = device.upload("y", &[1u32; 64]).expect("upload");
    let w = device.upload("w", &[0u32; 64]).expect("upload");
    device.run(&AFFINE, 64, &[64u32, 2, 0, 0], &[&y]).expect("run");
    device.lose();
    let lost = |result: Result<(), DeviceError>| matches!(result, Err(DeviceError::Lost(_)));
    for _ in 0..2 {
        assert!(lost(device.read(&y).map(|_| ())));
        assert!(lost(device.run(&AFFINE, 64, &[64u32, 2, 0, 0], &[&y])));
        assert!(lost(device.upload("z", &[1u32]).map(|_| ())));
        assert!(lost(device.write(&y, &[0; 64])));
        assert!(lost(device.copy(&y, &w)));
        assert!(lost(device.finish()));
    }
}

#[test]
fn choices_open_what_they_name() {
    let auto = Device::open(&DeviceChoice::Auto).expect("auto never fails").info();
    let hardware = Device::list().into_iter().find(|a| a.usable && a.kind != "software" && a.kind != "other");
    match hardware {
        Some(adapter) => assert_eq!((auto.kind, auto.name), ("gpu", adapter.name)),
        None => {
            assert_eq!(auto.kind, "cpu");
            let note = auto.note.expect("why it is the CPU");
            assert!(note.contains("CPU"), "{note}");
        }
    }
    let nobody = DeviceChoice::Named("no such adapter".to_owned());
    match Device::open(&nobody) {
        Err(DeviceError::NoAdapter { wanted, found }) => {
            assert_eq!(wanted, "no such adapter");
            assert_eq!(found.len(), Device::list().len());
        }
        other => panic!("{other:?}"),
    }
    let cpu = Device::open(&DeviceChoice::Cpu).expect("cpu").info();
    assert_eq!((cpu.kind, cpu.note), ("cpu", None));
    let Some(gpu) = common::gpu("choices_open_what_they_name") else { return };
    let name = gpu.info().name;
    let named = Device::open(&DeviceChoice::Named(name[1..].to_uppercase())).expect("by part of its name");
    assert_eq!(named.info().name, name);
    assert!(gpu.info().driver.is_some_and(|d| !d.is_empty()));
}
