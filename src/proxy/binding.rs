//! Where left-out vertices are bound to the proxy, and where that puts them.
//!
//! A vertex at rest at `p` has its closest point `P` on the proxy, in a triangle with barycentric
//! coordinates `b`. With the angle-weighted normals `n_i` of the corners, `n = sum b_i n_i`
//! normalised,
//! ```text
//! p = P + h n + t        t across n (it is not zero beside ridges and beyond borders)
//! ```
//! On the deformed proxy, with primes there,
//! ```text
//! p' = P' + h n' + (I - n' n'^T) M t        M = sum b_i M_i
//! ```
//! where `M_i` is the mean, by area, over the triangles around corner `i` of the map that takes a
//! triangle's edges and unit normal to the deformed ones. `b`, `n` and `M` are continuous over the
//! proxy, so that neighbours stay neighbours. A rigid motion is followed exactly, and so is the
//! stretch of a flat proxy.
//!
//! On a bent proxy `h n'` is a little nearer to the surface than `h`. So a vertex is then moved
//! along the line from the closest point of its own patch of the proxy, until it is as far as it
//! was at rest and on its side ([`Deformed::keep_distance`]).

use nalgebra::Matrix3;

use crate::geometry::{Closest, Surface, triangle};
use crate::model::{TriMesh, Vec3};

/// A patch reaches this many times the distance of its vertex around the closest point, and
/// [`PATCH_MARGIN`] more: wide enough for a fold that is as deep as the detail is thick.
const PATCH_REACH: f64 = 3.0;
/// See [`PATCH_REACH`] [m].
const PATCH_MARGIN: f64 = 2e-3;
/// A vertex is beyond the border if more than this share of its offset runs along the surface.
const BEYOND: f64 = 0.1;
/// Vertices nearer than this lie in the surface [m].
pub const IN_SURFACE: f64 = 1e-6;
/// Most moves that restore a distance.
const MOVES: usize = 12;
/// A distance that is this close, relative to itself, is right.
const DISTANCE_TOLERANCE: f64 = 1e-6;

/// A point bound to the proxy.
#[derive(Clone, Debug)]
pub struct Bond {
    /// Triangle of the proxy.
    pub triangle: u32,
    /// Barycentric coordinates of the closest point.
    pub barycentric: [f64; 3],
    /// Offset along the interpolated normal, negative inside [m].
    pub height: f64,
    /// Offset across it [m], at rest.
    pub across: Vec3,
    /// Distance at rest [m].
    pub distance: f64,
    /// Whether the closest point is on a border that the vertex lies beyond.
    pub beyond: bool,
    /// Triangles of the proxy around, connected to `triangle`.
    patch: Vec<u32>,
}

impl Bond {
    /// Binds `p` to its closest point on the proxy at rest.
    pub fn new(rest: &Surface, around: &Neighbours, p: &Vec3) -> Bond {
        let on = rest.closest(p);
        let normal = normal_at(rest, on.triangle, &on.barycentric);
        let offset = p - on.point;
        let height = normal.dot(&offset);
        let across = offset - normal * height;
        Bond {
            triangle: on.triangle,
            barycentric: on.barycentric,
            height,
            across,
            distance: on.distance,
            beyond: rest.is_boundary(&on) && across.norm() > BEYOND * on.distance,
            patch: around.patch(rest, &on, PATCH_REACH * on.distance + PATCH_MARGIN),
        }
    }

    /// Whether the vertex lies in the surface, like one that is sewn edge to edge.
    pub fn in_surface(&self) -> bool {
        self.distance < IN_SURFACE
    }

    /// 1 if the vertex lies outside of the proxy, -1 inside.
    pub fn side(&self) -> f64 {
        if self.height < 0.0 { -1.0 } else { 1.0 }
    }
}

/// Unit normal at a point of a surface, interpolated between the corners' normals.
fn normal_at(surface: &Surface, t: u32, barycentric: &[f64; 3]) -> Vec3 {
    let corners = surface.mesh().triangles[t as usize];
    let sum = (0..3).map(|k| surface.point_normals()[corners[k] as usize] * barycentric[k]).sum::<Vec3>();
    sum.try_normalize(1e-6)
        .or_else(|| surface.mesh().area_normal(t as usize).try_normalize(0.0))
        .unwrap_or_else(Vec3::z)
}

/// Triangles around each point of a mesh.
pub struct Neighbours(Vec<Vec<u32>>);

