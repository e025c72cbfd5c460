// Twin: operator.rs, stencil_gather. y += mass inertia x + sum of w part, one node each.
@group(0) @binding(1) var<storage, read> start: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read> part: array<f32>;
@group(0) @binding(5) var<storage, read> mass: array<f32>;
@group(0) @binding(6) var<storage, read> x: array<f32>;
@group(0) @binding(7) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let node = invocation(gid, groups);
    if node >= sizes.n { return; }
    let m = mass[node] * sizes.inertia;
    let at = 3u * node;
    var sum = vec3<f32>(y[at], y[at + 1u], y[at + 2u]) + m * vec3<f32>(x[at], x[at + 1u], x[at + 2u]);
    for (var k = start[node]; k < start[node + 1u]; k++) {
        let p = 3u * (items[k] / 4u);
        sum += weights[items[k]] * vec3<f32>(part[p], part[p + 1u], part[p + 2u]);
    }
    y[at] = sum.x;
    y[at + 1u] = sum.y;
    y[at + 2u] = sum.z;
}
