// Mirrors stretch.rs: the stretch of a triangle, from its reference and displacements.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> nodes: array<u32>;
@group(0) @binding(2) var<storage, read> rest: array<f32>;
@group(0) @binding(3) var<storage, read> origin: array<f32>;
@group(0) @binding(4) var<storage, read> u: array<f32>;

struct Stretch {
    warp: vec3<f32>,
    weft: vec3<f32>,
    strain: vec3<f32>, // |F_w| - 1, |F_f| - 1, F_w . F_f
    change: vec3<f32>, // from the reference
}

fn displacement(node: u32) -> vec3<f32> {
    return vec3<f32>(u[3u * node], u[3u * node + 1u], u[3u * node + 2u]);
}

// Area times stiffness: warp, weft, shear.
fn stiffness(t: u32) -> vec3<f32> {
    return vec3<f32>(rest[8u * t + 4u], rest[8u * t + 5u], rest[8u * t + 6u]);
}

fn stretch_at(t: u32) -> Stretch {
    let u0 = displacement(nodes[3u * t]);
    let e1 = displacement(nodes[3u * t + 1u]) - u0;
    let e2 = displacement(nodes[3u * t + 2u]) - u0;
    let dw = e1 * rest[8u * t] + e2 * rest[8u * t + 2u];
    let df = e1 * rest[8u * t + 1u] + e2 * rest[8u * t + 3u];
    let r = 9u * t;
    let w = vec3<f32>(origin[r], origin[r + 1u], origin[r + 2u]);
    let f = vec3<f32>(origin[r + 3u], origin[r + 4u], origin[r + 5u]);
    let before = vec2<f32>(origin[r + 6u], origin[r + 7u]);
    let grown = vec2<f32>(dot(dw, w + w + dw), dot(df, f + f + df));
    let now = before + grown;
    let length = sqrt(max(1.0 + now, vec2<f32>(0.0)));
    let sum = length + sqrt(max(1.0 + before, vec2<f32>(0.0)));
    let change = select(vec2<f32>(0.0), grown / sum, sum > vec2<f32>(0.0));
    let shear = dot(w, df) + dot(dw, f) + dot(dw, df);
    let strain = vec3<f32>(now / (1.0 + length), origin[r + 8u] + shear);
    return Stretch(w + dw, f + df, strain, vec3<f32>(change, shear));
}

// v over its length; 0 where it has none.
fn direction(v: vec3<f32>) -> vec3<f32> {
    let length = length(v);
    if length > 0.0 { return v / length; }
    return vec3<f32>(0.0);
}
