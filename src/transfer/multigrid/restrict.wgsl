// Twin: exchange.rs, restrict. b_coarse = P^T (b - S x), one coarse node each.
const NONE = 0xffffffffu;

struct Nodes { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> nodes: Nodes;
// The 27 fine nodes around each coarse one.
@group(0) @binding(1) var<storage, read> children: array<u32>;
@group(0) @binding(2) var<storage, read> b: array<f32>;
@group(0) @binding(3) var<storage, read> image: array<f32>;
@group(0) @binding(4) var<storage, read_write> coarse: array<f32>;

// The weight of a fine node beside (0, 2) or at (1) the coarse one along one axis.
fn along(offset: u32) -> f32 {
    return select(0.5, 1.0, offset == 1u);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= nodes.n { return; }
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < 27u; k++) {
        let child = children[27u * i + k];
        if child != NONE {
            let j = 3u * child;
            let weight = along(k / 9u) * along((k / 3u) % 3u) * along(k % 3u);
            sum += weight * (vec3<f32>(b[j], b[j + 1u], b[j + 2u]) - vec3<f32>(image[j], image[j + 1u], image[j + 2u]));
        }
    }
    coarse[3u * i] = sum.x;
    coarse[3u * i + 1u] = sum.y;
    coarse[3u * i + 2u] = sum.z;
}
