//! Seam offsets that turn with the cloth they are sewn onto.
//!
//! The paper (section 5, Seams Handling) keeps the world-space vector from a seam group to
//! each of its vertices; on another body, or under a moving arm, that vector points
//! elsewhere. Here it is held in the frame of the anchor panel's one-ring (normal, warp
//! direction, and their product), re-measured after transfer with the component along the
//! normal kept from the source: a pocket stays as thick as it was, wherever it lies.
//!
//! Within a step the offsets are fixed, between steps they turn. The force `f` on an offset
//! vertex acts on its node; its torque `o x f` goes to the ring as the forces that do the
//! same work in every motion of the frame, lagged by a step ([`Offsets::ring_forces`]).

use nalgebra::Matrix3;

use crate::model::{Garment, Vec2, Vec3};

/// An offset vertex.
#[derive(Clone, Debug)]
struct Offset {
    vertex: u32,
    anchor: u32,
    /// Components along warp, normal x warp and normal [m].
    local: Vec3,
}

/// The offsets of a garment.
#[derive(Clone, Debug)]
pub struct Offsets {
    list: Vec<Offset>,
    /// Triangles around each anchor that carries an offset, with their warp gradients.
    rings: std::collections::BTreeMap<u32, Vec<Ring>>,
    node_of_vertex: Vec<u32>,
    world: Vec<Vec3>,
}

/// A triangle and the coefficients of its two edge vectors in the warp direction.
#[derive(Clone, Debug)]
struct Ring {
    triangle: [u32; 3],
    warp: Vec2,
}

impl Offsets {
    /// Measures the offsets at `points` with panels `pattern`.
    pub fn new(garment: &Garment, points: &[Vec3], pattern: &[Vec2]) -> Offsets {
        let groups = &garment.groups;
        let anchor_of = |v: usize| groups.anchor_of_node[groups.node_of_vertex[v] as usize];
        let vertices: Vec<usize> = (0..points.len()).filter(|&v| groups.has_offset[v]).collect();
        let mut offsets = Offsets {
            list: Vec::new(),
            rings: rings(garment, pattern, &vertices.iter().map(|&v| anchor_of(v)).collect()),
            node_of_vertex: groups.node_of_vertex.clone(),
            world: vec![Vec3::zeros(); points.len()],
        };
        let source = rings(garment, &garment.pattern, &offsets.rings.keys().copied().collect());
        for v in vertices {
            let anchor = anchor_of(v);
            let measure = |ring: &[Ring], points: &[Vec3]| {
                frame(ring, points).transpose() * (points[v] - points[anchor as usize])
            };
            let mut local = measure(&offsets.rings[&anchor], points);
            local.z = measure(&source[&anchor], &garment.points).z;
            offsets.list.push(Offset { vertex: v as u32, anchor, local });
        }
        offsets
    }

    /// Turns the offsets with the nodes `x`.
    pub fn turn(&mut self, x: &[Vec3]) {
        let points: Vec<Vec3> = self.node_of_vertex.iter().map(|&n| x[n as usize]).collect();
        for offset in &self.list {
            self.world[offset.vertex as usize] = frame(&self.rings[&offset.anchor], &points) * offset.local;
        }
    }

    /// The vector from each vertex's node to the vertex, as last turned [m].
    pub fn vectors(&self) -> &[Vec3] {
        &self.world
    }

    /// Vertices from nodes.
    pub fn vertices(&self, x: &[Vec3]) -> Vec<Vec3> {
        self.node_of_vertex.iter().zip(&self.world).map(|(&n, o)| x[n as usize] + o).collect()
    }
}

impl Offsets {
    /// Vertices with an offset.
    pub fn offset_vertices(&self) -> impl Iterator<Item = usize> {
        self.list.iter().map(|offset| offset.vertex as usize)
    }

    /// Adds to `out`, by node, what the forces `force_of_vertex` [N] do to the rings by the
    /// torque of their offsets, where the nodes are `x`.
    pub fn ring_forces(&self, x: &[Vec3], force_of_vertex: &[Vec3], out: &mut [Vec3]) {
        let node = |v: u32| self.node_of_vertex[v as usize] as usize;
        for offset in &self.list {
            let ring = &self.rings[&offset.anchor];
            let (normal, warp) = sums(ring, |v| x[node(v)]);
            let (Some(n), size) = (normal.try_normalize(0.0), normal.norm()) else { continue };
            let flat = warp - n * n.dot(&warp);
            let (Some(w), length) = (flat.try_normalize(0.0), flat.norm()) else { continue };
            let across = n.cross(&w);
            let arm = Matrix3::from_columns(&[w, across, n]) * offset.local;
            let torque = arm.cross(&force_of_vertex[offset.vertex as usize]);
            // Work on the frame's rotation, in terms of the changes of `normal` and `warp`.
            let spin = torque.dot(&n) / length;
            let by_unit = torque.cross(&n) - across * (spin * n.dot(&warp));
            let by_normal = (by_unit - n * n.dot(&by_unit)) / size;
            let by_warp = across * spin;
            for Ring { triangle, warp } in ring {
                let [a, b, c] = triangle.map(node);
                let (e0, e1) = (x[b] - x[a], x[c] - x[a]);
                let f0 = e1.cross(&by_normal) + by_warp * warp.x;
                let f1 = by_normal.cross(&e0) + by_warp * warp.y;
                out[a] -= f0 + f1;
                out[b] += f0;
                out[c] += f1;
            }
        }
    }
}