impl Neighbours {
    /// Of all points.
    pub fn new(mesh: &TriMesh) -> Neighbours {
        let mut around = vec![Vec::new(); mesh.points.len()];
        for (t, tri) in mesh.triangles.iter().enumerate() {
            tri.iter().for_each(|&p| around[p as usize].push(t as u32));
        }
        Neighbours(around)
    }

    /// Triangles within `radius` [m] of a point of the surface that hang together with its own.
    fn patch(&self, surface: &Surface, on: &Closest, radius: f64) -> Vec<u32> {
        let mut patch = vec![on.triangle];
        let mut next = 0;
        while let Some(&t) = patch.get(next) {
            next += 1;
            for &p in &surface.mesh().triangles[t as usize] {
                for &u in &self.0[p as usize] {
                    if !patch.contains(&u) && distance(surface, u, &on.point).0 <= radius {
                        patch.push(u);
                    }
                }
            }
        }
        patch.sort_unstable();
        patch
    }
}

/// Distance of `x` from triangle `t` [m], and the closest point.
fn distance(surface: &Surface, t: u32, x: &Vec3) -> (f64, Vec3, [f64; 3]) {
    let corners = surface.mesh().corners(t as usize);
    let barycentric = triangle::closest(x, &corners);
    let point = triangle::at(&corners, &barycentric);
    ((point - x).norm(), point, barycentric)
}

/// The proxy after a deformation.
pub struct Deformed {
    /// Its welded surface.
    pub surface: Surface,
    maps: Vec<Matrix3<f64>>,
}

impl Deformed {
    /// From the welded surface at rest and the mesh of the same topology after.
    pub fn new(rest: &TriMesh, now: TriMesh) -> Deformed {
        let mut maps = vec![Matrix3::zeros(); rest.points.len()];
        let mut areas = vec![0.0; rest.points.len()];
        for (t, tri) in rest.triangles.iter().enumerate() {
            let Some(inverse) = edges(rest, t).try_inverse() else {
                continue; // a sliver that a seam has closed up has no say
            };
            let area = rest.area_normal(t).norm();
            for &p in tri {
                maps[p as usize] += edges(&now, t) * inverse * area;
                areas[p as usize] += area;
            }
        }
        for (map, area) in maps.iter_mut().zip(areas) {
            *map = if area > 0.0 { *map / area } else { Matrix3::identity() };
        }
        Deformed { surface: Surface::new(now), maps }
    }

    /// Where the bond's frame puts its vertex [m].
    pub fn place(&self, bond: &Bond) -> Vec3 {
        let corners = self.surface.mesh().triangles[bond.triangle as usize];
        let b = &bond.barycentric;
        let foot = triangle::at(&self.surface.mesh().corners(bond.triangle as usize), b);
        if bond.in_surface() {
            return foot;
        }
        let normal = normal_at(&self.surface, bond.triangle, b);
        let map = (0..3).map(|k| self.maps[corners[k] as usize] * b[k]).sum::<Matrix3<f64>>();
        let across = map * bond.across;
        foot + normal * bond.height + (across - normal * normal.dot(&across))
    }

    /// Moves `x` to the bond's side of its patch and as far from it as at rest, or as near to that
    /// as a narrow fold allows.
    pub fn keep_distance(&self, bond: &Bond, mut x: Vec3) -> Vec3 {
        if bond.in_surface() || bond.beyond {
            return x;
        }
        for _ in 0..MOVES {
            let on = self.on_patch(bond, &x);
            let outward = self.surface.pseudo_normal(&on) * bond.side();
            let offset = x - on.point;
            let right = outward.dot(&offset) > 0.0;
            if right && (on.distance - bond.distance).abs() <= DISTANCE_TOLERANCE * bond.distance {
                break;
            }
            let way = if right { offset / on.distance } else { outward };
            x = on.point + way * bond.distance;
        }
        x
    }

    /// The closest point of the bond's patch.
    pub fn on_patch(&self, bond: &Bond, x: &Vec3) -> Closest {
        let mut best =
            Closest { point: *x, triangle: bond.triangle, barycentric: [0.0; 3], distance: f64::MAX };
        for &t in &bond.patch {
            let (distance, point, barycentric) = distance(&self.surface, t, x);
            if distance < best.distance {
                best = Closest { point, triangle: t, barycentric, distance };
            }
        }
        best
    }
}

/// Two edges of a triangle and its unit normal, as columns.
fn edges(mesh: &TriMesh, t: usize) -> Matrix3<f64> {
    let [a, b, c] = mesh.corners(t);
    let normal = mesh.area_normal(t).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    Matrix3::from_columns(&[b - a, c - a, normal])
}
