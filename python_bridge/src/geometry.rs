//! Questions about a surface, for checks against outside judges and for tools.

use dressform::geometry::sdf::Sdf;
use dressform::geometry::{OuterSkin, Surface, intersect};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, fit, read};

/// Hierarchical winding numbers of a mesh around points; see `dressform.native.winding_numbers`.
#[pyfunction]
pub fn winding_numbers<'py>(
    py: Python<'py>,
    mesh: &Bound<'py, PyDict>,
    queries: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    let (mesh, queries) = (read::mesh("mesh", mesh)?, read::points("queries", queries)?);
    let numbers: Vec<f64> = py.detach(|| {
        let surface = Surface::new(mesh);
        queries.iter().map(|q| surface.winding_number(q)).collect()
    });
    Ok(numbers.into_pyarray(py).into_any())
}

/// Signed distances of a narrow-band grid; see `dressform.native.grid_distances`.
#[pyfunction]
pub fn grid_distances<'py>(
    py: Python<'py>,
    mesh: &Bound<'py, PyDict>,
    queries: &Bound<'py, PyDict>,
    threshold: f64,
    spacing: f64,
    band: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let (mesh, queries) = (read::mesh("mesh", mesh)?, read::points("queries", queries)?);
    let values = py.detach(|| {
        let sdf = Sdf::new(&Surface::new(mesh), threshold, spacing, band)?;
        Ok(queries.iter().map(|q| sdf.sample(q).map_or(f64::NAN, |s| s.0)).collect::<Vec<f64>>())
    });
    let values = values.map_err(|e: dressform::geometry::sdf::SdfError| errors::input(e.to_string()))?;
    Ok(values.into_pyarray(py).into_any())
}

/// The part of a body that something outside can touch, as points and triangles; see
/// `dressform.native.outer_skin`.
#[pyfunction]
pub fn outer_skin<'py>(py: Python<'py>, mesh: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let mesh = read::mesh("mesh", mesh)?;
    let skin = py.detach(|| OuterSkin::new(&mesh));
    let triangles: Vec<u32> = skin.surface.mesh().triangles.iter().flatten().copied().collect();
    let dict = PyDict::new(py);
    dict.set_item("points", fit::points(py, &skin.surface.mesh().points)?)?;
    let count = triangles.len() / 3;
    dict.set_item("triangles", triangles.into_pyarray(py).reshape([count, 3])?)?;
    Ok(dict)
}

/// Pairs of triangles that intersect, of two meshes or (without `other`) of one with itself; see
/// `dressform.native.intersections`.
#[pyfunction]
#[pyo3(signature = (mesh, other=None))]
pub fn intersections<'py>(
    py: Python<'py>,
    mesh: &Bound<'py, PyDict>,
    other: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let (mesh, other) = (read::mesh("mesh", mesh)?, other.map(|o| read::mesh("other", o)).transpose()?);
    let pairs = py.detach(|| {
        let surface = Surface::new(mesh);
        match other {
            Some(other) => intersect::mesh_intersections(&surface, &Surface::new(other)),
            None => intersect::self_intersections(&surface),
        }
    });
    let count = pairs.len();
    let flat: Vec<u32> = pairs.into_iter().flatten().collect();
    Ok(flat.into_pyarray(py).reshape([count, 2])?.into_any())
}