type Rings = std::collections::BTreeMap<u32, Vec<Ring>>;

fn rings(garment: &Garment, pattern: &[Vec2], anchors: &std::collections::BTreeSet<u32>) -> Rings {
    let mut rings: Rings = anchors.iter().map(|&a| (a, Vec::new())).collect();
    for (t, tri) in garment.triangles.iter().enumerate() {
        let [a, b, c] = garment.pattern_corners(pattern, t);
        let (e0, e1) = (b - a, c - a);
        // x-axis = warp.x e0 + warp.y e1, solved by Cramer's rule and scaled by the area.
        let warp = Vec2::new(e1.y, -e0.y) * e0.perp(&e1).signum();
        for v in tri {
            if let Some(ring) = rings.get_mut(v) {
                ring.push(Ring { triangle: *tri, warp });
            }
        }
    }
    rings
}

/// Warp direction, normal x warp, and normal of a one-ring, as columns.
fn frame(ring: &[Ring], points: &[Vec3]) -> Matrix3<f64> {
    let (normal, warp) = sums(ring, |v| points[v as usize]);
    let normal = normal.try_normalize(0.0).unwrap_or_else(Vec3::z);
    let warp = (warp - normal * normal.dot(&warp))
        .try_normalize(0.0)
        .unwrap_or_else(|| normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize());
    Matrix3::from_columns(&[warp, normal.cross(&warp), normal])
}

/// A ring's sums of area normals and of scaled warp vectors.
fn sums(ring: &[Ring], point: impl Fn(u32) -> Vec3) -> (Vec3, Vec3) {
    let (mut normal, mut warp) = (Vec3::zeros(), Vec3::zeros());
    for Ring { triangle, warp: w } in ring {
        let [a, b, c] = triangle.map(&point);
        normal += (b - a).cross(&(c - a));
        warp += (b - a) * w.x + (c - a) * w.y;
    }
    (normal, warp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{AuthoredSeam, GarmentSource, Panel, TriMesh};

    fn patched() -> Garment {
        let p = |x: f64, y: f64, z: f64| Vec3::new(x, y, z);
        let points = vec![
            p(0., 0., 0.),
            p(1., 0., 0.),
            p(0., 1., 0.),
            p(1., 1., 0.),
            p(0., 0., 0.1),
            p(0.3, 0., 0.1),
            p(0., 0.3, 0.1),
        ];
        let uv = |i: usize| Vec2::new(points[i].x, points[i].y);
        let triangles = vec![[0, 1, 2], [1, 3, 2], [4, 5, 6]];
        let corner_pattern = triangles.iter().map(|t: &[u32; 3]| t.map(|i| uv(i as usize))).collect();
        let seam = AuthoredSeam { name: "pocket".into(), pairs: vec![[4, 0]], offset: true };
        let source = GarmentSource {
            mesh: TriMesh { points: points.clone(), triangles },
            corner_pattern,
            panel_of_triangle: vec![0, 0, 1],
            panels: vec![Panel::default(), Panel::default()],
            seams: vec![seam],
            ..GarmentSource::default()
        };
        Garment::from_source(source).unwrap()
    }

    #[test]
    fn offsets_turn_with_the_cloth_and_keep_their_thickness() {
        let garment = patched();
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.8, 1.3);
        let turned: Vec<Vec3> = garment.points.iter().map(|p| turn * (p * 2.0)).collect();
        let mut offsets = Offsets::new(&garment, &turned, &garment.pattern);
        offsets.turn(&garment.groups.node_points(&turned));
        let v = (0..7).find(|&v| garment.groups.has_offset[v]).unwrap();
        let anchor = garment.groups.anchor_of_node[garment.groups.node_of_vertex[v] as usize] as usize;
        let found = offsets.vertices(&garment.groups.node_points(&turned))[v] - turned[anchor];
        assert!((found - turn * Vec3::new(0.0, 0.0, 0.1)).norm() < 1e-12, "{found}");
    }

    #[test]
    fn ring_forces_do_the_work_of_the_offset_vertices() {
        let garment = patched();
        let mut offsets = Offsets::new(&garment, &garment.points, &garment.pattern);
        let mut noise = crate::drape::elastic::tests::Noise(9);
        let nodes: Vec<Vec3> =
            garment.groups.node_points(&garment.points).iter().map(|p| p + noise.vec3(0.2)).collect();
        let force: Vec<Vec3> = (0..7).map(|_| noise.vec3(1.0)).collect();
        let mut found = vec![Vec3::zeros(); nodes.len()];
        offsets.ring_forces(&nodes, &force, &mut found);
        let mut work = |x: &[Vec3]| {
            offsets.turn(x);
            offsets.vectors().iter().zip(&force).map(|(o, f)| o.dot(f)).sum::<f64>()
        };
        for k in 0..3 * nodes.len() {
            let mut at = |by: f64| {
                let mut x = nodes.clone();
                x[k / 3][k % 3] += by;
                work(&x)
            };
            let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((found[k / 3][k % 3] - expected).abs() < 1e-7, "{k}: {expected} {found:?}");
        }
        assert!(found.iter().any(|f| f.norm() > 1e-3));
    }
}
