// Twin: membrane.rs, stretch_linearise. Eigensystem: stretch.rs.
@group(0) @binding(5) var<storage, read_write> derivatives: array<f32>;

// outer(a, b): row i, column j is a_i b_j.
fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    return mat3x3<f32>(a * b.x, a * b.y, a * b.z);
}

const IDENTITY = mat3x3<f32>(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

fn column_hessian(column: vec3<f32>, stiffness: f32) -> mat3x3<f32> {
    let n = direction(column);
    let length = length(column);
    var across = 0.0;
    if length > 1.0 { across = 1.0 - 1.0 / length; }
    return (outer(n, n) * (1.0 - across) + IDENTITY * across) * stiffness;
}

fn write_vector(at: u32, v: vec3<f32>) {
    derivatives[at] = v.x;
    derivatives[at + 1u] = v.y;
    derivatives[at + 2u] = v.z;
}

fn write_symmetric(at: u32, m: mat3x3<f32>) {
    write_vector(at, m[0]);
    derivatives[at + 3u] = m[1].y;
    derivatives[at + 4u] = m[1].z;
    derivatives[at + 5u] = m[2].z;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation(gid, groups);
    if t >= count.n { return; }
    let s = stretch_at(t);
    let k = stiffness(t);
    let at = 27u * t;
    let w = s.warp;
    let f = s.weft;
    let shear = k.z * s.strain.z;
    write_vector(at, direction(w) * (k.x * s.strain.x) + f * shear);
    write_vector(at + 3u, direction(f) * (k.y * s.strain.y) + w * shear);
    var ww = column_hessian(w, k.x);
    var ff = column_hessian(f, k.y);
    var wf = mat3x3<f32>();
    let i2 = dot(w, w) + dot(f, f);
    if i2 > 0.0 {
        let i6 = s.strain.z;
        let largest = 0.5 * (i2 + sqrt(i2 * i2 + 12.0 * i6 * i6));
        let qw = w * i6 + f * largest;
        let qf = f * i6 + w * largest;
        let scale = k.z * largest / (dot(qw, qw) + dot(qf, qf));
        let side = select(-1.0, 1.0, i6 >= 0.0);
        let v = direction(w + f * side);
        let twice = (IDENTITY - outer(v, v)) * (0.5 * i6 * k.z);
        ww += outer(qw, qw) * scale + twice * side;
        ff += outer(qf, qf) * scale + twice * side;
        wf = outer(qw, qf) * scale + twice;
    }
    write_symmetric(at + 6u, ww);
    write_symmetric(at + 12u, ff);
    let rows = transpose(wf);
    write_vector(at + 18u, rows[0]);
    write_vector(at + 21u, rows[1]);
    write_vector(at + 24u, rows[2]);
}
