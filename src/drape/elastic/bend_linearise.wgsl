// Twin: bending.rs, bend_linearise. Stencil: element.rs, amount_gradients.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> hinges: array<u32>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> bends: array<f32>;
@group(0) @binding(4) var<storage, read> gradients: array<f32>;
@group(0) @binding(5) var<storage, read_write> derivatives: array<f32>;

const NONE = 0xffffffffu;

fn gradient(hinge: u32, point: u32) -> vec3<f32> {
    let at = 12u * (hinge / 4u) + 3u * point;
    return vec3<f32>(gradients[at], gradients[at + 1u], gradients[at + 2u]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let e = invocation(gid, groups);
    if e >= count.n { return; }
    for (var row = 0u; row < 3u; row++) {
        var amount = 0.0;
        var corners = array<vec3<f32>, 6>();
        for (var i = 0u; i < 3u; i++) {
            let hinge = hinges[3u * e + i];
            if hinge != NONE {
                let weight = weights[9u * e + 3u * row + i];
                let side = (hinge / 2u) % 2u;
                let swapped = hinge % 2u;
                amount += weight * bends[hinge / 4u];
                corners[i] += gradient(hinge, 2u + side) * weight;
                corners[(i + 1u) % 3u] += gradient(hinge, swapped) * weight;
                corners[(i + 2u) % 3u] += gradient(hinge, 1u - swapped) * weight;
                corners[3u + i] = gradient(hinge, 3u - side) * weight;
            }
        }
        derivatives[57u * e + row] = amount;
        for (var node = 0u; node < 6u; node++) {
            let at = 57u * e + 3u + 9u * node + 3u * row;
            derivatives[at] = corners[node].x;
            derivatives[at + 1u] = corners[node].y;
            derivatives[at + 2u] = corners[node].z;
        }
    }
}
