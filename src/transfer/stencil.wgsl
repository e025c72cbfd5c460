// Twin: stencil.rs, stencil_multiply. y = S x, one node each.
const NONE = 0xffffffffu;
const SLOTS = 27u;

struct Nodes { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> nodes: Nodes;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
// For each node: its pattern, and its row of the boundary mass.
@group(0) @binding(2) var<storage, read> rows: array<vec2<u32>>;
// The columns of 27 blocks for each pattern.
@group(0) @binding(3) var<storage, read> patterns: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> mass: array<f32>;
@group(0) @binding(5) var<storage, read> x: array<f32>;
@group(0) @binding(6) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= nodes.n { return; }
    let row = rows[i];
    var sum0 = vec4<f32>(0.0);
    var sum1 = vec4<f32>(0.0);
    var sum2 = vec4<f32>(0.0);
    for (var k = 0u; k < SLOTS; k++) {
        let j = 3u * neighbours[SLOTS * i + k];
        let column = 3u * (SLOTS * row.x + k);
        sum0 += patterns[column] * x[j];
        sum1 += patterns[column + 1u] * x[j + 1u];
        sum2 += patterns[column + 2u] * x[j + 2u];
    }
    var sum = sum0 + sum1 + sum2;
    if row.y != NONE {
        for (var k = 0u; k < SLOTS; k++) {
            let j = 3u * neighbours[SLOTS * i + k];
            let m = mass[SLOTS * row.y + k];
            sum += m * vec4<f32>(x[j], x[j + 1u], x[j + 2u], 0.0);
        }
    }
    y[3u * i] = sum.x;
    y[3u * i + 1u] = sum.y;
    y[3u * i + 2u] = sum.z;
}
