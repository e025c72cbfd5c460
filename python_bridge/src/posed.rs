//! Poses of a character, and how skinned meshes follow it.

use dressform::certificate::posed;
use dressform::geometry::OuterSkin;
use dressform::geometry::skinning::Mat4;
use dressform::pipeline::Settings;
use dressform::pose::{self, Pose};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{errors, read};

/// Skinning matrices of every pose that the character's skeleton allows, shape `[joints, 4, 4]` each, by
/// the pose's name; see `dressform.native.poses`.
#[pyfunction]
pub fn poses<'py>(py: Python<'py>, character: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let character = read::character(character)?;
    let set = pose::poses(&character.skeleton).map_err(|e| errors::input(e.to_string()))?;
    let dict = PyDict::new(py);
    for pose in set.poses {
        let rows = pose.matrices.iter().flat_map(|m| m.transpose().as_slice().to_vec());
        let flat: Vec<f64> = rows.collect();
        dict.set_item(pose.name, flat.into_pyarray(py).reshape([pose.matrices.len(), 4, 4])?)?;
    }
    Ok(dict)
}

/// The posed check of skinned meshes, as JSON; see `dressform.native.posed_check`. Poses are skinning
/// matrices, shape `[joints, 4, 4]`, by name; without them those of the settings.
#[pyfunction]
#[pyo3(signature = (character, garments, settings_json, poses=None))]
pub fn posed_json(
    py: Python<'_>,
    character: &Bound<'_, PyDict>,
    garments: Vec<Bound<'_, PyDict>>,
    settings_json: &str,
    poses: Option<Vec<(String, PyReadonlyArray3<'_, f64>)>>,
) -> PyResult<String> {
    let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
    let character = read::character(character)?;
    let joints = character.skeleton.joints.len();
    let skinned = garments.iter().map(|d| read::skinned(d, joints)).collect::<PyResult<Vec<_>>>()?;
    let poses = match poses {
        Some(given) => given.iter().map(|(name, m)| given_pose(name, m, joints)).collect::<PyResult<_>>()?,
        None => {
            let set = pose::poses(&character.skeleton).map_err(|e| errors::input(e.to_string()))?;
            posed::chosen(&set, &settings.posed)
                .map_err(|name| errors::pipeline(dressform::pipeline::Error::UnknownPose(name)))?
        }
    };
    let figures = py.detach(|| {
        let cloths: Vec<posed::Cloth<'_>> =
            skinned.iter().map(|(mesh, skin)| posed::Cloth { mesh, skin }).collect();
        posed::measure(&character, &OuterSkin::new(&character.body), &cloths, &poses)
    });
    serde_json::to_string(&figures).map_err(|e| errors::internal(e.to_string()))
}

/// A pose of the caller's own.
fn given_pose(name: &str, matrices: &PyReadonlyArray3<'_, f64>, joints: usize) -> PyResult<Pose> {
    let array = matrices.as_array();
    if array.shape() != [joints, 4, 4] {
        let message = format!("pose '{name}': shape {:?}, [{joints}, 4, 4] expected", array.shape());
        return Err(errors::input(message));
    }
    if !array.iter().all(|x| x.is_finite()) {
        return Err(errors::input(format!("pose '{name}': a matrix is not finite")));
    }
    let matrix = |j: usize| Mat4::from_fn(|r, c| array[[j, r, c]]);
    Ok(Pose { name: name.to_owned(), matrices: (0..joints).map(matrix).collect() })
}
