// Twin: gather.rs, stretch_blocks.
@group(0) @binding(5) var<storage, read_write> upper: array<f32>;

// The symmetric matrix packed as xx xy xz yy yz zz.
fn symmetric(at: u32) -> mat3x3<f32> {
    let x = vec3<f32>(derivatives[at], derivatives[at + 1u], derivatives[at + 2u]);
    let y = vec3<f32>(x.y, derivatives[at + 3u], derivatives[at + 4u]);
    return mat3x3<f32>(x, y, vec3<f32>(x.z, y.z, derivatives[at + 5u]));
}

// The matrix whose rows are packed one after the other, transposed.
fn transposed(at: u32) -> mat3x3<f32> {
    return mat3x3<f32>(
        derivatives[at], derivatives[at + 1u], derivatives[at + 2u],
        derivatives[at + 3u], derivatives[at + 4u], derivatives[at + 5u],
        derivatives[at + 6u], derivatives[at + 7u], derivatives[at + 8u],
    );
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let block = invocation(gid, groups);
    if block >= count.n { return; }
    var sum = mat3x3<f32>();
    for (var k = start[block]; k < start[block + 1u]; k++) {
        let t = items[k] / 16u;
        let i = shape(t, (items[k] / 4u) % 4u);
        let j = shape(t, items[k] % 4u);
        let at = 27u * t;
        let fw = transposed(at + 18u);
        sum += symmetric(at + 6u) * (i.x * j.x) + symmetric(at + 12u) * (i.y * j.y);
        sum += transpose(fw) * (i.x * j.y) + fw * (i.y * j.x);
    }
    for (var c = 0u; c < 3u; c++) {
        for (var r = 0u; r < 3u; r++) { upper[9u * block + 3u * r + c] = sum[c][r]; }
    }
}
