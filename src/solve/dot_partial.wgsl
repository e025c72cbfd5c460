// Twin: vector.rs, dot_partial. Lane l of block b sums x*y at b*LANES*TURNS + k*LANES + l.
const LANES = 256u;
const TURNS = 64u;

struct Count { n: u32, blocks: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> x: array<f32>;
@group(0) @binding(2) var<storage, read> y: array<f32>;
@group(0) @binding(3) var<storage, read_write> partials: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= count.blocks * LANES { return; }
    let start = (i / LANES) * LANES * TURNS + i % LANES;
    var sum = 0.0;
    for (var k = 0u; k < TURNS; k++) {
        let at = start + k * LANES;
        if at < count.n { sum += x[at] * y[at]; }
    }
    partials[i] = sum;
}
