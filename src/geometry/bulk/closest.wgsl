// Twin: closest.rs. The closest triangle to each point, by a walk along skip links.
const INNER = 0xffffffffu;
const FARTHEST = 3.4028234e38;

struct Walk { queries: u32, nodes: u32, turns: u32, start: u32 }
struct Link { skip: u32, leaf: u32 }

@group(0) @binding(0) var<uniform> walk: Walk;
@group(0) @binding(1) var<storage, read> links: array<Link>;
@group(0) @binding(2) var<storage, read> boxes: array<f32>;
@group(0) @binding(3) var<storage, read> corners: array<f32>;
@group(0) @binding(4) var<storage, read> points: array<f32>;
@group(0) @binding(5) var<storage, read_write> found: array<vec2<u32>>; // cursor, triangle
@group(0) @binding(6) var<storage, read_write> squares: array<f32>;

fn box_square(i: u32, p: vec3<f32>) -> f32 {
    let b = 6u * i;
    let lo = vec3<f32>(boxes[b], boxes[b + 1u], boxes[b + 2u]);
    let hi = vec3<f32>(boxes[b + 3u], boxes[b + 4u], boxes[b + 5u]);
    let out = max(max(lo - p, p - hi), vec3<f32>(0.0));
    return dot(out, out);
}

fn ratio(num: f32, den: f32) -> f32 {
    if den > 0.0 { return num / den; }
    return 0.0;
}

// The point of triangle abc that is closest to the origin.
fn nearest(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec3<f32> {
    let ab = b - a;
    let ac = c - a;
    let d1 = -dot(ab, a);
    let d2 = -dot(ac, a);
    if d1 <= 0.0 && d2 <= 0.0 { return a; }
    let d3 = -dot(ab, b);
    let d4 = -dot(ac, b);
    if d3 >= 0.0 && d4 <= d3 { return b; }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 { return a + ab * ratio(d1, d1 - d3); }
    let d5 = -dot(ab, c);
    let d6 = -dot(ac, c);
    if d6 >= 0.0 && d5 <= d6 { return c; }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 { return a + ac * ratio(d2, d2 - d6); }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 { return b + (c - b) * ratio(d4 - d3, (d4 - d3) + (d5 - d6)); }
    let sum = va + vb + vc;
    return a + ab * ratio(vb, sum) + ac * ratio(vc, sum);
}

fn corner(t: u32, k: u32) -> vec3<f32> {
    let c = 9u * t + 3u * k;
    return vec3<f32>(corners[c], corners[c + 1u], corners[c + 2u]);
}

fn triangle_square(t: u32, p: vec3<f32>) -> f32 {
    let out = nearest(corner(t, 0u) - p, corner(t, 1u) - p, corner(t, 2u) - p);
    return dot(out, out);
}

// The leaf that is reached by always entering the nearer child.
fn descend(p: vec3<f32>) -> u32 {
    var i = 0u;
    while links[i].leaf == INNER {
        let left = i + 1u;
        let right = links[left].skip;
        i = select(right, left, box_square(left, p) <= box_square(right, p));
    }
    return links[i].leaf;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) gid: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let q = invocation(gid, groups);
    if q >= walk.queries { return; }
    let p = vec3<f32>(points[3u * q], points[3u * q + 1u], points[3u * q + 2u]);
    var i = found[q].x;
    var best = found[q].y;
    var square = squares[q];
    if walk.start == 1u {
        i = 0u;
        best = INNER;
        square = FARTHEST;
        if walk.nodes > 0u {
            let t = descend(p);
            let d = triangle_square(t, p);
            if d < square { best = t; square = d; }
        }
    }
    for (var turn = 0u; turn < walk.turns && i < walk.nodes; turn++) {
        if box_square(i, p) < square {
            let t = links[i].leaf;
            if t != INNER {
                let d = triangle_square(t, p);
                if d < square { best = t; square = d; }
            }
            i += 1u;
        } else {
            i = links[i].skip;
        }
    }
    found[q] = vec2<u32>(i, best);
    squares[q] = square;
}
