// Twin: gather.rs, stretch_gradient.
@group(0) @binding(5) var<storage, read_write> gradient: array<f32>;

fn column(at: u32) -> vec3<f32> {
    return vec3<f32>(derivatives[at], derivatives[at + 1u], derivatives[at + 2u]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let node = invocation(gid, groups);
    if node >= count.n { return; }
    var sum = vec3<f32>(0.0);
    for (var k = start[node]; k < start[node + 1u]; k++) {
        let t = items[k] / 4u;
        let g = shape(t, items[k] % 4u);
        sum += column(27u * t) * g.x + column(27u * t + 3u) * g.y;
    }
    gradient[3u * node] = sum.x;
    gradient[3u * node + 1u] = sum.y;
    gradient[3u * node + 2u] = sum.z;
}
