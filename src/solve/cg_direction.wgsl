// Twin: cg.rs, CG_DIRECTION. p = z + beta p.
struct Count { n: u32, blocks: u32, pad0: u32, pad1: u32 }
struct Scalars { rz: f32, alpha: f32, beta: f32, curvature: f32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> s: array<Scalars>;
@group(0) @binding(2) var<storage, read> z: array<f32>;
@group(0) @binding(3) var<storage, read_write> p: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= count.n { return; }
    p[i] = z[i] + s[0].beta * p[i];
}
