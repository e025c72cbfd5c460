// Mirrors cg.rs, struct Scalars, and sums partials in its order.
struct Count { n: u32, blocks: u32, pad0: u32, pad1: u32 }
struct Scalars { rz: f32, alpha: f32, beta: f32, curvature: f32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> partials: array<f32>;
@group(0) @binding(2) var<storage, read_write> s: array<Scalars>;

fn sum_partials() -> f32 {
    var sums = vec4<f32>(0.0);
    for (var i = 0u; i < count.n; i += 4u) {
        sums += vec4<f32>(partials[i], partials[i + 1u], partials[i + 2u], partials[i + 3u]);
    }
    return (sums.x + sums.y) + (sums.z + sums.w);
}
