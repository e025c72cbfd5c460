// Twin: volume.rs, residual. r = f - S u + B^T q, one node each.
const NONE = 0xffffffffu;

struct Nodes { n: u32, quarter_face: f32, second: f32, pad: u32 }

@group(0) @binding(0) var<uniform> nodes: Nodes;
// For each node: the eight cells around it; in cell `o` it is local node `7 - o`.
@group(0) @binding(1) var<storage, read> node_cells: array<u32>;
@group(0) @binding(2) var<storage, read> load: array<f32>;
@group(0) @binding(3) var<storage, read> image: array<f32>;
@group(0) @binding(4) var<storage, read> pressure: array<f32>;
@group(0) @binding(5) var<storage, read_write> r: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= nodes.n { return; }
    var sum = vec3<f32>(0.0);
    for (var o = 0u; o < 8u; o++) {
        let cell = node_cells[8u * i + o];
        if cell != NONE {
            // d[a, .] is positive where a = 7 - o lies on the upper side, that is o on the lower.
            let lower = vec3<bool>((o & 4u) == 0u, (o & 2u) == 0u, (o & 1u) == 0u);
            sum += pressure[cell] * select(vec3<f32>(-1.0), vec3<f32>(1.0), lower);
        }
    }
    for (var k = 0u; k < 3u; k++) {
        r[3u * i + k] = (load[3u * i + k] - image[3u * i + k]) + nodes.quarter_face * sum[k];
    }
}
