//! Which edges pass through which triangles, by exact orientation tests.

use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use super::fixed::{Edges, Fixed, Side};
use super::regions::Regions;
use super::sheet::Sheet;
use super::tree::bounds;
use crate::model::Vec3;

/// What is tangled where a step starts.
#[derive(Clone, Debug, Default)]
pub struct Tangles {
    /// For each collider, the contact points on its wrong side.
    pub inside: Vec<Vec<bool>>,
    /// For each collider, the cloth edges that pass through one of its triangles.
    pub edges: Vec<Vec<bool>>,
    /// For each collider, the cloth triangles that meet it.
    pub triangles: Vec<Vec<bool>>,
    /// For each collider, whether the cloth has its outside away from it, by and large.
    pub outward: Vec<bool>,
    /// Cloth edge and cloth triangle that it passes through.
    pub own: Vec<[u32; 2]>,
    /// Regions of the cloth that these cut off.
    pub regions: Regions,
    /// Number of crossings with colliders.
    pub crossings: usize,
}

impl Tangles {
    /// Finds everything.
    pub fn find(sheet: &Sheet, colliders: &[Fixed<'_>], x: &[Vec3]) -> Tangles {
        let mut tangles = Tangles::default();
        tangles.find_inside(sheet, colliders, x);
        for collider in colliders {
            let (edges, triangles, count) = with_collider(sheet, collider, x);
            tangles.crossings += count;
            tangles.edges.push(edges);
            tangles.triangles.push(triangles);
        }
        tangles.own = with_itself(sheet, x);
        tangles.regions = Regions::new(sheet, &tangles.own, x);
        tangles
    }

    /// Finds the points on the wrong sides of colliders alone.
    pub fn find_inside(&mut self, sheet: &Sheet, colliders: &[Fixed<'_>], x: &[Vec3]) {
        let normals = sheet.normals(x);
        (self.inside, self.outward) = (Vec::new(), Vec::new());
        for collider in colliders {
            let sides: Vec<Side> = x.par_iter().map(|p| collider.side(p)).collect();
            let places = x.par_iter().zip(&sides);
            let mut inside: Vec<bool> = places.clone().map(|(p, side)| collider.is_inside(p, side)).collect();
            if collider.solid && inside.contains(&true) {
                collider.hidden(); // in parallel itself, so not first from within the loop
                let buried = places.map(|(p, side)| collider.is_buried(p, side));
                inside.par_iter_mut().zip(buried).for_each(|(i, buried)| *i |= buried);
            }
            let outward = sides.iter().zip(&normals).map(|(side, n)| side.normal.dot(n) > 0.0);
            let agree = outward.filter(|outward| *outward).count();
            self.outward.push(2 * agree > x.len());
            self.inside.push(inside);
        }
    }

    /// Whether nothing is on a wrong side.
    pub fn is_clean(&self) -> bool {
        self.crossings == 0 && self.own.is_empty() && self.inside.iter().all(|i| !i.contains(&true))
    }

    /// The contact points of all that is tangled, and those around them, by so many rings of edges.
    pub fn around(&self, sheet: &Sheet, rings: usize) -> Vec<bool> {
        let mut near = vec![false; sheet.node.len()];
        let mut mark = |points: &[u32]| points.iter().for_each(|&p| near[p as usize] = true);
        for [e, t] in &self.own {
            mark(&sheet.edges.ends[*e as usize]);
            mark(&sheet.triangles[*t as usize]);
        }
        for (triangle, corners) in sheet.triangles.iter().enumerate() {
            if self.triangles.iter().any(|of| of[triangle]) {
                mark(corners);
            }
        }
        for inside in &self.inside {
            (0..near.len()).filter(|&p| inside[p]).for_each(|p| near[p] = true);
        }
        for _ in 0..rings {
            let last = near.clone();
            for [p, q] in &sheet.edges.ends {
                near[*p as usize] |= last[*q as usize];
                near[*q as usize] |= last[*p as usize];
            }
        }
        near
    }

    /// Whether anything is tangled with collider `c`.
    pub fn with_collider(&self, c: usize) -> bool {
        self.inside[c].contains(&true) || self.triangles.get(c).is_some_and(|list| list.contains(&true))
    }

    /// Contact points on a wrong side.
    pub fn inside_count(&self) -> usize {
        self.inside.iter().flatten().filter(|&&i| i).count()
    }
}

/// Whether the closed segment `pq` meets the closed triangle `abc` (coplanar cases do not
/// count).
pub fn crosses(p: &Vec3, q: &Vec3, a: &Vec3, b: &Vec3, c: &Vec3) -> bool {
    let v = |p: &Vec3| Coord3D { x: p.x, y: p.y, z: p.z };
    let side = |a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3| orient3d(v(a), v(b), v(c), v(d));
    let (above, below) = (side(a, b, c, p), side(a, b, c, q));
    if above * below > 0.0 || (above == 0.0 && below == 0.0) {
        return false;
    }
    let turns = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    turns.iter().all(|&t| t >= 0.0) || turns.iter().all(|&t| t <= 0.0)
}

fn corners(ids: &[u32; 3], x: &[Vec3]) -> [Vec3; 3] {
    ids.map(|i| x[i as usize])
}

/// Crossed cloth edges and triangles, and the number of crossings.
fn with_collider(sheet: &Sheet, collider: &Fixed<'_>, x: &[Vec3]) -> (Vec<bool>, Vec<bool>, usize) {
    let mesh = collider.mesh();
    let by_edge: Vec<usize> = sheet
        .edges
        .ends
        .par_iter()
        .map(|ends| {
            let [p, q] = ends.map(|i| x[i as usize]);
            let mut count = 0;
            collider.triangle_tree.query(&bounds(&[p, q], 0.0), &mut |t| {
                let [a, b, c] = mesh.corners(t as usize);
                count += usize::from(crosses(&p, &q, &a, &b, &c));
            });
            count
        })
        .collect();
    let by_triangle: Vec<usize> = sheet
        .triangles
        .par_iter()
        .map(|tri| {
            let [a, b, c] = corners(tri, x);
            let mut count = 0;
            collider.edge_tree.query(&bounds(&[a, b, c], 0.0), &mut |e| {
                let [p, q] = collider.edges.ends[e as usize].map(|i| mesh.points[i as usize]);
                count += usize::from(crosses(&p, &q, &a, &b, &c));
            });
            count
        })
        .collect();
    let edges: Vec<bool> = by_edge.iter().map(|&n| n > 0).collect();
    let triangles = (0..sheet.triangles.len())
        .map(|t| by_triangle[t] > 0 || sheet.edges.of_triangle[t].iter().any(|&e| edges[e as usize]))
        .collect();
    (edges, triangles, by_edge.iter().sum::<usize>() + by_triangle.iter().sum::<usize>())
}

/// Cloth edges through cloth triangles, each with the triangle.
pub fn with_itself(sheet: &Sheet, x: &[Vec3]) -> Vec<[u32; 2]> {
    let tree = sheet.near.triangles.tree.fitted(|t| bounds(&corners(&sheet.triangles[t as usize], x), 0.0));
    let Edges { ends, .. } = &sheet.edges;
    let lists: Vec<Vec<[u32; 2]>> = (0..ends.len())
        .into_par_iter()
        .map(|e| {
            let [p, q] = ends[e].map(|i| x[i as usize]);
            let mut list = Vec::new();
            tree.query(&bounds(&[p, q], 0.0), &mut |t| {
                let tri = &sheet.triangles[t as usize];
                let [a, b, c] = corners(tri, x);
                if !sheet.share_node(&ends[e], tri) && crosses(&p, &q, &a, &b, &c) {
                    list.push([e as u32, t]);
                }
            });
            list.sort_unstable();
            list
        })
        .collect();
    lists.concat()
}
