//! `refit`: the pattern stage alone, and the landmarks of a body.

use std::time::Instant;

use dressform::measure::Landmarks;
use dressform::model::{Garment, Vec3};
use dressform::pipeline::Settings;
use dressform::proxy::Proxy;
use numpy::{AllowTypeChange, IntoPyArray, PyArrayLikeDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, read};

/// Refits a garment's pattern to points on another body; see `dressform.native.refit_arrays`.
#[pyfunction]
pub fn refit<'py>(
    py: Python<'py>,
    garment: &Bound<'py, PyDict>,
    points: PyArrayLikeDyn<'py, f64, AllowTypeChange>,
    settings_json: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    let garment = Garment::from_source(read::garment(garment)?).map_err(errors::source)?;
    let shape = points.as_array();
    if shape.shape() != [garment.point_count, 3] {
        let (found, expected) = (shape.shape(), garment.point_count);
        let what = format!("points have shape {found:?}, [{expected}, 3] expected");
        return Err(errors::input(format!("{}: {what}", garment.path)));
    }
    let values: Vec<f64> = shape.iter().copied().collect();
    let at = |&p: &u32| Vec3::from_row_slice(&values[3 * p as usize..][..3]);
    let target: Vec<Vec3> = garment.point_of_vertex.iter().map(at).collect();
    let (pattern, info, seconds) = py.detach(|| {
        let proxy = Proxy::new(&garment, &settings.proxy).map_err(errors::proxy)?;
        let target = proxy.gather(&target);
        let clock = Instant::now();
        let (pattern, info) = proxy.refit(&target, &settings.pattern, None).map_err(errors::pattern)?;
        Ok::<_, PyErr>((pattern, info, clock.elapsed().as_secs_f64()))
    })?;
    let dict = PyDict::new(py);
    let corners = garment.triangles.iter().flatten().map(|&v| pattern[v as usize]);
    let corners: Vec<f64> = corners.flat_map(|p| [p.x, p.y]).collect();
    dict.set_item("corner_pattern", corners.into_pyarray(py).reshape([garment.triangles.len(), 3, 2])?)?;
    dict.set_item("report", serde_json::to_string(&info).map_err(|e| errors::internal(e.to_string()))?)?;
    dict.set_item("seconds", seconds)?;
    Ok(dict)
}

/// The girths of a body [m], and those that were not found; see `dressform.native.body_girths`.
#[pyfunction]
pub fn body_girths<'py>(py: Python<'py>, character: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let character = read::character(character)?;
    let landmarks = py.detach(|| Landmarks::find(&character));
    let dict = PyDict::new(py);
    for landmark in &landmarks.found {
        let side = landmark.side.map_or(String::new(), |side| format!("_{side:?}").to_lowercase());
        let one = PyDict::new(py);
        one.set_item("girth_m", landmark.body_m)?;
        one.set_item("origin", <[f64; 3]>::from(landmark.centre))?;
        one.set_item("normal", <[f64; 3]>::from(landmark.plane.normal))?;
        dict.set_item(format!("{}{side}", landmark.girth.name()), one)?;
    }
    for (girth, why) in &landmarks.missing {
        dict.set_item(girth.name(), *why)?;
    }
    Ok(dict)
}
