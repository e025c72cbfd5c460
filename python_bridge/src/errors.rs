//! Every typed error of the core as a Python exception; the classes stand in
//! `dressform/errors.py`, each with the exit code of the command line.

use dressform::device::DeviceError;
use dressform::model::SourceError;
use dressform::{drape, pattern, pipeline, proxy, rig, transfer};
use pyo3::PyErr;

mod class {
    //! The Python classes.
    #![allow(missing_docs, reason = "the macro's types; documented in errors.py")]
    pyo3::import_exception!(dressform.errors, BadInput);
    pyo3::import_exception!(dressform.errors, BadSettings);
    pyo3::import_exception!(dressform.errors, NoDevice);
    pyo3::import_exception!(dressform.errors, InternalFault);
}

/// The caller's arrays or files are wrong.
pub fn input(message: impl Into<String>) -> PyErr {
    class::BadInput::new_err(message.into())
}

/// The settings are wrong.
pub fn settings(error: &serde_json::Error) -> PyErr {
    class::BadSettings::new_err(error.to_string())
}

/// A fault of ours.
pub fn internal(message: impl Into<String>) -> PyErr {
    class::InternalFault::new_err(message.into())
}

/// A garment whose arrays do not fit together.
pub fn source(error: SourceError) -> PyErr {
    input(error.to_string())
}

/// The device refused or failed; a wrong binding or shader is a fault of ours.
pub fn device(error: DeviceError) -> PyErr {
    let message = error.to_string();
    match error {
        DeviceError::NoAdapter { .. }
        | DeviceError::Refused { .. }
        | DeviceError::Lost(_)
        | DeviceError::OutOfMemory(_)
        | DeviceError::TooLarge { .. } => class::NoDevice::new_err(message),
        _ => internal(message), // a wrong call of ours
    }
}

/// A garment without a proxy.
pub fn proxy(error: proxy::Error) -> PyErr {
    let message = error.to_string();
    match error {
        proxy::Error::Setting { .. } => class::BadSettings::new_err(message),
        _ => input(message),
    }
}

/// A sewn mesh that could not be rigged.
pub fn rig(error: rig::Error) -> PyErr {
    let message = error.to_string();
    match error {
        rig::Error::Setting { .. } => class::BadSettings::new_err(message),
        rig::Error::Solve(_) => internal(message),
        _ => input(message),
    }
}

/// A pattern that could not be refitted.
pub fn pattern(error: pattern::Error) -> PyErr {
    let message = error.to_string();
    match error {
        pattern::Error::Setting { .. } => class::BadSettings::new_err(message),
        pattern::Error::Solve(_) => internal(message),
        _ => input(message),
    }
}

/// A garment that could not be draped.
pub fn drape(error: drape::Error) -> PyErr {
    match error {
        drape::Error::Device(e) => device(e),
        drape::Error::Setting { .. } => class::BadSettings::new_err(error.to_string()),
        _ => input(error.to_string()),
    }
}

/// A fit that could not be made: the device, the settings or the input; numerics that failed on
/// input which passed every check are a fault of ours.
pub fn pipeline(error: pipeline::Error) -> PyErr {
    let message = error.to_string();
    match error {
        pipeline::Error::Transfer(transfer::Error::Device(e)) => device(e),
        pipeline::Error::Drape { error: drape::Error::Device(e), .. } => device(e),
        pipeline::Error::Proxy(e) => proxy(e),
        pipeline::Error::UnknownPose(_) => class::BadSettings::new_err(message),
        pipeline::Error::Hold(_)
        | pipeline::Error::Transfer(transfer::Error::Setting { .. })
        | pipeline::Error::Pattern { error: pattern::Error::Setting { .. }, .. }
        | pipeline::Error::Drape { error: drape::Error::Setting { .. }, .. }
        | pipeline::Error::Rig { error: rig::Error::Setting { .. }, .. } => {
            class::BadSettings::new_err(message)
        }
        pipeline::Error::Pattern { error: pattern::Error::Solve(_), .. }
        | pipeline::Error::Rig { error: rig::Error::Solve(_), .. } => internal(message),
        _ => input(message),
    }
}
