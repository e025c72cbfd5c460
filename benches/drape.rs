//! Drapes one case that is described by a file and says how it came to rest.
//!
//! ```text
//! cargo bench --bench drape -- CASE.json [SETTINGS.json] [RESULT.json]
//! ```
//! A case holds a garment, where it starts, its pattern, colliders and finished layers
//! (`benches/drape.py` makes them). Prints one JSON object: CPU seconds, what the drape reports,
//! and after how many CPU seconds 99% of the vertices were within a millimetre of their place at
//! the end for good. `RESULT.json` gets the vertices. `DRESSFORM_DEVICE` names the device, the CPU by
//! default.

use std::fs;
use std::time::Instant;

use dressform::device::{Device, DeviceChoice};
use dressform::drape::{self, Input, Params};
use dressform::geometry::Surface;
use dressform::model::{Garment, GarmentSource, TriMesh, Vec2, Vec3};
use serde::Deserialize;

#[path = "shared/clock.rs"]
mod clock;

use clock::cpu_seconds;

/// Vertices closer than this to their place at the end have arrived [m].
const ARRIVED: f64 = 1e-3;

#[derive(Deserialize)]
struct Case {
    #[serde(default)]
    source: Option<GarmentSource>,
    #[serde(default)]
    garment: Option<Garment>,
    /// Where the garment's vertices start.
    #[serde(default)]
    points: Option<Vec<Vec3>>,
    /// The same by the source's points.
    #[serde(default)]
    start: Option<Vec<Vec3>>,
    #[serde(default)]
    pattern: Option<Vec<Vec2>>,
    colliders: Vec<TriMesh>,
    #[serde(default)]
    layers: Vec<TriMesh>,
}

/// The 99th percentile of the vertices' distances [m].
fn apart(a: &[Vec3], b: &[Vec3]) -> f64 {
    let mut all: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a - b).norm()).collect();
    all.sort_unstable_by(f64::total_cmp);
    all[(all.len() - 1) * 99 / 100]
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let [case, rest @ ..] = &arguments[..] else {
        println!("skipped: no case was named; benches/drape.py makes them and runs this");
        return;
    };
    let text = fs::read_to_string(case).expect("the case can be read");
    let case: Case = serde_json::from_str(&text).expect("the case is as `Case` has it");
    let params: Params = match rest.first() {
        Some(file) => serde_json::from_str(&fs::read_to_string(file).expect("settings can be read"))
            .expect("settings are as `drape::Params` has them"),
        None => Params::default(),
    };
    let garment = case
        .garment
        .or_else(|| case.source.map(|s| Garment::from_source(s).expect("a garment")))
        .expect("a garment or its source");
    let (colliders, layers): (Vec<Surface>, Vec<Surface>) = (
        case.colliders.into_iter().map(Surface::new).collect(),
        case.layers.into_iter().map(Surface::new).collect(),
    );
    let by_source = |start: &Vec<Vec3>| -> Vec<Vec3> {
        garment.point_of_vertex.iter().map(|&p| start[p as usize]).collect()
    };
    let points = case.points.or_else(|| case.start.as_ref().map(by_source));
    let input = Input {
        garment: &garment,
        points: points.as_deref().unwrap_or(&garment.points),
        pattern: case.pattern.as_deref().unwrap_or(&garment.pattern),
        colliders: &colliders.iter().collect::<Vec<_>>(),
        layers: &layers.iter().collect::<Vec<_>>(),
        pinned: &[],
        held: &[],
    };
    let choice: DeviceChoice = std::env::var("DRESSFORM_DEVICE")
        .map_or(DeviceChoice::Cpu, |d| d.parse().unwrap_or(DeviceChoice::Cpu));
    let device = Device::open(&choice).expect("the device opens");
    let (start, clock) = (cpu_seconds(), Instant::now());
    let mut moments: Vec<(f64, Vec<Vec3>)> = Vec::new();
    let output = drape::run_with_progress(&device, &input, &params, &mut |moment| {
        moments.push((cpu_seconds() - start, moment.points()));
    })
    .expect("the drape runs");
    let total = cpu_seconds() - start;
    let late = moments.iter().rposition(|(_, p)| apart(p, &output.points) > ARRIVED);
    let arrived = moments.get(late.map_or(0, |l| l + 1)).map_or(total, |m| m.0);
    let result = serde_json::json!({
        "vertices": garment.points.len(),
        "nodes": garment.groups.node_count,
        "device": device.info().name,
        "wall_s": clock.elapsed().as_secs_f64(),
        "cpu_s": total,
        "arrived_cpu_s": arrived,
        "steps_seen": moments.len(),
        "drape": output.info,
    });
    println!("{result}");
    if let Some(file) = rest.get(1) {
        let points = serde_json::to_string(&output.points).expect("points are numbers");
        fs::write(file, points).expect("the result can be written");
    }
}
