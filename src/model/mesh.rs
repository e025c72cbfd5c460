//! Triangle meshes.

use serde::{Deserialize, Serialize};

use super::Vec3;

/// Points and the triangles between them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TriMesh {
    /// Positions [m], shape `[n, 3]`.
    pub points: Vec<Vec3>,
    /// Point indices, counter-clockwise seen from outside, shape `[m, 3]`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The three corners of triangle `t`.
    #[inline]
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        let [a, b, c] = self.triangles[t];
        [self.points[a as usize], self.points[b as usize], self.points[c as usize]]
    }

    /// Twice-area-weighted normal of triangle `t` (not normalised) [m^2].
    #[inline]
    pub fn area_normal(&self, t: usize) -> Vec3 {
        let [a, b, c] = self.corners(t);
        (b - a).cross(&(c - a))
    }

    /// Unit normals per point, weighted by the corner's angle (zero where a point has no face).
    pub fn point_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::zeros(); self.points.len()];
        for t in 0..self.triangles.len() {
            let Some(n) = self.area_normal(t).try_normalize(0.0) else {
                continue;
            };
            let corners = self.corners(t);
            for k in 0..3 {
                normals[self.triangles[t][k] as usize] += n * angle(&corners, k);
            }
        }
        for n in &mut normals {
            *n = n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        }
        normals
    }

    /// The angle of triangle `t` at its corner `k` [rad].
    pub(crate) fn corner_angle(&self, t: usize, k: usize) -> f64 {
        angle(&self.corners(t), k)
    }

    /// A third of the area of the triangles around each point [m^2].
    pub fn point_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.points.len()];
        for (t, tri) in self.triangles.iter().enumerate() {
            let third = self.area_normal(t).norm() / 6.0;
            for &i in tri {
                areas[i as usize] += third;
            }
        }
        areas
    }

    /// Connected component of each point (by shared triangles) and the number of components.
    pub fn components(&self) -> (Vec<u32>, usize) {
        let mut sets = super::seam::DisjointSets::new(self.points.len());
        for tri in &self.triangles {
            sets.union(tri[0], tri[1]);
            sets.union(tri[1], tri[2]);
        }
        sets.labels()
    }

    /// Lower and upper corner of the bounding box [m]; `None` without points.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = *self.points.first()?;
        Some(self.points.iter().fold((first, first), |(lo, hi), p| (lo.inf(p), hi.sup(p))))
    }
}

fn angle(corners: &[Vec3; 3], k: usize) -> f64 {
    (corners[(k + 1) % 3] - corners[k]).angle(&(corners[(k + 2) % 3] - corners[k]))
}
