// Twin: relax.rs, relax. x += D^-1 (b - S x), one node of a colour each.
struct Colour { n: u32, first: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> colour: Colour;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> rows: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> patterns: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> mass: array<f32>;
// Nodes by colour.
@group(0) @binding(5) var<storage, read> order: array<u32>;
@group(0) @binding(6) var<storage, read> inverse: array<f32>;
@group(0) @binding(7) var<storage, read> b: array<f32>;
@group(0) @binding(8) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let k = invocation(gid, groups);
    if k >= colour.n { return; }
    let i = order[colour.first + k];
    let r = vec3<f32>(b[3u * i], b[3u * i + 1u], b[3u * i + 2u]) - multiply_row(i);
    for (var c = 0u; c < 3u; c++) {
        let m = 9u * i + 3u * c;
        x[3u * i + c] += inverse[m] * r.x + inverse[m + 1u] * r.y + inverse[m + 2u] * r.z;
    }
}
