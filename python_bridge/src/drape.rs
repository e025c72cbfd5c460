//! `drape`: one garment over given surfaces, arrays in and out.

use dressform::device::{Device, DeviceChoice};
use dressform::drape as stage;
use dressform::geometry::Surface;
use dressform::model::Garment;
use dressform::pipeline::Settings;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, fit, job, read};

/// Drapes a garment; see `dressform.native.drape_arrays`.
///
/// `scene` holds the garment's start (`points`), its panels (`corner_pattern`, or nothing for
/// those of the garment), `pinned` points, and meshes: `colliders` and `layers`.
#[pyfunction]
#[pyo3(signature = (garment, scene, settings_json, device, progress=None))]
pub fn drape<'py>(
    py: Python<'py>,
    garment: &Bound<'py, PyDict>,
    scene: &Bound<'py, PyDict>,
    settings_json: &str,
    device: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    let garment = Garment::from_source(read::garment(garment)?).map_err(errors::source)?;
    let scene = read::scene(&garment, scene)?;
    let Ok(choice) = device.parse::<DeviceChoice>();
    let (points, info) = job::run(py, progress, move |report| {
        let device = Device::open(&choice).map_err(errors::device)?;
        let surfaces = |meshes: Vec<_>| meshes.into_iter().map(Surface::new).collect::<Vec<_>>();
        let (colliders, layers) = (surfaces(scene.colliders), surfaces(scene.layers));
        let input = stage::Input {
            garment: &garment,
            points: &scene.points,
            pattern: &scene.pattern,
            colliders: &colliders.iter().collect::<Vec<_>>(),
            layers: &layers.iter().collect::<Vec<_>>(),
            pinned: &scene.pinned,
            held: &[],
        };
        let mut report = |moment: &stage::Moment<'_>| report("drape", moment.share);
        let output =
            stage::run_with_progress(&device, &input, &settings.drape, &mut report).map_err(errors::drape)?;
        Ok((garment.scatter_points(&output.points), output.info))
    })?;
    let dict = PyDict::new(py);
    dict.set_item("points", fit::points(py, &points)?)?;
    dict.set_item("info", serde_json::to_string(&info).map_err(|e| errors::internal(e.to_string()))?)?;
    Ok(dict)
}
