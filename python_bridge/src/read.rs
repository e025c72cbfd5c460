//! Python dictionaries of numpy arrays, read into the core's model with every shape checked.
//!
//! The keys are the fields of the data classes in `dressform/model.py`. A message names the
//! garment or character, the field and the element.

use std::collections::BTreeMap;

use dressform::model::{
    AuthoredSeam, BlendShape, Character, Collider, Fabric, Garment, GarmentSource, Outfit, Panel, Role,
    SeamGroups, Skeleton, Skin, TriMesh, Vec2, Vec3,
};
use numpy::{AllowTypeChange, PyArrayDescrMethods, PyArrayLikeDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;

/// A dictionary with the name that messages call it by.
struct Record<'a, 'py> {
    of: String,
    dict: &'a Bound<'py, PyDict>,
}

impl<'py> Record<'_, 'py> {
    fn item(&self, key: &str) -> PyResult<Bound<'py, PyAny>> {
        self.dict.get_item(key)?.ok_or_else(|| errors::input(format!("{}: no '{key}'", self.of)))
    }

    fn get<T: FromPyObjectOwned<'py>>(&self, key: &str) -> PyResult<T> {
        let item = self.item(key)?;
        item.extract().map_err(|e| self.wrong(key, &Into::<PyErr>::into(e).to_string()))
    }

    fn wrong(&self, key: &str, what: &str) -> PyErr {
        errors::input(format!("{}: '{key}': {what}", self.of))
    }

    fn dicts(&self, key: &str) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.get(key)
    }

    /// Finite numbers of shape `[n, tail...]`, flat; also `n`.
    fn floats(&self, key: &str, tail: &[usize]) -> PyResult<(Vec<f64>, usize)> {
        let array: PyArrayLikeDyn<'py, f64, AllowTypeChange> =
            self.item(key)?.extract().map_err(|e: PyErr| self.wrong(key, &e.to_string()))?;
        let rows = self.rows(key, array.shape(), tail)?;
        let values: Vec<f64> = array.as_array().iter().copied().collect();
        let width: usize = tail.iter().product();
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.wrong(key, &format!("element {} is not a finite number", i / width.max(1)))),
            None => Ok((values, rows)),
        }
    }

    /// Whole numbers of shape `[n, tail...]`, flat.
    fn integers<T: TryFrom<i64>>(&self, key: &str, tail: &[usize]) -> PyResult<Vec<T>> {
        let item = self.item(key)?;
        if let Ok(array) = item.cast::<PyUntypedArray>() {
            let kind = array.dtype().kind();
            if !array.is_empty() && !matches!(kind, b'i' | b'u') {
                return Err(self.wrong(key, "whole numbers expected"));
            }
        }
        let array: PyArrayLikeDyn<'py, i64, AllowTypeChange> =
            item.extract().map_err(|e: PyErr| self.wrong(key, &e.to_string()))?;
        if !array.is_empty() {
            self.rows(key, array.shape(), tail)?;
        }
        let width: usize = tail.iter().product::<usize>().max(1);
        let convert = |(i, &v): (usize, &i64)| {
            T::try_from(v)
                .map_err(|_| self.wrong(key, &format!("element {}: {v} is out of range", i / width)))
        };
        array.as_array().iter().enumerate().map(convert).collect()
    }

    fn rows(&self, key: &str, shape: &[usize], tail: &[usize]) -> PyResult<usize> {
        if shape.len() == tail.len() + 1 && shape[1..] == *tail {
            return Ok(shape[0]);
        }
        let tail: String = tail.iter().map(|n| format!(", {n}")).collect();
        Err(self.wrong(key, &format!("has shape {shape:?}, [n{tail}] expected")))
    }

    fn points(&self) -> PyResult<Vec<Vec3>> {
        let (values, _) = self.floats("points", &[3])?;
        Ok(values.chunks_exact(3).map(Vec3::from_row_slice).collect())
    }

    /// Points and triangles; every index is checked.
    fn mesh(&self) -> PyResult<TriMesh> {
        let points = self.points()?;
        let flat: Vec<u32> = self.integers("triangles", &[3])?;
        if let Some(i) = flat.iter().position(|&p| p as usize >= points.len()) {
            let what = format!("element {}: point {}, but there are only {}", i / 3, flat[i], points.len());
            return Err(self.wrong("triangles", &what));
        }
        let triangles = flat.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        Ok(TriMesh { points, triangles })
    }
}

