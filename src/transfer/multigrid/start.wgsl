// Twin: relax.rs, START. x = D^-1 b on the first colour, zero elsewhere.
struct Colour { n: u32, first: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> colour: Colour;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> inverse: array<f32>;
@group(0) @binding(3) var<storage, read> b: array<f32>;
@group(0) @binding(4) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation(gid, groups);
    if k >= colour.n { return; }
    let i = order[k];
    for (var c = 0u; c < 3u; c++) {
        let m = 9u * i + 3u * c;
        let value = inverse[m] * b[3u * i] + inverse[m + 1u] * b[3u * i + 1u] + inverse[m + 2u] * b[3u * i + 2u];
        x[3u * i + c] = select(0.0, value, k < colour.first);
    }
}
