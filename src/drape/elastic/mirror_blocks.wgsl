// Twin: gather.rs, mirror.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> block_source: array<u32>;
@group(0) @binding(2) var<storage, read> upper: array<f32>;
@group(0) @binding(3) var<storage, read_write> blocks: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation(gid, groups);
    if k >= count.n { return; }
    let from_upper = 9u * (block_source[k] / 2u);
    let transposed = block_source[k] % 2u == 1u;
    for (var r = 0u; r < 3u; r++) {
        for (var c = 0u; c < 3u; c++) {
            let at = select(3u * r + c, 3u * c + r, transposed);
            blocks[9u * k + 3u * r + c] = upper[from_upper + at];
        }
    }
}
