// Twin: cg.rs, CG_ADVANCE. x += alpha p, r -= alpha q.
struct Count { n: u32, blocks: u32, pad0: u32, pad1: u32 }
struct Scalars { rz: f32, alpha: f32, beta: f32, curvature: f32 }

@group(0) @binding(0) var<uniform> count: Count;
@group(0) @binding(1) var<storage, read> s: array<Scalars>;
@group(0) @binding(2) var<storage, read> p: array<f32>;
@group(0) @binding(3) var<storage, read> q: array<f32>;
@group(0) @binding(4) var<storage, read_write> x: array<f32>;
@group(0) @binding(5) var<storage, read_write> r: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= count.n { return; }
    x[i] += s[0].alpha * p[i];
    r[i] -= s[0].alpha * q[i];
}
