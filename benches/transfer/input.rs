//! Bodies and garments as `meshes.py` writes them, and what things take.

use std::collections::BTreeMap;
use std::path::PathBuf;

use dressform::model::{TriMesh, Vec3};
use serde::Deserialize;

use crate::clock::cpu_seconds;

#[derive(Deserialize)]
struct File {
    bodies: BTreeMap<String, Mesh>,
    outfits: BTreeMap<String, RawOutfit>,
}

#[derive(Deserialize)]
struct Mesh {
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

#[derive(Deserialize)]
struct RawOutfit {
    body: Mesh,
    garments: BTreeMap<String, Mesh>,
}

impl From<Mesh> for TriMesh {
    fn from(mesh: Mesh) -> TriMesh {
        TriMesh { points: mesh.points.into_iter().map(Vec3::from).collect(), triangles: mesh.triangles }
    }
}

/// An outfit on its source body.
pub struct Outfit {
    pub name: String,
    pub body: TriMesh,
    pub garments: Vec<(String, TriMesh)>,
}

impl Outfit {
    /// Points of all garments.
    pub fn points(&self) -> Vec<Vec3> {
        self.garments.iter().flat_map(|(_, g)| g.points.iter().copied()).collect()
    }
}

/// All input.
pub struct Meshes {
    pub bodies: BTreeMap<String, TriMesh>,
    pub outfits: Vec<Outfit>,
}

impl Meshes {
    /// The file that `DRESSFORM_MESHES` names, if it is there.
    pub fn read() -> Option<Meshes> {
        let path = std::env::var_os("DRESSFORM_MESHES").map(PathBuf::from).filter(|path| path.exists())?;
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let file: File = serde_json::from_slice(&bytes).expect("written by meshes.py");
        let outfit = |(name, outfit): (String, RawOutfit)| Outfit {
            name,
            body: outfit.body.into(),
            garments: outfit.garments.into_iter().map(|(name, mesh)| (name, mesh.into())).collect(),
        };
        Some(Meshes {
            bodies: file.bodies.into_iter().map(|(name, mesh)| (name, mesh.into())).collect(),
            outfits: file.outfits.into_iter().map(outfit).collect(),
        })
    }

    /// The outfit of that name.
    pub fn outfit(&self, name: &str) -> &Outfit {
        self.outfits.iter().find(|o| o.name == name).expect("an outfit of the data")
    }
}

/// What `f` returns, and the CPU seconds that it took.
pub fn timed<T>(f: impl FnOnce() -> T) -> (T, f64) {
    let before = cpu_seconds();
    let value = f();
    (value, cpu_seconds() - before)
}
