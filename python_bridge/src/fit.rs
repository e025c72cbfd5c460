//! `fit`: from dictionaries to dictionaries.

use std::path::PathBuf;
use std::sync::LazyLock;

use dressform::device::{Device, DeviceChoice};
use dressform::model::{Vec2, Vec3};
use dressform::pipeline::{self, Dressed, DressedGarment, GarmentReport, Settings};
use dressform::transfer::Cache;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, job, read};

/// The settings' defaults, as JSON.
#[pyfunction]
pub fn default_settings_json() -> PyResult<String> {
    serde_json::to_string(&Settings::default()).map_err(|e| errors::internal(e.to_string()))
}

/// Flows between bodies that this process has solved.
static CACHE: LazyLock<Cache> = LazyLock::new(Cache::default);

/// Fits an outfit to a character; see `dressform.native.fit_arrays`.
#[pyfunction]
#[pyo3(signature = (outfit, character, settings_json, device, progress=None, cache=None))]
pub fn fit<'py>(
    py: Python<'py>,
    outfit: &Bound<'py, PyDict>,
    character: &Bound<'py, PyDict>,
    settings_json: &str,
    device: &str,
    progress: Option<&Bound<'py, PyAny>>,
    cache: Option<PathBuf>,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    let outfit = read::outfit(outfit)?;
    let character = read::character(character)?;
    let Ok(choice) = device.parse::<DeviceChoice>();
    let cache = cache.map_or_else(|| CACHE.clone(), |folder| CACHE.on_disk(folder));
    let dressed = job::run(py, progress, move |report| {
        let device = Device::open(&choice).map_err(errors::device)?;
        pipeline::fit(&outfit, &character, &settings, &device, &cache, report).map_err(errors::pipeline)
    })?;
    dressed_dict(py, dressed)
}

fn dressed_dict(py: Python<'_>, dressed: Dressed) -> PyResult<Bound<'_, PyDict>> {
    let json = |e: serde_json::Error| errors::internal(e.to_string());
    let mut garments = Vec::new();
    for (garment, report) in dressed.garments.into_iter().zip(&dressed.report.garments) {
        garments.push(garment_dict(py, garment, report)?);
    }
    let dict = PyDict::new(py);
    dict.set_item("garments", garments)?;
    dict.set_item("report", serde_json::to_string(&dressed.report).map_err(json)?)?;
    Ok(dict)
}

fn garment_dict<'py>(
    py: Python<'py>,
    garment: DressedGarment,
    report: &GarmentReport,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("points", points(py, &garment.points)?)?;
    dict.set_item("vertex_points", points(py, &garment.vertex_points)?)?;
    let flat = |p: &Vec2| [p.x, p.y];
    let pattern: Vec<f64> = garment.pattern.iter().flat_map(flat).collect();
    dict.set_item("pattern", pattern.into_pyarray(py).reshape([garment.pattern.len(), 2])?)?;
    let corners: Vec<f64> = garment.corner_pattern.iter().flatten().flat_map(flat).collect();
    dict.set_item("corner_pattern", corners.into_pyarray(py).reshape([garment.corner_pattern.len(), 3, 2])?)?;
    dict.set_item("influences", garment.skin.influences)?;
    dict.set_item("joint_indices", garment.skin.joint_indices.into_pyarray(py))?;
    dict.set_item("joint_weights", garment.skin.joint_weights.into_pyarray(py))?;
    let shapes = garment.blend_shapes.into_iter().map(|shape| {
        let dict = PyDict::new(py);
        dict.set_item("name", shape.name)?;
        dict.set_item("points", shape.points.into_pyarray(py))?;
        dict.set_item("offsets", points(py, &shape.offsets)?)?;
        Ok(dict)
    });
    dict.set_item("blend_shapes", shapes.collect::<PyResult<Vec<_>>>()?)?;
    let report = serde_json::to_string(report).map_err(|e| errors::internal(e.to_string()))?;
    dict.set_item("report", report)?;
    Ok(dict)
}

/// An array of shape `[points, 3]`.
pub fn points<'py>(py: Python<'py>, points: &[Vec3]) -> PyResult<Bound<'py, PyAny>> {
    let flat: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    Ok(flat.into_pyarray(py).reshape([points.len(), 3])?.into_any())
}
