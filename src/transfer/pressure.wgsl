// Twin: volume.rs, cell_pressure. q = share (mean div u - mean min(0, det(I + grad u) - 1)) / gamma.
const NEAR = 0.7886751345948129;
const FAR = 0.2113248654051871;
const WHOLE = 8.0; // domain.rs

struct Cells { n: u32, compliance: f32, side: f32, pad: u32 }

@group(0) @binding(0) var<uniform> cells: Cells;
// For each cell: its eight nodes.
@group(0) @binding(1) var<storage, read> cell_nodes: array<u32>;
// For each cell: how much of it has a volume term, in parts of WHOLE.
@group(0) @binding(2) var<storage, read> shares: array<u32>;
@group(0) @binding(3) var<storage, read> u: array<f32>;
@group(0) @binding(4) var<storage, read_write> pressure: array<f32>;

fn displacement(cell: u32, a: u32) -> vec3<f32> {
    let j = 3u * cell_nodes[8u * cell + a];
    return vec3<f32>(u[j], u[j + 1u], u[j + 2u]);
}

// The gradient's column along the edge from node `a` to node `b`.
fn edge(cell: u32, a: u32, b: u32) -> vec3<f32> {
    return (1.0 / cells.side) * (displacement(cell, b) - displacement(cell, a));
}

// The four parallel edges' columns at Gauss point `g` of the square across them.
fn across(d0: vec3<f32>, d1: vec3<f32>, d2: vec3<f32>, d3: vec3<f32>, g: u32) -> vec3<f32> {
    let s = select(vec2<f32>(NEAR, FAR), vec2<f32>(FAR, NEAR), (g & 2u) != 0u);
    let t = select(vec2<f32>(NEAR, FAR), vec2<f32>(FAR, NEAR), (g & 1u) != 0u);
    return s.x * (t.x * d0 + t.y * d1) + s.y * (t.x * d2 + t.y * d3);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let cell = invocation(gid, groups);
    if cell >= cells.n { return; }
    if shares[cell] == 0u {
        pressure[cell] = 0.0;
        return;
    }
    let x0 = edge(cell, 0u, 4u);
    let x1 = edge(cell, 1u, 5u);
    let x2 = edge(cell, 2u, 6u);
    let x3 = edge(cell, 3u, 7u);
    let y0 = edge(cell, 0u, 2u);
    let y1 = edge(cell, 1u, 3u);
    let y2 = edge(cell, 4u, 6u);
    let y3 = edge(cell, 5u, 7u);
    let z0 = edge(cell, 0u, 1u);
    let z1 = edge(cell, 2u, 3u);
    let z2 = edge(cell, 4u, 5u);
    let z3 = edge(cell, 6u, 7u);
    var sum = 0.0;
    for (var g = 0u; g < 8u; g++) {
        let gx = across(x0, x1, x2, x3, g & 3u);
        let gy = across(y0, y1, y2, y3, ((g >> 1u) & 2u) | (g & 1u));
        let gz = across(z0, z1, z2, z3, g >> 1u);
        let trace = gx.x + gy.y + gz.z;
        let x = gx + vec3<f32>(1.0, 0.0, 0.0);
        let y = gy + vec3<f32>(0.0, 1.0, 0.0);
        let z = gz + vec3<f32>(0.0, 0.0, 1.0);
        let j = dot(x, cross(y, z)) - 1.0;
        sum += trace - min(0.0, j);
    }
    pressure[cell] = f32(shares[cell]) / WHOLE * 0.125 * sum / cells.compliance;
}
