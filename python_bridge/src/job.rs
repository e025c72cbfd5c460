//! Runs the core on a thread of its own while Python stays responsive.
//!
//! The calling thread waits without the interpreter. Every [`POLL`] it looks for Ctrl-C, and
//! hands the newest progress to Python's callback. When either raises, the exception returns at
//! once and the worker unwinds at its next report of progress (an unwinding without the panic
//! hook, as other engines cancel work), so nothing that it holds is leaked.

use std::panic::{self, AssertUnwindSafe};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use dressform::device::{DeviceInfo, on_worker};
use dressform::model::Garment;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;

/// How often Ctrl-C is looked for.
const POLL: Duration = Duration::from_millis(50);

/// Message and place of the last panic, for the exception that it becomes.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// Payload that unwinds a cancelled worker.
struct Cancelled;

/// Keeps panics off the terminal: they become `InternalFault`. With `RUST_BACKTRACE` set they
/// are printed as well.
pub fn quiet_panics() {
    let print = panic::take_hook();
    let verbose = std::env::var_os("RUST_BACKTRACE").is_some_and(|v| v != "0");
    panic::set_hook(Box::new(move |info| {
        if let Ok(mut last) = LAST_PANIC.lock() {
            *last = info.to_string();
        }
        if verbose {
            print(info);
        }
    }));
}

/// Runs `work` on a thread; `progress(stage, fraction)` is called on this one.
///
/// # Errors
/// What `progress` raised, `KeyboardInterrupt`, what `work` returned, or a panic of `work`.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&mut dyn FnMut(&str, f64)) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let cancel = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel::<(String, f64)>();
    let worker = {
        let cancel = Arc::clone(&cancel);
        let body = move || {
            let mut report = |stage: &str, fraction: f64| {
                if cancel.load(Ordering::Relaxed) || sender.send((stage.to_owned(), fraction)).is_err() {
                    panic::resume_unwind(Box::new(Cancelled));
                }
            };
            panic::catch_unwind(AssertUnwindSafe(|| on_worker(|| work(&mut report))))
        };
        thread::Builder::new().name("dressform".to_owned()).spawn(body)?
    };
    // A channel's receiver cannot be shared with the closure that runs without the interpreter.
    let receiver = Mutex::new(receiver);
    let stop = |error: PyErr| {
        cancel.store(true, Ordering::Relaxed);
        error
    };
    loop {
        let next = py.detach(|| receiver.lock().expect("only this thread locks it").recv_timeout(POLL));
        py.check_signals().map_err(stop)?;
        match next {
            Ok((stage, fraction)) => {
                if let Some(callback) = progress {
                    callback.call1((stage, fraction)).map_err(stop)?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    match py.detach(|| worker.join()) {
        Ok(Ok(result)) => result,
        Ok(Err(_)) | Err(_) => Err(errors::internal(last_panic())),
    }
}

fn last_panic() -> String {
    match LAST_PANIC.lock() {
        Ok(last) if !last.is_empty() => last.clone(),
        _ => "the core panicked".to_owned(),
    }
}

/// `{"kind": ..., "name": ...}`.
pub fn device_dict<'py>(py: Python<'py>, info: &DeviceInfo) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("kind", info.kind)?;
    dict.set_item("name", &info.name)?;
    Ok(dict)
}

/// Counts of a garment, by the report's names.
pub fn garment_dict<'py>(py: Python<'py>, garment: &Garment) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("name", &garment.name)?;
    dict.set_item("path", &garment.path)?;
    dict.set_item("layer", garment.layer)?;
    dict.set_item("vertices", garment.point_count)?;
    dict.set_item("panel_vertices", garment.points.len())?;
    dict.set_item("triangles", garment.triangles.len())?;
    dict.set_item("panels", garment.panels.len())?;
    dict.set_item("nodes", garment.groups.node_count)?;
    Ok(dict)
}
