// Twin: operator.rs, STENCIL_PRODUCT. part = B sum w x, one stencil each.
@group(0) @binding(1) var<storage, read> stencils: array<Stencil>;
@group(0) @binding(2) var<storage, read> block: array<f32>;
@group(0) @binding(3) var<storage, read> x: array<f32>;
@group(0) @binding(4) var<storage, read_write> part: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= sizes.n { return; }
    let s = stencils[i];
    var v = vec3<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        let at = 3u * s.nodes[k];
        v += s.weights[k] * vec3<f32>(x[at], x[at + 1u], x[at + 2u]);
    }
    let b = 6u * i;
    part[3u * i] = block[b] * v.x + block[b + 5u] * v.y + block[b + 4u] * v.z;
    part[3u * i + 1u] = block[b + 5u] * v.x + block[b + 1u] * v.y + block[b + 3u] * v.z;
    part[3u * i + 2u] = block[b + 4u] * v.x + block[b + 3u] * v.y + block[b + 2u] * v.z;
}
