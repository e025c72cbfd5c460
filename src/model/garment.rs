//! A garment: a 3D mesh with 2D panels and seams, held unwelded.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Fabric, SeamGroups, Skin, TriMesh, Vec2, Vec3};

/// Two 2D positions of one 3D point closer than this are one vertex [m].
const SAME_PATTERN_POINT: f64 = 1e-6;

/// What a panel is to the simulation (paper section 6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Not said: labels and geometry decide.
    #[default]
    Auto,
    /// Part of the garment's shell: always simulated.
    Shell,
    /// A detail on the shell: left out of the simulation and bound to the shell.
    Detail,
}

/// A pattern piece.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Panel {
    /// Name of the subset it came from, or a made one.
    pub name: String,
    /// Semantic label (`front`, `pocket`, ...), possibly empty.
    pub label: String,
    /// What the stage says that it is to the simulation.
    #[serde(default)]
    pub role: Role,
    /// Fabric.
    pub fabric: Fabric,
}

/// A seam as a stage authors it, between points of the source mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AuthoredSeam {
    /// Instance name.
    pub name: String,
    /// Pairs of points; with an offset the first lies on top of the second.
    pub pairs: Vec<[u32; 2]>,
    /// Whether the pairs keep the distance that they have on the source.
    pub offset: bool,
}

/// A garment as the bridge reads it: the source mesh, triangulated, with 2D corners.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GarmentSource {
    /// Name for messages and the report.
    pub name: String,
    /// Path in its stage.
    pub path: String,
    /// Layer, from the body outwards.
    pub layer: i32,
    /// Index of the source body in the outfit.
    pub body: usize,
    /// World-space points and triangles of the source mesh.
    pub mesh: TriMesh,
    /// Panel coordinates of each triangle's corners [m], shape `[triangles, 3, 2]`.
    pub corner_pattern: Vec<[Vec2; 3]>,
    /// Panel of each triangle.
    pub panel_of_triangle: Vec<u32>,
    /// Panels.
    pub panels: Vec<Panel>,
    /// Authored seams.
    pub seams: Vec<AuthoredSeam>,
    /// Joints that move the garment, by path or name in any order; empty: all that move its body.
    pub joints: Vec<String>,
}

impl GarmentSource {
    /// A sheet: one panel of this fabric with a point of the mesh for each of the pattern, without
    /// seams. The `pattern` is in metres, `place` says where its points are in space.
    pub fn sheet(
        name: &str,
        pattern: &[Vec2],
        triangles: &[[u32; 3]],
        fabric: &Fabric,
        place: impl Fn(&Vec2) -> Vec3,
    ) -> GarmentSource {
        GarmentSource {
            name: name.to_owned(),
            mesh: TriMesh { points: pattern.iter().map(place).collect(), triangles: triangles.to_vec() },
            corner_pattern: triangles.iter().map(|t| t.map(|v| pattern[v as usize])).collect(),
            panel_of_triangle: vec![0; triangles.len()],
            panels: vec![Panel { fabric: fabric.clone(), ..Panel::default() }],
            ..GarmentSource::default()
        }
    }
}

