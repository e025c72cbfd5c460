// Twin: gather.rs, bend_gradient.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> start: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;

fn triple(at: u32) -> vec3<f32> {
    return vec3<f32>(derivatives[at], derivatives[at + 1u], derivatives[at + 2u]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let node = invocation(gid, groups);
    if node >= count.n { return; }
    var sum = vec3<f32>(0.0);
    for (var k = start[node]; k < start[node + 1u]; k++) {
        let element = 57u * (items[k] / 8u);
        let j = element + 3u + 9u * (items[k] % 8u);
        let c = triple(element);
        sum += c.x * triple(j) + c.y * triple(j + 3u) + c.z * triple(j + 6u);
    }
    gradient[3u * node] += sum.x;
    gradient[3u * node + 1u] += sum.y;
    gradient[3u * node + 2u] += sum.z;
}
