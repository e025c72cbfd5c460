//! Prepared transfers by content: in memory for one process, in a folder for many.
//!
//! A key is the SHA-256 of everything that a field depends on: both bodies, the settings, the
//! device and this build. So nothing in a cache is ever out of date; what no longer fits is
//! not found. A file that is damaged or of another format is solved anew and replaced, and a
//! file appears whole or not at all.

use std::collections::VecDeque;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::cast_slice;
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::store::{Key, decode, encode};
use super::{Error, Params, Prepared, prepare};
use crate::device::Device;
use crate::model::TriMesh;

/// What a process keeps [bytes]; a pair at 2 cm takes 50 to 150 MB.
const MEMORY: usize = 512 << 20;

/// Where a prepared transfer came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// It was solved.
    Solved,
    /// It was in memory.
    Memory,
    /// It was read from the folder.
    Disk,
}

/// A prepared transfer from a [`Cache`].
#[derive(Clone, Debug)]
pub struct Fetched {
    /// The transfer.
    pub prepared: Arc<Prepared>,
    /// Where it came from.
    pub origin: Origin,
    /// What is wrong with the folder; it costs time alone.
    pub note: Option<String>,
}

/// Newest last.
type Memory = VecDeque<(Key, Arc<Prepared>)>;

/// Prepared transfers. Clones share their memory.
#[derive(Clone, Debug, Default)]
pub struct Cache {
    memory: Arc<Mutex<Memory>>,
    folder: Option<PathBuf>,
}

impl Cache {
    /// The same memory, with files in `folder`, which is made when the first is written.
    #[must_use]
    pub fn on_disk(&self, folder: impl Into<PathBuf>) -> Cache {
        Cache { memory: Arc::clone(&self.memory), folder: Some(folder.into()) }
    }

    /// The transfer from `source` to `target`: solved only if it is neither in memory nor in
    /// the folder.
    ///
    /// # Errors
    /// As [`prepare`]; a folder that cannot be read or written is a note.
    pub fn prepare(
        &self,
        device: &Device,
        source: &TriMesh,
        target: &TriMesh,
        params: &Params,
    ) -> Result<Fetched, Error> {
        let key = key(device, source, target, params);
        if let Some(prepared) = self.remembered(&key) {
            return Ok(Fetched { prepared, origin: Origin::Memory, note: None });
        }
        let file = self.folder.as_ref().map(|folder| folder.join(format!("{}.transfer", hex(&key))));
        let stored = file.as_ref().and_then(|file| std::fs::read(file).ok());
        if let Some(prepared) = stored.as_ref().and_then(|bytes| decode(bytes, &key, params)) {
            let prepared = self.remember(key, prepared);
            return Ok(Fetched { prepared, origin: Origin::Disk, note: None });
        }
        let prepared = prepare(device, source, target, params)?;
        let mut notes = Vec::new();
        if let Some(file) = file {
            if stored.is_some() {
                notes.push(format!("{}: damaged, and solved anew", file.display()));
            }
            if let Err(error) = write_whole(&file, &encode(&prepared, &key)) {
                notes.push(format!("{}: cannot be written: {error}", file.display()));
            }
        }
        let note = (!notes.is_empty()).then(|| notes.join("; "));
        Ok(Fetched { prepared: self.remember(key, prepared), origin: Origin::Solved, note })
    }

    fn remembered(&self, key: &Key) -> Option<Arc<Prepared>> {
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        let at = memory.iter().position(|(k, _)| k == key)?;
        let found = memory.remove(at)?;
        let prepared = Arc::clone(&found.1);
        memory.push_back(found);
        Some(prepared)
    }

    /// Keeps a transfer, and lets go of the oldest until all fit into [`MEMORY`].
    fn remember(&self, key: Key, prepared: Prepared) -> Arc<Prepared> {
        let prepared = Arc::new(prepared);
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        memory.push_back((key, Arc::clone(&prepared)));
        while memory.iter().map(|(_, p)| p.bytes()).sum::<usize>() > MEMORY {
            memory.pop_front();
        }
        prepared
    }
}

/// Names the transfer of a pair of bodies.
fn key(device: &Device, source: &TriMesh, target: &TriMesh, params: &Params) -> Key {
    let mut digest = Sha256::new();
    let mut part = |bytes: &[u8]| {
        digest.update((bytes.len() as u64).to_le_bytes());
        digest.update(bytes);
    };
    part(env!("CARGO_PKG_VERSION").as_bytes());
    part(env!("DRESSFORM_SOURCES").as_bytes());
    let info = device.info();
    part(info.kind.as_bytes());
    part(info.name.as_bytes());
    part(info.driver.unwrap_or_default().as_bytes());
    part(format!("{params:?}").as_bytes());
    for mesh in [source, target] {
        let points: Vec<f64> = mesh.points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        part(cast_slice(&points));
    }
    part(cast_slice::<[u32; 3], u8>(&source.triangles));
    digest.finalize().into()
}

fn hex(key: &Key) -> String {
    key.iter().map(|b| format!("{b:02x}")).collect()
}

/// Writes a file that appears whole or not at all.
fn write_whole(file: &Path, bytes: &[u8]) -> std::io::Result<()> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let beside = file.with_extension(format!("{}-{number}.part", std::process::id()));
    let written = std::fs::File::create(&beside)
        .and_then(|mut f| f.write_all(bytes).and_then(|()| f.sync_all()))
        .and_then(|()| std::fs::rename(&beside, file));
    if written.is_err() {
        // What could not be written whole is of no use; that it cannot be removed either
        // changes nothing for the caller.
        let _ = std::fs::remove_file(&beside);
    }
    written
}
