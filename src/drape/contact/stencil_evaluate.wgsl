// Twin: operator.rs, STENCIL_EVALUATE. Force vector and block of each stencil.
@group(0) @binding(1) var<storage, read> stencils: array<Stencil>;
@group(0) @binding(2) var<storage, read> moved: array<f32>;
@group(0) @binding(3) var<storage, read_write> force: array<f32>;
@group(0) @binding(4) var<storage, read_write> block: array<f32>;

// First and second derivative of the contact potentials.
fn slopes(s: Stencil) -> vec2<f32> {
    let d = s.gap;
    let r = s.radius;
    let k = s.stiffness;
    if d >= r { return vec2<f32>(0.0); }
    if s.kind == 1u {
        let x = r - d;
        let reach = 3.0 * r;
        if x <= reach { return vec2<f32>(-k * x, k); }
        return vec2<f32>(-k * reach, k * reach / x);
    }
    let tau = 0.5 * r;
    if d >= tau { return vec2<f32>(-k * (r - d), k); }
    let c = max(d, 0.01 * r);
    let g = -k * tau * tau / c;
    let h = k * tau * tau / (c * c);
    return vec2<f32>(g + h * (d - c), h);
}

fn put(i: u32, f: vec3<f32>, diagonal: vec3<f32>, off: vec3<f32>) {
    for (var c = 0u; c < 3u; c++) {
        force[3u * i + c] = f[c];
        block[6u * i + c] = diagonal[c];
        block[6u * i + 3u + c] = off[c];
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= sizes.n { return; }
    let s = stencils[i];
    let n = s.normal;
    if s.kind == 3u {
        put(i, s.stiffness * n, vec3<f32>(0.0), vec3<f32>(0.0));
        return;
    }
    let n_off = vec3<f32>(n.y * n.z, n.x * n.z, n.x * n.y);
    if s.kind == 4u {
        let longer = max(s.gap - s.radius, 0.0);
        var across = s.stiffness;
        if s.gap > 0.0 { across = s.stiffness * longer / s.gap; }
        var along = 0.0;
        if longer > 0.0 || s.radius == 0.0 { along = s.stiffness - across; }
        put(i, s.stiffness * longer * n, vec3<f32>(across) + along * n * n, along * n_off);
        return;
    }
    if s.kind != 2u {
        let e = slopes(s);
        put(i, e.x * n, e.y * n * n, e.y * n_off);
        return;
    }
    var slip = vec3<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        let at = 3u * s.nodes[k];
        slip += s.weights[k] * vec3<f32>(moved[at], moved[at + 1u], moved[at + 2u]);
    }
    slip -= dot(slip, n) * n;
    let y = length(slip);
    var across = 0.0;
    var onward = 0.0;
    if y >= s.radius {
        across = s.stiffness / y;
    } else {
        let q = y / s.radius;
        across = s.stiffness * (2.0 - q) / s.radius;
        onward = s.stiffness * (2.0 - 2.0 * q) / s.radius;
    }
    var t = slip;
    if y > 0.0 { t = slip / y; }
    let t_off = vec3<f32>(t.y * t.z, t.x * t.z, t.x * t.y);
    let diagonal = vec3<f32>(across) - across * n * n + (onward - across) * t * t;
    put(i, across * slip, diagonal, -across * n_off + (onward - across) * t_off);
}
