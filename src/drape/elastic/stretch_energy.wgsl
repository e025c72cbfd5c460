// Twin: membrane.rs, stretch_energy.
@group(0) @binding(5) var<storage, read_write> energies: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation(gid, groups);
    if t >= count.n { return; }
    var energy = 0.0;
    if t < count.triangles {
        let s = stretch_at(t);
        let term = stiffness(t) * s.change * (s.strain - 0.5 * s.change);
        energy = term.x + term.y + term.z;
    }
    energies[t] = energy;
}
