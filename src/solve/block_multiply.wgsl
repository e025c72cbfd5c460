// Twin: bsr.rs, BLOCK_MULTIPLY. y = D x for a block-diagonal D.
struct Rows { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> rows: Rows;
@group(0) @binding(1) var<storage, read> blocks: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = invocation(gid, groups);
    if row >= rows.n { return; }
    let b = 9u * row;
    let v = vec3<f32>(x[3u * row], x[3u * row + 1u], x[3u * row + 2u]);
    y[3u * row] = blocks[b] * v.x + blocks[b + 1u] * v.y + blocks[b + 2u] * v.z;
    y[3u * row + 1u] = blocks[b + 3u] * v.x + blocks[b + 4u] * v.y + blocks[b + 5u] * v.z;
    y[3u * row + 2u] = blocks[b + 6u] * v.x + blocks[b + 7u] * v.y + blocks[b + 8u] * v.z;
}
