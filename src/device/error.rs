//! What a device can refuse or fail at.

use thiserror::Error;

/// A device's failure.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum DeviceError {
    /// No adapter fits the choice.
    #[error("no adapter for '{wanted}' (found: {})", if found.is_empty() { "none".to_owned() } else { found.join(", ") })]
    NoAdapter { wanted: String, found: Vec<String> },
    /// The adapter's driver is known to compute wrong results.
    #[error("adapter '{adapter}' is refused: {reason}")]
    Refused { adapter: String, reason: String },
    /// The device went away.
    #[error("device lost: {0}")]
    Lost(String),
    /// The device has no room.
    #[error("out of device memory: {0}")]
    OutOfMemory(String),
    /// A buffer is larger than the device can bind.
    #[error("buffer '{label}' of {bytes} bytes exceeds the device's limit of {limit}")]
    TooLarge { label: &'static str, bytes: u64, limit: u64 },
    /// Data and buffer differ in length.
    #[error("buffer '{label}' holds {expected} elements, {found} given")]
    Length { label: &'static str, found: usize, expected: usize },
    /// A kernel was given the wrong number of buffers.
    #[error("kernel '{kernel}' takes {expected} buffers, {found} given")]
    Bindings { kernel: &'static str, found: usize, expected: usize },
    /// A buffer of another device was given.
    #[error("buffer '{label}' belongs to another device")]
    Foreign { label: &'static str },
    /// A buffer was bound twice, once to be written.
    #[error("kernel '{kernel}': buffer '{label}' is bound twice while written")]
    Aliased { kernel: &'static str, label: &'static str },
    /// The shader did not compile, or a command was malformed: a fault of ours.
    #[error("device rejected a command: {0}")]
    Rejected(String),
}
