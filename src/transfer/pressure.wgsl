// Twin: volume.rs, cell_pressure. q = (mean div u - mean min(0, det(I + grad u) - 1)) / gamma.
const NEAR = 0.7886751345948129;
const FAR = 0.2113248654051871;

struct Cells { n: u32, compliance: f32, side: f32, pad: u32 }

@group(0) @binding(0) var<uniform> cells: Cells;
// For each cell: its eight nodes.
@group(0) @binding(1) var<storage, read> cell_nodes: array<u32>;
// For each cell: whether it has a volume term.
@group(0) @binding(2) var<storage, read> open_cells: array<u32>;
@group(0) @binding(3) var<storage, read> u: array<f32>;
@group(0) @binding(4) var<storage, read_write> pressure: array<f32>;

fn displacement(cell: u32, a: u32) -> vec3<f32> {
    let j = 3u * cell_nodes[8u * cell + a];
    return vec3<f32>(u[j], u[j + 1u], u[j + 2u]);
}

// Weights of the four edges along one axis at Gauss point `g` of the square across it.
fn across(d: array<vec3<f32>, 4>, g: u32) -> vec3<f32> {
    let s = select(vec2<f32>(NEAR, FAR), vec2<f32>(FAR, NEAR), vec2<bool>((g & 2u) != 0u, (g & 2u) != 0u));
    let t = select(vec2<f32>(NEAR, FAR), vec2<f32>(FAR, NEAR), vec2<bool>((g & 1u) != 0u, (g & 1u) != 0u));
    return s.x * (t.x * d[0] + t.y * d[1]) + s.y * (t.x * d[2] + t.y * d[3]);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let cell = invocation(gid, groups);
    if cell >= cells.n { return; }
    if open_cells[cell] == 0u {
        pressure[cell] = 0.0;
        return;
    }
    var v: array<vec3<f32>, 8>;
    for (var a = 0u; a < 8u; a++) { v[a] = displacement(cell, a); }
    let scale = 1.0 / cells.side;
    let dx = array<vec3<f32>, 4>(scale * (v[4] - v[0]), scale * (v[5] - v[1]), scale * (v[6] - v[2]), scale * (v[7] - v[3]));
    let dy = array<vec3<f32>, 4>(scale * (v[2] - v[0]), scale * (v[3] - v[1]), scale * (v[6] - v[4]), scale * (v[7] - v[5]));
    let dz = array<vec3<f32>, 4>(scale * (v[1] - v[0]), scale * (v[3] - v[2]), scale * (v[5] - v[4]), scale * (v[7] - v[6]));
    var sum = 0.0;
    for (var g = 0u; g < 8u; g++) {
        let gx = across(dx, g & 3u);
        let gy = across(dy, ((g >> 1u) & 2u) | (g & 1u));
        let gz = across(dz, g >> 1u);
        let trace = gx.x + gy.y + gz.z;
        let j = determinant(mat3x3<f32>(gx, gy, gz) + mat3x3<f32>(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)) - 1.0;
        sum += trace - min(0.0, j);
    }
    pressure[cell] = 0.125 * sum / cells.compliance;
}