/// What is wrong with a [`GarmentSource`].
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum SourceError {
    /// The arrays of a garment do not fit together.
    #[error("{garment}: {what} has {found} elements, {expected} expected")]
    Length { garment: String, what: &'static str, found: usize, expected: usize },
    /// An index points outside of its array.
    #[error("{garment}: {what}[{element}] is {index}, but there are only {count}")]
    Index { garment: String, what: String, element: usize, index: usize, count: usize },
    /// A coordinate is not finite.
    #[error("{garment}: {what}[{element}] is not a finite number")]
    NotFinite { garment: String, what: &'static str, element: usize },
    /// A triangle has no area.
    #[error("{garment}: triangle {element} has no area in {space}")]
    Degenerate { garment: String, element: usize, space: &'static str },
    /// Nothing to work on.
    #[error("{garment}: {what} is empty")]
    Empty { garment: String, what: &'static str },
}

/// A garment with one vertex for each distinct (3D point, 2D position).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Garment {
    /// Name for messages and the report.
    pub name: String,
    /// Path in its stage.
    pub path: String,
    /// Layer, from the body outwards.
    pub layer: i32,
    /// Index of the source body in the outfit.
    pub body: usize,
    /// Vertices on the source body [m], shape `[vertices, 3]`.
    pub points: Vec<Vec3>,
    /// Vertices in their panels [m], shape `[vertices, 2]`.
    pub pattern: Vec<Vec2>,
    /// Triangles over vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Panel of each triangle.
    pub panel_of_triangle: Vec<u32>,
    /// Panel of each vertex.
    pub panel_of_vertex: Vec<u32>,
    /// Panels.
    pub panels: Vec<Panel>,
    /// Seams as authored (over points of the source mesh).
    pub seams: Vec<AuthoredSeam>,
    /// Seam groups.
    pub groups: SeamGroups,
    /// Point of the source mesh that each vertex came from, shape `[vertices]`.
    pub point_of_vertex: Vec<u32>,
    /// Number of points of the source mesh (points that no triangle uses included).
    pub point_count: usize,
    /// Points of the source mesh on the source body [m], shape `[point_count, 3]`.
    pub source_points: Vec<Vec3>,
    /// Joints that move the garment, if it says so itself.
    pub joints: Vec<String>,
}

impl Garment {
    /// Splits the source mesh into panel vertices and ties them by seams.
    ///
    /// # Errors
    /// Whatever in the arrays does not fit together, see [`SourceError`].
    pub fn from_source(source: GarmentSource) -> Result<Garment, SourceError> {
        source.validate()?;
        let mut garment = Garment {
            name: source.name,
            path: source.path,
            layer: source.layer,
            body: source.body,
            panel_of_triangle: source.panel_of_triangle,
            panels: source.panels,
            seams: source.seams,
            joints: source.joints,
            point_count: source.mesh.points.len(),
            source_points: source.mesh.points,
            ..Garment::default()
        };
        let mut vertex_of_key = HashMap::new();
        let mut first_vertex_of_point = vec![u32::MAX; garment.point_count];
        let mut ties = Vec::new();
        for (t, tri) in source.mesh.triangles.iter().enumerate() {
            let panel = garment.panel_of_triangle[t];
            let vertices: [u32; 3] = std::array::from_fn(|k| {
                let uv = source.corner_pattern[t][k];
                let cell = (uv / SAME_PATTERN_POINT).map(|c| c.round() as i64);
                let key = (tri[k], panel, cell.x, cell.y);
                *vertex_of_key.entry(key).or_insert_with(|| {
                    let vertex = garment.points.len() as u32;
                    garment.points.push(garment.source_points[tri[k] as usize]);
                    garment.pattern.push(uv);
                    garment.point_of_vertex.push(tri[k]);
                    garment.panel_of_vertex.push(panel);
                    let first = &mut first_vertex_of_point[tri[k] as usize];
                    if *first == u32::MAX {
                        *first = vertex;
                    } else {
                        ties.push([*first, vertex]);
                    }
                    vertex
                })
            });
            garment.triangles.push(vertices);
        }
        let mut offset_ties = Vec::new();
        for seam in &garment.seams {
            for pair in &seam.pairs {
                let tie = pair.map(|p| first_vertex_of_point[p as usize]);
                if tie.contains(&u32::MAX) {
                    continue; // a point without faces is not part of the cloth
                }
                if seam.offset { &mut offset_ties } else { &mut ties }.push(tie);
            }
        }
        garment.groups = SeamGroups::new(garment.points.len(), &ties, &offset_ties);
        Ok(garment)
    }

    /// The 3D mesh on the source body.
    pub fn mesh(&self) -> TriMesh {
        self.mesh_at(&self.points)
    }

    /// The 3D mesh with its vertices at `points`.
    pub fn mesh_at(&self, points: &[Vec3]) -> TriMesh {
        TriMesh { points: points.to_vec(), triangles: self.triangles.clone() }
    }

    /// The 3D mesh with its vertices at `points` and sewn vertices merged (those sewn with an
    /// offset stay apart), triangle by triangle as [`Garment::triangles`].
    pub fn welded_mesh(&self, points: &[Vec3]) -> TriMesh {
        let weld = &self.groups.weld_of_vertex;
        let mut welded = vec![Vec3::zeros(); self.groups.weld_count];
        for v in (0..points.len()).rev() {
            welded[weld[v] as usize] = points[v];
        }
        let triangles = self.triangles.iter().map(|t| t.map(|v| weld[v as usize])).collect();
        TriMesh { points: welded, triangles }
    }

    /// The corners of triangle `t` in `pattern` coordinates.
    pub fn pattern_corners(&self, pattern: &[Vec2], t: usize) -> [Vec2; 3] {
        self.triangles[t].map(|v| pattern[v as usize])
    }

    /// Positions of the source mesh's points from vertex positions; points that no triangle
    /// uses keep their source position.
    pub fn scatter_points(&self, vertex_points: &[Vec3]) -> Vec<Vec3> {
        let mut points = self.source_points.clone();
        for (v, &p) in self.point_of_vertex.iter().enumerate().rev() {
            points[p as usize] = vertex_points[v];
        }
        points
    }

    /// Skin weights of the source mesh's points from those of the vertices; points that no
    /// triangle uses follow the first joint.
    pub fn scatter_skin(&self, skin: &Skin) -> Skin {
        let k = skin.influences;
        let mut joint_indices = vec![0; self.point_count * k];
        let mut joint_weights = vec![0.0; self.point_count * k];
        joint_weights.iter_mut().step_by(k.max(1)).for_each(|w| *w = 1.0);
        for (v, &p) in self.point_of_vertex.iter().enumerate().rev() {
            let (from, to) = (v * k, p as usize * k);
            joint_indices[to..to + k].copy_from_slice(&skin.joint_indices[from..from + k]);
            joint_weights[to..to + k].copy_from_slice(&skin.joint_weights[from..from + k]);
        }
        Skin { influences: k, joint_indices, joint_weights }
    }

    /// Fabric of triangle `t`.
    pub fn fabric(&self, t: usize) -> &Fabric {
        &self.panels[self.panel_of_triangle[t] as usize].fabric
    }
}

impl GarmentSource {
    fn validate(&self) -> Result<(), SourceError> {
        let garment = || self.path.clone();
        let triangles = self.mesh.triangles.len();
        if triangles == 0 {
            return Err(SourceError::Empty { garment: garment(), what: "the list of faces" });
        }
        let lengths = [
            ("panel coordinates", self.corner_pattern.len()),
            ("panel of each triangle", self.panel_of_triangle.len()),
        ];
        for (what, found) in lengths {
            if found != triangles {
                return Err(SourceError::Length { garment: garment(), what, found, expected: triangles });
            }
        }
        let index = |what: &str, element: usize, index: u32, count: usize| {
            if (index as usize) < count {
                return Ok(());
            }
            let (what, index) = (what.to_owned(), index as usize);
            Err(SourceError::Index { garment: garment(), what, element, index, count })
        };
        for (i, p) in self.mesh.points.iter().enumerate() {
            if !p.iter().all(|c| c.is_finite()) {
                return Err(SourceError::NotFinite { garment: garment(), what: "points", element: i });
            }
        }
        for (t, tri) in self.mesh.triangles.iter().enumerate() {
            for &i in tri {
                index("triangles", t, i, self.mesh.points.len())?;
            }
            index("panel of triangle", t, self.panel_of_triangle[t], self.panels.len())?;
            let uv = &self.corner_pattern[t];
            if !uv.iter().all(|p| p.iter().all(|c| c.is_finite())) {
                return Err(SourceError::NotFinite {
                    garment: garment(),
                    what: "panel coordinates",
                    element: t,
                });
            }
            if self.mesh.area_normal(t).norm() == 0.0 {
                return Err(SourceError::Degenerate { garment: garment(), element: t, space: "3D" });
            }
            if (uv[1] - uv[0]).perp(&(uv[2] - uv[0])) == 0.0 {
                return Err(SourceError::Degenerate { garment: garment(), element: t, space: "its panel" });
            }
        }
        for seam in &self.seams {
            for (e, pair) in seam.pairs.iter().enumerate() {
                for &p in pair {
                    index(&format!("seam {}", seam.name), e, p, self.mesh.points.len())?;
                }
            }
        }
        Ok(())
    }
}