/// An outfit from `{"garments": [...], "bodies": [...]}`.
pub fn outfit(dict: &Bound<'_, PyDict>) -> PyResult<Outfit> {
    let record = Record { of: "outfit".to_owned(), dict };
    let bodies = record.dicts("bodies")?.iter().map(character).collect::<PyResult<Vec<_>>>()?;
    let mut garments = Vec::new();
    for dict in &record.dicts("garments")? {
        let source = garment(dict)?;
        if source.body >= bodies.len() {
            let what = format!("names body {}, but there are only {}", source.body, bodies.len());
            return Err(errors::input(format!("{}: {what}", source.path)));
        }
        garments.push(Garment::from_source(source).map_err(errors::source)?);
    }
    if garments.is_empty() {
        return Err(errors::input("the outfit has no garment"));
    }
    Ok(Outfit { garments, bodies })
}

/// A garment from the fields of `dressform.model.GarmentSource`.
pub fn garment(dict: &Bound<'_, PyDict>) -> PyResult<GarmentSource> {
    let nameless = Record { of: "garment".to_owned(), dict };
    let (name, path): (String, String) = (nameless.get("name")?, nameless.get("path")?);
    let record = Record { of: path.clone(), dict };
    let mesh = record.mesh()?;
    let (corners, _) = record.floats("corner_pattern", &[3, 2])?;
    let corner_pattern = corners
        .chunks_exact(6)
        .map(|c| [Vec2::new(c[0], c[1]), Vec2::new(c[2], c[3]), Vec2::new(c[4], c[5])])
        .collect();
    Ok(GarmentSource {
        name,
        layer: record.get("layer")?,
        body: record.get("body")?,
        mesh,
        corner_pattern,
        panel_of_triangle: record.integers("panel_of_triangle", &[])?,
        panels: record.dicts("panels")?.iter().map(|d| panel(&path, d)).collect::<PyResult<_>>()?,
        seams: record.dicts("seams")?.iter().map(|d| seam(&path, d)).collect::<PyResult<_>>()?,
        joints: record.get("joints")?,
        path,
    })
}

fn panel(garment: &str, dict: &Bound<'_, PyDict>) -> PyResult<Panel> {
    let record = Record { of: format!("{garment}: panel"), dict };
    let name: String = record.get("name")?;
    let fabric_dict: Bound<'_, PyDict> = record.get("fabric")?;
    let fabric = fabric(&Record { of: format!("{garment}: fabric of panel {name}"), dict: &fabric_dict })?;
    let role = match record.get::<String>("role")?.as_str() {
        "auto" => Role::Auto,
        "shell" => Role::Shell,
        "detail" => Role::Detail,
        other => return Err(record.wrong("role", &format!("'{other}' is no role of a panel"))),
    };
    Ok(Panel { name, label: record.get("label")?, role, fabric })
}

/// A preset by name with single values put over it.
fn fabric(record: &Record<'_, '_>) -> PyResult<Fabric> {
    let preset: String = record.get("preset")?;
    let mut fabric =
        Fabric::preset(&preset).ok_or_else(|| record.wrong("preset", &format!("no '{preset}'")))?;
    fabric.name = record.get("name")?;
    let values: BTreeMap<String, f64> = record.get("values")?;
    for (key, value) in values {
        let field = match key.as_str() {
            "density" => &mut fabric.density,
            "stretch_warp" => &mut fabric.stretch_warp,
            "stretch_weft" => &mut fabric.stretch_weft,
            "shear" => &mut fabric.shear,
            "bending_warp" => &mut fabric.bending_warp,
            "bending_weft" => &mut fabric.bending_weft,
            "bending_shear" => &mut fabric.bending_shear,
            "friction" => &mut fabric.friction,
            "thickness" => &mut fabric.thickness,
            _ => return Err(record.wrong("values", &format!("'{key}' is no property of a fabric"))),
        };
        if !value.is_finite() || value < 0.0 {
            return Err(record.wrong(&key, &format!("{value} is no finite, positive number")));
        }
        *field = value;
    }
    Ok(fabric)
}

