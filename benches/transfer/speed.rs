//! One timed transfer for `transfer_speed.py`, judged as the peer judges itself.

use std::time::Instant;

use dressform::device::Device;
use dressform::model::{TriMesh, Vec3};
use dressform::transfer::{Params, prepare};

use crate::input::{Meshes, timed};

/// Outfit, garment and target of `DRESSFORM_PAIR`, as OUTFIT/GARMENT:TARGET.
fn case<'a>(meshes: &'a Meshes, pair: &'a str) -> (&'a TriMesh, &'a TriMesh, &'a TriMesh) {
    let (garment, target) = pair.split_once(':').expect("OUTFIT/GARMENT:TARGET");
    let (outfit, garment) = garment.split_once('/').expect("OUTFIT/GARMENT:TARGET");
    let outfit = meshes.outfit(outfit);
    let (_, garment) = outfit.garments.iter().find(|(name, _)| name == garment).expect("a garment");
    (&outfit.body, garment, &meshes.bodies[target])
}

/// 99th percentile and mean of the gap over all vertices of the body, each counting once [m].
fn gap(body: &[Vec3], target: &[Vec3]) -> (f64, f64) {
    let mut gaps: Vec<f64> = body.iter().zip(target).map(|(p, q)| (p - q).norm()).collect();
    gaps.sort_by(f64::total_cmp);
    let at = 0.99 * (gaps.len() - 1) as f64;
    let (low, high) = (gaps[at.floor() as usize], gaps[at.ceil() as usize]);
    (low + at.fract() * (high - low), gaps.iter().sum::<f64>() / gaps.len() as f64)
}

/// Prints one JSON object for each gap in `DRESSFORM_GAPS` [m]: the default transfer, asked to stop
/// there.
pub fn run(meshes: &Meshes) {
    let pair = std::env::var("DRESSFORM_PAIR").unwrap_or_else(|_| "casual_man/Tshirt:heavy_man".into());
    let gaps = std::env::var("DRESSFORM_GAPS").unwrap_or_else(|_| "2e-3".into());
    for asked in gaps.split(',').map(|gap| gap.parse::<f64>().expect("a length")) {
        println!("{}", to_gap(meshes, &pair, asked));
    }
}

/// The transfer's own stop looks at the outer skin and weighs by area, the peer's at all vertices of
/// the body alike: it is asked for less until the latter is reached as well.
fn to_gap(meshes: &Meshes, pair: &str, asked: f64) -> String {
    let (source, garment, target) = case(meshes, pair);
    let device = Device::cpu();
    let mut gap_p99 = asked;
    loop {
        let params = Params { gap_p99, ..Params::default() };
        let started = Instant::now();
        let ((prepared, carried), seconds) = timed(|| {
            let prepared = prepare(&device, source, target, &params).expect("one topology");
            let carried = prepared.carry(&device, &garment.points).expect("carries");
            (prepared, carried)
        });
        let wall = started.elapsed().as_secs_f64();
        let (p99, mean) = gap(prepared.body(), &target.points);
        if p99 <= asked || gap_p99 < 0.1 * asked {
            let info = prepared.info(&carried, &prepared.near(&garment.points));
            return format!(
                "{{\"pair\": \"{pair}\", \"asked_m\": {asked}, \"gap_p99\": {gap_p99}, \
                 \"gap_p99_m\": {p99}, \"gap_mean_m\": {mean}, \"outer\": {}, \"cg\": {}, \
                 \"seconds_cpu\": {seconds}, \"seconds_wall\": {wall}}}",
                info.outer_iterations, info.cg_iterations,
            );
        }
        gap_p99 *= 0.9;
    }
}
