// Mirrors hinge.rs: a hinge's edges and its bend.
struct Count { n: u32, triangles: u32, pad0: u32, pad1: u32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> nodes: array<u32>;
@group(0) @binding(2) var<storage, read> rest: array<f32>; // angle, edge floor, normal floors
@group(0) @binding(3) var<storage, read> origin: array<f32>;
@group(0) @binding(4) var<storage, read> u: array<f32>;

const PI = 3.14159265358979;

struct Edges { e: vec3<f32>, a: vec3<f32>, b: vec3<f32> }

fn displacement(node: u32) -> vec3<f32> {
    return vec3<f32>(u[3u * node], u[3u * node + 1u], u[3u * node + 2u]);
}

fn edge(at: u32, d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(origin[at], origin[at + 1u], origin[at + 2u]) + d;
}

fn edges_at(h: u32) -> Edges {
    let u0 = displacement(nodes[4u * h]);
    return Edges(
        edge(9u * h, displacement(nodes[4u * h + 1u]) - u0),
        edge(9u * h + 3u, displacement(nodes[4u * h + 2u]) - u0),
        edge(9u * h + 6u, displacement(nodes[4u * h + 3u]) - u0),
    );
}

// WGSL lets atan2 err by 4096 units in the last place; this one errs by a few [Moshier,
// Cephes atanf]. 0 at the origin.
fn arctangent(y: f32, x: f32) -> f32 {
    let larger = max(abs(x), abs(y));
    if larger == 0.0 { return 0.0; }
    var t = min(abs(x), abs(y)) / larger;
    var angle = 0.0;
    if t > 0.4142135623731 {
        angle = 0.25 * PI;
        t = (t - 1.0) / (t + 1.0);
    }
    let z = t * t;
    let series = ((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1;
    angle += series * z * t + t;
    if abs(y) > abs(x) { angle = 0.5 * PI - angle; }
    if x < 0.0 { angle = PI - angle; }
    return select(angle, -angle, y < 0.0);
}

fn bend_of(h: u32, s: Edges) -> f32 {
    let normal_a = cross(s.e, s.a);
    let normal_b = cross(s.b, s.e);
    let bend = arctangent(length(s.e) * dot(normal_a, s.b), dot(normal_a, normal_b)) - rest[4u * h];
    if bend > PI { return bend - 2.0 * PI; }
    if bend < -PI { return bend + 2.0 * PI; }
    return bend;
}
