//! Python bindings of the dressform core: the module `dressform._native`.
//!
//! The core knows no Python. This crate checks shapes ([`read`]), runs the core without the
//! interpreter ([`job`]) and maps every typed error to a Python exception ([`errors`]).
//! Nothing else lives here.

use pyo3::prelude::*;

mod errors;
mod job;
mod read;

/// Rust core of dressform. Use the package `dressform`, not this module.
#[pymodule]
mod _native {
    use dressform::device::{Device, DeviceChoice};
    use pyo3::prelude::*;
    use pyo3::types::PyDict;

    use crate::{errors, job, read};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        job::quiet_panics();
        module.add("version", env!("CARGO_PKG_VERSION"))
    }

    /// Device names that `--device` takes here: a list of `{"kind", "name"}`.
    #[pyfunction]
    fn devices(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
        let infos = py.detach(job::devices);
        infos.iter().map(|info| job::device_dict(py, info)).collect()
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

    /// Reads and checks a character as `fit` would.
    #[pyfunction]
    fn inspect_character(character: &Bound<'_, PyDict>) -> PyResult<()> {
        read::character(character).map(drop)
    }
}
