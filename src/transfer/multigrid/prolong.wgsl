// Twin: exchange.rs, prolong. x += P x_coarse, one fine node each.
const NONE = 0xffffffffu;

struct Nodes { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> nodes: Nodes;
// The coarse nodes that each fine one lies between, an eighth each.
@group(0) @binding(1) var<storage, read> parents: array<u32>;
@group(0) @binding(2) var<storage, read> coarse: array<f32>;
@group(0) @binding(3) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= nodes.n || parents[8u * i] == NONE { return; }
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < 8u; k++) {
        let j = 3u * parents[8u * i + k];
        sum += vec3<f32>(coarse[j], coarse[j + 1u], coarse[j + 2u]);
    }
    x[3u * i] += 0.125 * sum.x;
    x[3u * i + 1u] += 0.125 * sum.y;
    x[3u * i + 2u] += 0.125 * sum.z;
}
