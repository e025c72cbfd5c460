//! Skin weights alone: a prepared body, a sewn mesh, weights.

use std::sync::Arc;

use dressform::geometry::OuterSkin;
use dressform::model::{Character, SeamGroups, Skin, Vec3};
use dressform::pipeline::Settings;
use dressform::pose;
use dressform::rig::{self as core, Sewn};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, job, read};

/// A character and the hierarchy over its outer skin: made once, used for many garments.
#[pyclass(frozen)]
pub struct PreparedBody {
    character: Arc<Character>,
    skin: Arc<OuterSkin>,
}

#[pymethods]
impl PreparedBody {
    #[new]
    fn new(py: Python<'_>, character: &Bound<'_, PyDict>) -> PyResult<Self> {
        let character = Arc::new(read::character(character)?);
        let body = Arc::clone(&character);
        let skin = job::run(py, None, move |_| Ok(OuterSkin::new(&body.body)))?;
        Ok(PreparedBody { character, skin: Arc::new(skin) })
    }
}

/// Skin weights of a sewn mesh; see `dressform.rigging.rig_arrays`.
#[pyfunction]
pub fn rig<'py>(
    py: Python<'py>,
    body: &PreparedBody,
    cloth: &Bound<'py, PyDict>,
    settings_json: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let (skin, info) = with(py, body, cloth, settings_json, refined)?;
    let dict = PyDict::new(py);
    dict.set_item("influences", skin.influences)?;
    dict.set_item("joint_indices", skin.joint_indices.into_pyarray(py))?;
    dict.set_item("joint_weights", skin.joint_weights.into_pyarray(py))?;
    let report = serde_json::to_string(&info).map_err(|e| errors::internal(e.to_string()))?;
    dict.set_item("report", report)?;
    Ok(dict)
}

/// Weights, refined against the poses that the skeleton allows; none, if it is no tree.
fn refined(
    character: &Character,
    body: &OuterSkin,
    sewn: &Sewn<'_>,
    params: &core::Params,
) -> Result<(Skin, core::Info), core::Error> {
    let (mut skin, mut info) = core::run_sewn(character, body, sewn, params)?;
    let poses = pose::poses(&character.skeleton).map_or_else(|_| Vec::new(), |set| set.poses);
    let worn = core::refine::Worn { sewn: *sewn, skin: &mut skin, info: &mut info };
    core::refine::run(character, body, &mut [worn], &poses, params)?;
    Ok((skin, info))
}

/// The body points that a sewn mesh is matched to; see `dressform.rigging.match_arrays`.
#[pyfunction]
pub fn rig_matches<'py>(
    py: Python<'py>,
    body: &PreparedBody,
    cloth: &Bound<'py, PyDict>,
    settings_json: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let matches = with(py, body, cloth, settings_json, core::matches)?;
    let dict = PyDict::new(py);
    let none = [f64::NAN; 3];
    let points: Vec<f64> = matches.iter().flat_map(|m| m.map_or(none, |p| p.into())).collect();
    dict.set_item("matched", matches.iter().map(Option::is_some).collect::<Vec<_>>().into_pyarray(py))?;
    dict.set_item("points", points.into_pyarray(py).reshape([matches.len(), 3])?)?;
    Ok(dict)
}

/// Reads the mesh and calls a function of the core without the interpreter.
fn with<T: Send + 'static>(
    py: Python<'_>,
    body: &PreparedBody,
    cloth: &Bound<'_, PyDict>,
    settings_json: &str,
    call: fn(&Character, &OuterSkin, &Sewn<'_>, &core::Params) -> Result<T, core::Error>,
) -> PyResult<T> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    let (points, triangles, groups): (Vec<Vec3>, _, SeamGroups) = read::sewn(cloth)?;
    let (character, skin) = (Arc::clone(&body.character), Arc::clone(&body.skin));
    job::run(py, None, move |_| {
        let sewn = Sewn { points: &points, triangles: &triangles, groups: &groups, joints: &[] };
        call(&character, &skin, &sewn, &settings.rig).map_err(errors::rig)
    })
}
