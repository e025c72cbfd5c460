//! The garment as the judge: default settings against a tightly solved field on fine cells.

use dressform::device::Device;
use dressform::model::Vec3;
use dressform::transfer::{Params, Prepared, prepare};

use crate::input::{Meshes, Outfit, timed};

fn garments(prepared: &Prepared, outfit: &Outfit) -> Vec<Vec3> {
    let device = Device::cpu();
    let carry = |points: &[Vec3]| prepared.carry(&device, points).expect("carries").points;
    outfit.garments.iter().flat_map(|(_, g)| carry(&g.points)).collect()
}

/// Percentiles 50, 99 and 100 of the distances [mm].
fn distances(a: &[Vec3], b: &[Vec3]) -> [f64; 3] {
    let mut all: Vec<f64> = a.iter().zip(b).map(|(a, b)| 1e3 * (a - b).norm()).collect();
    all.sort_by(f64::total_cmp);
    [0.5, 0.99, 1.0].map(|p| all[((all.len() - 1) as f64 * p) as usize])
}

/// Prints distances of the garments' vertices from the reference.
pub fn table(meshes: &Meshes) {
    println!("\n## Garment vertices against a tight reference (f64, residual 1e-8, fine cells), mm\n");
    println!("| outfit | target | what | cell cm | p50 | p99 | largest | CPU s |");
    println!("|{}", " --- |".repeat(8));
    let only = std::env::var("DRESSFORM_PAIR").unwrap_or_else(|_| "casual_man:heavy_man".into());
    for pair in only.split(',') {
        let (outfit, target) = pair.split_once(':').expect("OUTFIT:TARGET");
        let (outfit, body) = (meshes.outfit(outfit), &meshes.bodies[target]);
        let run = |params: &Params| {
            let (prepared, seconds) = timed(|| prepare(&Device::cpu(), &outfit.body, body, params));
            (garments(&prepared.expect("one topology"), outfit), seconds)
        };
        let variants: Vec<(&str, Params)> = variants();
        let reference = variants.last().expect("a reference").1.clone();
        let (exact, cost) = run(&reference);
        for (what, params) in &variants[..variants.len() - 1] {
            let (points, seconds) = run(params);
            let [p50, p99, max] = distances(&points, &exact);
            println!(
                "| {} | {target} | {what} | {} | {p50:.3} | {p99:.3} | {max:.2} | {seconds:.1} |",
                outfit.name,
                100.0 * params.cell
            );
        }
        println!("| {} | {target} | reference | {} | | | | {cost:.1} |", outfit.name, 100.0 * reference.cell);
    }
}

/// What is compared; the last is the reference. At every cell size `beta h^2 / nu` is the same.
fn variants() -> Vec<(&'static str, Params)> {
    let at = |cell: f64, exact: bool| {
        let standard = Params::default();
        let beta = standard.beta * (standard.cell / cell).powi(2);
        Params { cell, beta, exact, ..standard }
    };
    let fine: f64 = std::env::var("DRESSFORM_CELL").ok().and_then(|c| c.parse().ok()).unwrap_or(0.01);
    vec![
        ("default", Params::default()),
        ("no closing steps", Params { refinement: 1, closing_band: 0.12, ..Params::default() }),
        ("default, tight", at(0.02, true)),
        ("finer, tight", at(1.5 * fine, true)),
        ("reference", at(fine, true)),
    ]
}
