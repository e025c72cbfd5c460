// Twin: dense.rs, DENSE_MULTIPLY. y = A x for a dense A by rows.
struct Size { n: u32, pad0: u32, pad1: u32, pad2: u32 }

@group(0) @binding(0) var<uniform> size: Size;
@group(0) @binding(1) var<storage, read> matrix: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation(gid, groups);
    if i >= size.n { return; }
    var sum = 0.0;
    for (var j = 0u; j < size.n; j++) {
        sum += matrix[size.n * i + j] * x[j];
    }
    y[i] = sum;
}
