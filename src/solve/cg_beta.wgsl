// Twin: cg.rs, CG_BETA. The weight of the previous direction in the next.
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    if invocation(gid, groups) != 0u { return; }
    let rz = sum_partials();
    s[0].beta = select(0.0, rz / s[0].rz, s[0].rz > 0.0);
    s[0].rz = rz;
}
