// Twin: bsr.rs, bsr_multiply. y = A x, one block row each.
struct Rows { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> rows: Rows;
@group(0) @binding(1) var<storage, read> row_start: array<u32>;
@group(0) @binding(2) var<storage, read> columns: array<u32>;
@group(0) @binding(3) var<storage, read> blocks: array<f32>;
@group(0) @binding(4) var<storage, read> x: array<f32>;
@group(0) @binding(5) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let row = invocation(gid, groups);
    if row >= rows.n { return; }
    var sum = vec3<f32>(0.0);
    for (var k = row_start[row]; k < row_start[row + 1u]; k++) {
        let b = 9u * k;
        let c = 3u * columns[k];
        let v = vec3<f32>(x[c], x[c + 1u], x[c + 2u]);
        sum += vec3<f32>(
            blocks[b] * v.x + blocks[b + 1u] * v.y + blocks[b + 2u] * v.z,
            blocks[b + 3u] * v.x + blocks[b + 4u] * v.y + blocks[b + 5u] * v.z,
            blocks[b + 6u] * v.x + blocks[b + 7u] * v.y + blocks[b + 8u] * v.z,
        );
    }
    y[3u * row] = sum.x;
    y[3u * row + 1u] = sum.y;
    y[3u * row + 2u] = sum.z;
}
