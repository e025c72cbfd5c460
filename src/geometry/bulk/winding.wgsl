// Twin: winding.rs. The winding number around each point, by a walk along skip links.
const INNER = 0xffffffffu;
const MOMENTS = 23u;
const PI = 3.14159265359;

struct Walk { queries: u32, nodes: u32, turns: u32, start: u32 }
struct Link { skip: u32, leaf: u32 }

@group(0) @binding(0) var<uniform> walk: Walk;
@group(0) @binding(1) var<storage, read> links: array<Link>;
@group(0) @binding(2) var<storage, read> moments: array<f32>; // center, reach^2, N, F, C
@group(0) @binding(3) var<storage, read> corners: array<f32>;
@group(0) @binding(4) var<storage, read> points: array<f32>;
@group(0) @binding(5) var<storage, read_write> cursors: array<u32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

fn moment(at: u32) -> vec3<f32> {
    return vec3<f32>(moments[at], moments[at + 1u], moments[at + 2u]);
}

fn corner(t: u32, k: u32) -> vec3<f32> {
    let c = 9u * t + 3u * k;
    return vec3<f32>(corners[c], corners[c + 1u], corners[c + 2u]);
}

// A cluster's share, expanded about its center at r.
fn far(m: u32, r: vec3<f32>, square: f32) -> f32 {
    let inv2 = 1.0 / square;
    let inv3 = inv2 * sqrt(inv2);
    let f = moment(m + 7u); // xx, yy, zz
    let g = moment(m + 10u); // xy, yz, zx
    let c = moment(m + 13u); // xxx, yyy, zzz
    let d = moment(m + 16u); // xxy, yyz, zzx
    let e = moment(m + 19u); // xyy, yzz, zxx
    let s = r * r;
    let quadratic = dot(f, s) + dot(g, r * r.yzx);
    let cubic = dot(r, c * s + d.zxy * s.zxy + e * s.yzx) + moments[m + 22u] * r.x * r.y * r.z;
    let half_laplacian = dot(r, 3.0 * c + d.zxy + e);
    let sum = dot(moment(m + 4u), r) + f.x + f.y + f.z - 3.0 * quadratic * inv2
        + (15.0 * cubic * inv2 - 3.0 * half_laplacian) * inv2;
    return sum * inv3 / (4.0 * PI);
}

// atan2 by a polynomial: the built-in may be off by 4096 units in the last place.
fn angle(y: f32, x: f32) -> f32 {
    let large = max(abs(x), abs(y));
    if large == 0.0 { return 0.0; }
    let t = min(abs(x), abs(y)) / large;
    let s = t * t;
    var series = 0.0028662257 * s - 0.0161657367;
    series = series * s + 0.0429096138;
    series = series * s - 0.07528964;
    series = series * s + 0.1065626393;
    series = series * s - 0.1420889944;
    series = series * s + 0.1999355085;
    series = series * s - 0.3333314528;
    var angle = (series * s + 1.0) * t;
    if abs(y) > abs(x) { angle = 0.5 * PI - angle; }
    if x < 0.0 { angle = PI - angle; }
    return select(angle, -angle, y < 0.0);
}

// A triangle's share: its solid angle over 4 pi.
fn near(t: u32, p: vec3<f32>) -> f32 {
    let a = corner(t, 0u) - p;
    let b = corner(t, 1u) - p;
    let c = corner(t, 2u) - p;
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    let num = dot(a, cross(b, c));
    let den = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    return angle(num, den) / (2.0 * PI);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let q = invocation(gid, groups);
    if q >= walk.queries { return; }
    let p = vec3<f32>(points[3u * q], points[3u * q + 1u], points[3u * q + 2u]);
    var i = select(cursors[q], 0u, walk.start == 1u);
    var sum = select(sums[q], 0.0, walk.start == 1u);
    for (var turn = 0u; turn < walk.turns && i < walk.nodes; turn++) {
        let m = MOMENTS * i;
        let r = moment(m) - p;
        let square = dot(r, r);
        if square > moments[m + 3u] {
            sum += far(m, r, square);
            i = links[i].skip;
        } else {
            let t = links[i].leaf;
            if t != INNER { sum += near(t, p); }
            i += 1u;
        }
    }
    cursors[q] = i;
    sums[q] = sum;
}