fn seam(garment: &str, dict: &Bound<'_, PyDict>) -> PyResult<AuthoredSeam> {
    let record = Record { of: format!("{garment}: seam"), dict };
    let name: String = record.get("name")?;
    let record = Record { of: format!("{garment}: seam {name}"), dict };
    let flat: Vec<u32> = record.integers("pairs", &[2])?;
    let pairs = flat.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    Ok(AuthoredSeam { name, pairs, offset: record.get("offset")? })
}

/// A sewn mesh from `{"points": ..., "triangles": ..., "seams": pairs of points}`.
pub fn sewn(dict: &Bound<'_, PyDict>) -> PyResult<(Vec<Vec3>, Vec<[u32; 3]>, SeamGroups)> {
    let record = Record { of: "cloth".to_owned(), dict };
    let mesh = record.mesh()?;
    let flat: Vec<u32> = record.integers("seams", &[2])?;
    if let Some(i) = flat.iter().position(|&p| p as usize >= mesh.points.len()) {
        let what = format!("element {}: point {}, but there are only {}", i / 2, flat[i], mesh.points.len());
        return Err(record.wrong("seams", &what));
    }
    let ties: Vec<[u32; 2]> = flat.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let groups = SeamGroups::new(mesh.points.len(), &ties, &[]);
    Ok((mesh.points, mesh.triangles, groups))
}

/// A mesh from `{"points": ..., "triangles": ...}`; messages call it `name`.
pub fn mesh(name: &str, dict: &Bound<'_, PyDict>) -> PyResult<TriMesh> {
    Record { of: name.to_owned(), dict }.mesh()
}

/// Points from `{"points": ...}`; messages call them `name`.
pub fn points(name: &str, dict: &Bound<'_, PyDict>) -> PyResult<Vec<Vec3>> {
    Record { of: name.to_owned(), dict }.points()
}

/// Where a garment starts and what it is draped over.
pub struct Scene {
    /// Vertices [m].
    pub points: Vec<Vec3>,
    /// Their panel coordinates [m].
    pub pattern: Vec<Vec2>,
    /// Solids.
    pub colliders: Vec<TriMesh>,
    /// Finished garments.
    pub layers: Vec<TriMesh>,
    /// Vertices that do not move.
    pub pinned: Vec<u32>,
}

/// The scene of a garment from the arguments of `dressform.native.drape_arrays`.
pub fn scene(garment: &Garment, dict: &Bound<'_, PyDict>) -> PyResult<Scene> {
    let record = Record { of: garment.path.clone(), dict };
    let points = record.points()?;
    if points.len() != garment.point_count {
        let what = format!("has {} points, but the garment {}", points.len(), garment.point_count);
        return Err(record.wrong("points", &what));
    }
    let mut pattern = garment.pattern.clone();
    if !record.item("corner_pattern")?.is_none() {
        let (corners, rows) = record.floats("corner_pattern", &[3, 2])?;
        if rows != garment.triangles.len() {
            let what = format!("has {rows} triangles, but the garment {}", garment.triangles.len());
            return Err(record.wrong("corner_pattern", &what));
        }
        for (vertex, corner) in garment.triangles.iter().flatten().zip(corners.chunks_exact(2)) {
            pattern[*vertex as usize] = Vec2::new(corner[0], corner[1]);
        }
    }
    let held: Vec<u32> = record.integers("pinned", &[])?;
    if let Some(i) = held.iter().position(|&p| p as usize >= garment.point_count) {
        return Err(record.wrong("pinned", &format!("element {i}: there is no point {}", held[i])));
    }
    let pinned = (0..garment.points.len() as u32)
        .filter(|&v| held.contains(&garment.point_of_vertex[v as usize]))
        .collect();
    let meshes = |key: &str| {
        let mesh = |d: &Bound<'_, PyDict>| Record { of: format!("{}: {key}", garment.path), dict: d }.mesh();
        record.dicts(key)?.iter().map(mesh).collect::<PyResult<Vec<_>>>()
    };
    let (colliders, layers) = (meshes("colliders")?, meshes("layers")?);
    let points = garment.point_of_vertex.iter().map(|&p| points[p as usize]).collect();
    Ok(Scene { points, pattern, colliders, layers, pinned })
}

