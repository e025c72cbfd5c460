// Shared by stretch_gradient and stretch_blocks: what a node or block gathers from triangles.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> start: array<u32>;
@group(0) @binding(2) var<storage, read> items: array<u32>;
@group(0) @binding(3) var<storage, read> rest: array<f32>;
@group(0) @binding(4) var<storage, read> derivatives: array<f32>;

// Shape gradient of a triangle's corner along warp and weft.
fn shape(t: u32, corner: u32) -> vec2<f32> {
    let a = vec2<f32>(rest[8u * t], rest[8u * t + 1u]);
    let b = vec2<f32>(rest[8u * t + 2u], rest[8u * t + 3u]);
    if corner == 0u { return -(a + b); }
    return select(b, a, corner == 1u);
}
