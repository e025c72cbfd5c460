// Twin: bending.rs, hinge_linearise. Formula: hinge.rs, gradient.
@group(0) @binding(5) var<storage, read_write> bends: array<f32>;
@group(0) @binding(6) var<storage, read_write> gradients: array<f32>;

fn write_vector(at: u32, v: vec3<f32>) {
    gradients[at] = v.x;
    gradients[at + 1u] = v.y;
    gradients[at + 2u] = v.z;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let h = invocation(gid, groups);
    if h >= count.n { return; }
    let s = edges_at(h);
    bends[h] = bend_of(h, s);
    let normal_a = cross(s.e, s.a);
    let normal_b = cross(s.b, s.e);
    let square = max(dot(s.e, s.e), rest[4u * h + 1u]);
    let length = sqrt(square);
    let x2 = normal_a * (length / max(dot(normal_a, normal_a), rest[4u * h + 2u]));
    let x3 = normal_b * (length / max(dot(normal_b, normal_b), rest[4u * h + 3u]));
    let along_a = dot(s.a, s.e) / square;
    let along_b = dot(s.b, s.e) / square;
    write_vector(12u * h, -(x2 * (1.0 - along_a) + x3 * (1.0 - along_b)));
    write_vector(12u * h + 3u, -(x2 * along_a + x3 * along_b));
    write_vector(12u * h + 6u, x2);
    write_vector(12u * h + 9u, x3);
}
