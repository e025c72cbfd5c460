// Shared by the stencil kernels; twins in operator.rs.
struct Stencil {
    nodes: vec4<u32>,
    weights: vec4<f32>,
    normal: vec3<f32>,
    gap: f32,
    radius: f32,
    stiffness: f32,
    kind: u32, // 0 barrier, 1 spring, 2 friction, 3 force, 4 tension
    pad: u32,
}

struct Sizes { n: u32, inertia: f32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> sizes: Sizes;
