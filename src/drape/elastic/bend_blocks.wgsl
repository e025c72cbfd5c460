// Twin: gather.rs, bend_blocks.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> start: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> upper: array<f32>;

fn triple(at: u32) -> vec3<f32> {
    return vec3<f32>(derivatives[at], derivatives[at + 1u], derivatives[at + 2u]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let block = invocation(gid, groups);
    if block >= count.n { return; }
    var x = vec3<f32>(0.0);
    var y = vec3<f32>(0.0);
    var z = vec3<f32>(0.0);
    for (var k = start[block]; k < start[block + 1u]; k++) {
        let element = 57u * (items[k] / 64u) + 3u;
        let a = element + 9u * ((items[k] / 8u) % 8u);
        let b = element + 9u * (items[k] % 8u);
        for (var row = 0u; row < 9u; row += 3u) {
            let left = triple(a + row);
            let right = triple(b + row);
            x += left.x * right;
            y += left.y * right;
            z += left.z * right;
        }
    }
    for (var c = 0u; c < 3u; c++) {
        upper[9u * block + c] += x[c];
        upper[9u * block + 3u + c] += y[c];
        upper[9u * block + 6u + c] += z[c];
    }
}
