// Twin: bending.rs, bend_energy.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> hinges: array<u32>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> bends: array<f32>;
@group(0) @binding(4) var<storage, read> origin: array<f32>;
@group(0) @binding(5) var<storage, read_write> energies: array<f32>;

const NONE = 0xffffffffu;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let e = invocation(gid, groups);
    if e >= count.n { return; }
    var c = vec3<f32>(0.0);
    for (var i = 0u; i < 3u; i++) {
        let hinge = hinges[3u * e + i];
        if hinge != NONE {
            let w = 9u * e + i;
            c += vec3<f32>(weights[w], weights[w + 3u], weights[w + 6u]) * bends[hinge / 4u];
        }
    }
    let r = vec3<f32>(origin[3u * e], origin[3u * e + 1u], origin[3u * e + 2u]);
    energies[e] += 0.5 * dot(c - r, c + r);
}
