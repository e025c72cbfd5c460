//! The garment as the judge: the default against tightly solved fields, on the same cells and on
//! finer ones.

use dressform::device::Device;
use dressform::model::Vec3;
use dressform::transfer::{Params, Prepared, prepare};

use crate::input::{Meshes, Outfit, timed};
use crate::pairs::pairs;

fn garments(prepared: &Prepared, outfit: &Outfit) -> Vec<Vec3> {
    let device = Device::cpu();
    let carry = |points: &[Vec3]| prepared.carry(&device, points).expect("carries").points;
    outfit.garments.iter().flat_map(|(_, g)| carry(&g.points)).collect()
}

/// Percentiles 50, 99 and 100 of the distances [mm].
fn distances(a: &[Vec3], b: &[Vec3]) -> String {
    let mut all: Vec<f64> = a.iter().zip(b).map(|(a, b)| 1e3 * (a - b).norm()).collect();
    all.sort_by(f64::total_cmp);
    let at = |p: f64| all[((all.len() - 1) as f64 * p) as usize];
    format!("{:.3} | {:.3} | {:.2}", at(0.5), at(0.99), at(1.0))
}

/// Prints the distances of the garments' vertices from two references, both solved in `f64` to a
/// residual of 1e-8: the default's own cells, which judges the solver, and cells of half the size in
/// the band and 3.3 mm near the skin, which judges the cells too. `DRESSFORM_PAIR` picks one pair
/// (`OUTFIT:TARGET`), `DRESSFORM_REFINEMENT` divides the 1 cm cells near the skin by another number,
/// and with `DRESSFORM_LOOSE` the fine cells alone are asked, and solved to the default's tolerance, for
/// a tenth of the time.
pub fn table(meshes: &Meshes) {
    println!("\n## Garment vertices against tight references (f64, residual 1e-8), mm\n");
    println!(
        "| outfit | target | own cells: p50 | p99 | largest | fine cells: p50 | p99 | largest | CPU s | own cells | fine cells |"
    );
    println!("|{}", " --- |".repeat(11));
    let only = std::env::var("DRESSFORM_PAIR").ok();
    for (outfit, target, body) in pairs(meshes) {
        if only.as_ref().is_some_and(|only| *only != format!("{}:{target}", outfit.name)) {
            continue;
        }
        let run = |params: &Params| {
            let (prepared, seconds) = timed(|| prepare(&Device::cpu(), &outfit.body, body, params));
            (garments(&prepared.expect("one topology"), outfit), seconds)
        };
        let (points, seconds) = run(&Params::default());
        let own = (!is_loose()).then(|| run(&Params { exact: true, ..Params::default() }));
        let (fine, fine_seconds) = run(&fine());
        let to_own = own.as_ref().map_or_else(|| "- | - | -".to_owned(), |own| distances(&points, &own.0));
        let own_seconds = own.map_or_else(|| "-".to_owned(), |own| format!("{:.1}", own.1));
        println!(
            "| {} | {target} | {to_own} | {} | {seconds:.1} | {own_seconds} | {fine_seconds:.1} |",
            outfit.name,
            distances(&points, &fine),
        );
    }
}

fn is_loose() -> bool {
    std::env::var_os("DRESSFORM_LOOSE").is_some()
}

/// Cells of half the size in the band, 3.3 mm near the skin; `beta h^2 / nu` is the same.
fn fine() -> Params {
    let asked = std::env::var("DRESSFORM_REFINEMENT").ok().and_then(|r| r.parse().ok());
    let standard = Params::default();
    Params {
        cell: 0.5 * standard.cell,
        beta: 4.0 * standard.beta,
        refinement: asked.unwrap_or(3),
        refined_band: 0.03,
        exact: !is_loose(),
        ..standard
    }
}
