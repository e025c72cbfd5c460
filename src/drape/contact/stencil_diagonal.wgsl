// Twin: operator.rs, STENCIL_DIAGONAL. Inverse of each node's whole diagonal block.
@group(0) @binding(1) var<storage, read> start: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read> block: array<f32>;
@group(0) @binding(5) var<storage, read> mass: array<f32>;
@group(0) @binding(6) var<storage, read> at: array<u32>;
@group(0) @binding(7) var<storage, read> elastic: array<f32>;
@group(0) @binding(8) var<storage, read_write> inverse: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let node = invocation(gid, groups);
    if node >= sizes.n { return; }
    let e = 9u * at[node];
    let m = mass[node] * sizes.inertia;
    var d = vec3<f32>(elastic[e] + m, elastic[e + 4u] + m, elastic[e + 8u] + m);
    var o = 0.5 * vec3<f32>(
        elastic[e + 5u] + elastic[e + 7u],
        elastic[e + 2u] + elastic[e + 6u],
        elastic[e + 1u] + elastic[e + 3u],
    );
    for (var k = start[node]; k < start[node + 1u]; k++) {
        let w = weights[items[k]];
        let b = 6u * (items[k] / 4u);
        d += w * w * vec3<f32>(block[b], block[b + 1u], block[b + 2u]);
        o += w * w * vec3<f32>(block[b + 3u], block[b + 4u], block[b + 5u]);
    }
    // Cofactors of the symmetric block: diagonal m, off-diagonal q (yz, xz, xy).
    let c = vec3<f32>(d.y * d.z, d.x * d.z, d.x * d.y) - o * o;
    let q = vec3<f32>(o.y * o.z, o.x * o.z, o.x * o.y) - d * o;
    let i = 1.0 / (d.x * c.x + o.z * q.z + o.y * q.y);
    let to = 9u * node;
    inverse[to] = c.x * i;
    inverse[to + 1u] = q.z * i;
    inverse[to + 2u] = q.y * i;
    inverse[to + 3u] = q.z * i;
    inverse[to + 4u] = c.y * i;
    inverse[to + 5u] = q.x * i;
    inverse[to + 6u] = q.y * i;
    inverse[to + 7u] = q.x * i;
    inverse[to + 8u] = c.z * i;
}
