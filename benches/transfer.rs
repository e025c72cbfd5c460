//! The transfer on real bodies: what multigrid does at every cell size, and what the gap costs.
//!
//! ```text
//! python benches/meshes.py DATA meshes.json
//! DRESSFORM_MESHES=meshes.json cargo bench --bench transfer -- [multigrid|stages|pairs|pinch|prepared|reference]
//! ```
//!
//! Each part prints a table in Markdown. Seconds are CPU seconds of this process: run with
//! `RAYON_NUM_THREADS=1` to compare.

#[path = "shared/clock.rs"]
mod clock;
#[path = "transfer/input.rs"]
mod input;
#[path = "transfer/multigrid.rs"]
mod multigrid;
#[path = "transfer/pairs.rs"]
mod pairs;
#[path = "transfer/reference.rs"]
mod reference;
#[path = "transfer/speed.rs"]
mod speed;

fn main() {
    let Some(meshes) = input::Meshes::read() else {
        println!("skipped: the transfer's benchmark (DRESSFORM_MESHES names no file of meshes.py)");
        return;
    };
    // The part that transfer_speed.py runs in turn with a peer.
    if std::env::args().any(|a| a == "speed") {
        return speed::run(&meshes);
    }
    let asked: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wants = |part: &str| asked.is_empty() || asked.iter().any(|a| a == part);
    if wants("multigrid") {
        multigrid::table(&meshes);
    }
    if wants("stages") {
        multigrid::stages(&meshes);
    }
    if wants("pairs") {
        pairs::table(&meshes);
    }
    if wants("pinch") {
        pairs::pinching(&meshes);
    }
    if wants("prepared") {
        pairs::prepared(&meshes);
    }
    if wants("reference") {
        reference::table(&meshes);
    }
}