/// A character from the fields of `dressform.model.Character`.
pub fn character(dict: &Bound<'_, PyDict>) -> PyResult<Character> {
    let nameless = Record { of: "character".to_owned(), dict };
    let (name, path): (String, String) = (nameless.get("name")?, nameless.get("path")?);
    let record = Record { of: format!("{name}: {path}"), dict };
    let body = record.mesh()?;
    let skeleton = skeleton(&record)?;
    let skin = skin(&record, body.points.len(), skeleton.joints.len())?;
    let collider = |d: &Bound<'_, PyDict>| {
        let nameless = Record { of: format!("{name}: collider"), dict: d };
        let path: String = nameless.get("path")?;
        let mesh = Record { of: format!("{name}: {path}"), dict: d }.mesh()?;
        Ok(Collider { path, mesh })
    };
    let colliders = record.dicts("colliders")?.iter().map(collider).collect::<PyResult<_>>()?;
    let shapes = record.dicts("blend_shapes")?;
    let blend_shapes =
        shapes.iter().map(|d| blend_shape(&record.of, d, body.points.len())).collect::<PyResult<_>>()?;
    Ok(Character { name, path, body, skeleton, skin, colliders, blend_shapes })
}

fn blend_shape(of: &str, dict: &Bound<'_, PyDict>, points: usize) -> PyResult<BlendShape> {
    let nameless = Record { of: of.to_owned(), dict };
    let name: String = nameless.get("name")?;
    let record = Record { of: format!("{of}: blend shape {name}"), dict };
    let moved: Vec<u32> = record.integers("points", &[])?;
    let (flat, offsets) = record.floats("offsets", &[3])?;
    if offsets != moved.len() {
        return Err(record.wrong("offsets", &format!("has {offsets} elements for {} points", moved.len())));
    }
    if let Some(i) = moved.iter().position(|&p| p as usize >= points) {
        let what = format!("element {i}: point {}, but there are only {points}", moved[i]);
        return Err(record.wrong("points", &what));
    }
    let offsets = flat.chunks_exact(3).map(Vec3::from_row_slice).collect();
    Ok(BlendShape { name, points: moved, offsets })
}

/// A mesh with skin weights, as the posed check takes it.
pub fn skinned(dict: &Bound<'_, PyDict>, joints: usize) -> PyResult<(TriMesh, Skin)> {
    let record = Record { of: "garment".to_owned(), dict };
    let mesh = record.mesh()?;
    let skin = skin(&record, mesh.points.len(), joints)?;
    Ok((mesh, skin))
}

fn skeleton(record: &Record<'_, '_>) -> PyResult<Skeleton> {
    let joints: Vec<String> = record.get("joints")?;
    let parents: Vec<i32> = record.integers("joint_parents", &[])?;
    let (flat, matrices) = record.floats("world_from_joint", &[4, 4])?;
    for (key, found) in [("joint_parents", parents.len()), ("world_from_joint", matrices)] {
        if found != joints.len() {
            let what = format!("has {found} elements, but there are {} joints", joints.len());
            return Err(record.wrong(key, &what));
        }
    }
    if let Some(i) = parents.iter().position(|&p| p < -1 || p >= joints.len() as i32) {
        return Err(record.wrong("joint_parents", &format!("element {i}: no joint {}", parents[i])));
    }
    let matrix = |m: &[f64]| std::array::from_fn(|r| std::array::from_fn(|c| m[4 * r + c]));
    Ok(Skeleton { joints, parents, world_from_joint: flat.chunks_exact(16).map(matrix).collect() })
}

fn skin(record: &Record<'_, '_>, points: usize, joints: usize) -> PyResult<Skin> {
    let influences: usize = record.get("skin_influences")?;
    let joint_indices: Vec<u32> = record.integers("joint_indices", &[])?;
    let (joint_weights, weights) = record.floats("joint_weights", &[])?;
    for (key, found) in [("joint_indices", joint_indices.len()), ("joint_weights", weights)] {
        if Some(found) != points.checked_mul(influences) {
            let what = format!("has {found} elements; {points} points have {influences} influences each");
            return Err(record.wrong(key, &what));
        }
    }
    if let Some(i) = joint_indices.iter().position(|&j| j as usize >= joints) {
        let what = format!("element {i}: joint {}, but there are only {joints}", joint_indices[i]);
        return Err(record.wrong("joint_indices", &what));
    }
    Ok(Skin { influences, joint_indices, joint_weights })
}
