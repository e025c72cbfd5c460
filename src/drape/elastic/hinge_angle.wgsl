// Twin: bending.rs, hinge_angle.
@group(0) @binding(5) var<storage, read_write> bends: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let h = invocation(gid, groups);
    if h >= count.n { return; }
    bends[h] = bend_of(h, edges_at(h));
}
