//! Python bindings of the dressform core: the module `dressform._native`.
//!
//! The core knows no Python. This crate checks shapes ([`read`]), runs the core without the
//! interpreter ([`job`]) and maps every typed error to a Python exception ([`errors`]); [`fit`] and
//! [`rig`] put them together. Nothing else lives here.

use pyo3::prelude::*;

mod drape;
mod errors;
mod fit;
mod geometry;
mod job;
mod posed;
mod read;
mod refit;
mod rig;
mod simulate;

/// Rust core of dressform. Use the package `dressform`, not this module.
#[pymodule]
mod _native {
    use dressform::device::{Device, DeviceChoice};
    use dressform::model::Garment;
    use dressform::pipeline::Settings;
    use dressform::proxy::Proxy;
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    use crate::{errors, job, read};

    #[pymodule_export]
    use crate::drape::drape;

    #[pymodule_export]
    use crate::geometry::{grid_distances, intersections, outer_skin, winding_numbers};

    #[pymodule_export]
    use crate::fit::{default_settings_json, fit};
    #[pymodule_export]
    use crate::posed::{posed_json, poses};
    #[pymodule_export]
    use crate::refit::{body_girths, refit};
    #[pymodule_export]
    use crate::rig::{PreparedBody, rig, rig_matches};
    #[pymodule_export]
    use crate::simulate::simulate;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        job::quiet_panics();
        module.add("version", env!("CARGO_PKG_VERSION"))
    }

    /// What `--device` can name here: `cpu`, then adapters by a part of their name.
    #[pyfunction]
    fn devices(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
        let (cpu, adapters) = py.detach(|| (Device::cpu().info(), Device::list()));
        let mut found = vec![job::device_dict(py, &cpu)?];
        for adapter in &adapters {
            let dict = PyDict::new(py);
            dict.set_item("kind", adapter.kind)?;
            dict.set_item("name", &adapter.name)?;
            dict.set_item("driver", &adapter.driver)?;
            dict.set_item("usable", adapter.usable)?;
            dict.set_item("reason", &adapter.reason)?;
            found.push(dict);
        }
        Ok(found)
    }

    /// Opens a device by its name on the command line and says what it is.
    #[pyfunction]
    fn open_device<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let Ok(choice) = name.parse::<DeviceChoice>();
        let device = py.detach(|| Device::open(&choice)).map_err(errors::device)?;
        job::device_dict(py, &device.info())
    }

    /// Reads and checks an outfit as `fit` would; counts what it found, per garment.
    #[pyfunction]
    fn inspect_outfit<'py>(
        py: Python<'py>,
        outfit: &Bound<'py, PyDict>,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let outfit = read::outfit(outfit)?;
        outfit.garments.iter().map(|garment| job::garment_dict(py, garment)).collect()
    }

    /// Says, as JSON, which panels of a garment `fit` would leave out of its simulation and why.
    #[pyfunction]
    fn proxy_json(garment: &Bound<'_, PyDict>, settings_json: &str) -> PyResult<String> {
        let settings: Settings = serde_json::from_str(settings_json).map_err(|e| errors::settings(&e))?;
        let garment = Garment::from_source(read::garment(garment)?).map_err(errors::source)?;
        let proxy = Proxy::new(&garment, &settings.proxy).map_err(errors::proxy)?;
        serde_json::to_string(proxy.info()).map_err(|e| errors::internal(e.to_string()))
    }

    /// Reads and checks a character as `fit` would.
    #[pyfunction]
    fn inspect_character(character: &Bound<'_, PyDict>) -> PyResult<()> {
        read::character(character).map(drop)
    }
}
