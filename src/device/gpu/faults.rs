//! What went wrong on a GPU since somebody last asked.
//!
//! wgpu reports failures to callbacks, by default with a panic. Here the callbacks keep the
//! first failure and the call that caused it (or the next one) returns it. A lost device
//! stays lost.

use std::sync::{Mutex, MutexGuard};

use super::super::DeviceError;

#[derive(Debug, Default)]
pub(super) struct Faults {
    slots: Mutex<Slots>,
}

#[derive(Debug, Default)]
struct Slots {
    lost: Option<String>,
    fault: Option<DeviceError>,
}

impl Faults {
    fn slots(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Keeps the first of several: the later ones follow from it.
    pub fn report(&self, error: wgpu::Error) {
        self.slots().fault.get_or_insert_with(|| typed(error));
    }

    pub fn lose(&self, reason: String) {
        self.slots().lost.get_or_insert(reason);
    }

    /// The failure since the last call, if any.
    pub fn check(&self) -> Result<(), DeviceError> {
        let mut slots = self.slots();
        if let Some(reason) = &slots.lost {
            return Err(DeviceError::Lost(reason.clone()));
        }
        slots.fault.take().map_or(Ok(()), Err)
    }
}

fn typed(error: wgpu::Error) -> DeviceError {
    match error {
        wgpu::Error::OutOfMemory { source } => DeviceError::OutOfMemory(chain(&*source)),
        wgpu::Error::Validation { description, .. } => DeviceError::Rejected(description),
        wgpu::Error::Internal { description, .. } => DeviceError::Rejected(description),
    }
}

fn chain(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(error) = next {
        text.push_str(": ");
        text.push_str(&error.to_string());
        next = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_fault_is_told_once_and_loss_for_ever() {
        let faults = Faults::default();
        assert_eq!(faults.check(), Ok(()));
        faults.report(wgpu::Error::OutOfMemory { source: "no room".into() });
        faults.report(wgpu::Error::Validation { source: "x".into(), description: "later".to_owned() });
        assert_eq!(faults.check(), Err(DeviceError::OutOfMemory("no room".to_owned())));
        assert_eq!(faults.check(), Ok(()));
        faults.lose("unplugged".to_owned());
        for _ in 0..2 {
            assert_eq!(faults.check(), Err(DeviceError::Lost("unplugged".to_owned())));
        }
    }
}
