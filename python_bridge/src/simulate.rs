//! `simulate`: a dressed outfit on a body in motion.

use dressform::device::{Device, DeviceChoice};
use dressform::model::Vec3;
use dressform::pipeline::{self, Motion, Settings, Simulated};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, job, read};

/// Simulates an outfit on a body whose points `body` [m] have the shape `[frames, points, 3]`;
/// see `dressform.native.simulate_arrays`.
#[pyfunction]
#[pyo3(signature = (outfit, character, body, seconds_per_frame, settings_json, device, progress=None))]
#[expect(clippy::too_many_arguments, reason = "the signature that Python sees")]
pub fn simulate<'py>(
    py: Python<'py>,
    outfit: &Bound<'py, PyDict>,
    character: &Bound<'py, PyDict>,
    body: PyReadonlyArray3<'py, f64>,
    seconds_per_frame: f64,
    settings_json: &str,
    device: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    if !(seconds_per_frame.is_finite() && seconds_per_frame > 0.0) {
        return Err(errors::input(format!("a frame takes {seconds_per_frame} s")));
    }
    let outfit = read::outfit(outfit)?;
    let character = read::character(character)?;
    let motion = Motion { body: frames(&body)?, seconds_per_frame };
    let Ok(choice) = device.parse::<DeviceChoice>();
    let simulated = job::run(py, progress, move |report| {
        let device = Device::open(&choice).map_err(errors::device)?;
        pipeline::simulate(&outfit, &character, &motion, &settings, &device, report).map_err(errors::pipeline)
    })?;
    simulated_dict(py, simulated)
}

fn frames(body: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<Vec<Vec3>>> {
    let body = body.as_array();
    if body.shape()[2] != 3 {
        return Err(errors::input(format!("body: shape {:?}, not [frames, points, 3]", body.shape())));
    }
    if let Some(i) = body.iter().position(|c| !c.is_finite()) {
        let frame = i / (body.shape()[1] * 3).max(1);
        return Err(errors::input(format!("body: frame {frame} has a number that is not finite")));
    }
    let point = |row: numpy::ndarray::ArrayView1<'_, f64>| Vec3::new(row[0], row[1], row[2]);
    Ok(body.outer_iter().map(|frame| frame.outer_iter().map(point).collect()).collect())
}

fn simulated_dict(py: Python<'_>, simulated: Simulated) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    let mut garments = Vec::new();
    for garment in &simulated.garments {
        let points = garment.frames.first().map_or(0, Vec::len);
        let flat: Vec<f32> =
            garment.frames.iter().flatten().flat_map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        garments.push(flat.into_pyarray(py).reshape([garment.frames.len(), points, 3])?);
    }
    dict.set_item("frames", garments)?;
    dict.set_item("device", job::device_dict(py, &simulated.device)?)?;
    let report = serde_json::to_string(&simulated.reports).map_err(|e| errors::internal(e.to_string()))?;
    dict.set_item("garments", report)?;
    Ok(dict)
}
