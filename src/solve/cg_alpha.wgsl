// Twin: cg.rs, CG_ALPHA. The step length of a conjugate gradient iteration.
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    if invocation(gid, groups) != 0u { return; }
    let curvature = sum_partials();
    s[0].curvature = curvature;
    s[0].alpha = select(0.0, s[0].rz / curvature, curvature > 0.0);
}
