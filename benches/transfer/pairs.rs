//! Every outfit on every body: gap, iterations, seconds; and what the volume term does.

use std::collections::HashMap;

use dressform::device::Device;
use dressform::geometry::Surface;
use dressform::geometry::intersect::self_intersections;
use dressform::model::{TriMesh, Vec3};
use dressform::transfer::clear::Cloth;
use dressform::transfer::{Carried, Params, Prepared, prepare};

use crate::input::{Meshes, Outfit, timed};

/// The number of each point of a garment, seams welded: points that coincide on the source are one.
fn weld(garment: &TriMesh) -> Vec<u32> {
    let mut numbers = HashMap::new();
    let number = |p: &Vec3| {
        let (place, next) = (p.map(f64::to_bits), numbers.len() as u32);
        *numbers.entry([place.x, place.y, place.z]).or_insert(next)
    };
    garment.points.iter().map(number).collect()
}

/// Triangle pairs of a garment that cross with its points at `points`.
fn crossings(points: &[Vec3], garment: &TriMesh) -> usize {
    let weld = weld(garment);
    let mut welded = vec![Vec3::zeros(); points.len()];
    points.iter().zip(&weld).for_each(|(p, &w)| welded[w as usize] = *p);
    let triangles = garment.triangles.iter().map(|t| t.map(|i| weld[i as usize])).collect();
    self_intersections(&Surface::new(TriMesh { points: welded, triangles })).len()
}

/// Garments carried, the smallest determinant of all, and self-intersections.
struct Carry {
    carried: Vec<Carried>,
    determinant: f64,
    crossings: usize,
    inside: usize,
}

fn carry_cloth(prepared: &Prepared, device: &Device, garment: &TriMesh) -> Carried {
    let cloth = Cloth { points: &garment.points, triangles: &garment.triangles, weld: &weld(garment) };
    prepared.carry_cloth(device, &cloth).expect("carries")
}

fn carry(prepared: &Prepared, outfit: &Outfit) -> Carry {
    let device = Device::cpu();
    let carried: Vec<Carried> =
        outfit.garments.iter().map(|(_, g)| carry_cloth(prepared, &device, g)).collect();
    Carry {
        determinant: carried.iter().map(|c| c.determinant_min).fold(f64::INFINITY, f64::min),
        crossings: carried.iter().zip(&outfit.garments).map(|(c, (_, g))| crossings(&c.points, g)).sum(),
        inside: carried.iter().map(|c| c.points_inside).sum(),
        carried,
    }
}

/// Every outfit with every target.
pub fn pairs(meshes: &Meshes) -> impl Iterator<Item = (&Outfit, &String, &TriMesh)> {
    meshes.outfits.iter().flat_map(|outfit| {
        let targets = meshes.bodies.iter().filter(|(name, _)| !name.starts_with("source_"));
        targets.map(move |(name, body)| (outfit, name, body))
    })
}

/// Prints the gap and its price for all pairs.
pub fn table(meshes: &Meshes) {
    println!("\n## All pairs with the default settings\n");
    println!(
        "| outfit | target | gap p99 mm | mean mm | outer | CG | CPU s | stop | determinant | self-intersections | inside | folds | skin pairs before, after | lift mm |"
    );
    println!("|{}", " --- |".repeat(14));
    for (outfit, name, body) in pairs(meshes) {
        let (prepared, seconds) = timed(|| prepare(&Device::cpu(), &outfit.body, body, &Params::default()));
        let prepared = prepared.expect("bodies of one topology");
        let near = prepared.near(&outfit.points());
        let carry = carry(&prepared, outfit);
        let info = prepared.info(&carry.carried[0], &near);
        println!(
            "| {} | {name} | {:.3} | {:.3} | {} | {} | {seconds:.2} | {:?}{} | {:.3} | {} | {} | {} | {}, {} | {:.2} |",
            outfit.name,
            1e3 * near.gap.p99,
            1e3 * near.gap.mean,
            info.outer_iterations,
            info.inner.iter().flat_map(|i| &i.cg_iterations).sum::<usize>(),
            info.stop,
            if info.converged { "" } else { ", not converged" },
            carry.determinant,
            carry.crossings,
            carry.inside,
            near.folds.len(),
            carry.carried.iter().map(|c| c.lift.pairs_before).sum::<usize>(),
            carry.carried.iter().map(|c| c.lift.pairs).sum::<usize>(),
            1e3 * carry.carried.iter().map(|c| c.lift.largest_m).fold(0.0, f64::max),
        );
    }
}

/// Prints the smallest determinant and self-intersections with and without the volume term.
pub fn pinching(meshes: &Meshes) {
    println!("\n## Pinching: with and without the unilateral volume term\n");
    println!(
        "| outfit | target | determinant with | without | self-intersections with | without | inside with | without |"
    );
    println!("|{}", " --- |".repeat(8));
    for (outfit, name, body) in pairs(meshes) {
        let run = |gamma: f64| {
            let params = Params { gamma, ..Params::default() };
            let prepared = prepare(&Device::cpu(), &outfit.body, body, &params).expect("one topology");
            carry(&prepared, outfit)
        };
        let (with, without) = (run(Params::default().gamma), run(1e9));
        println!(
            "| {} | {name} | {:.3} | {:.3} | {} | {} | {} | {} |",
            outfit.name,
            with.determinant,
            without.determinant,
            with.crossings,
            without.crossings,
            with.inside,
            without.inside,
        );
    }
}

/// Prints what garments cost after the field is there.
pub fn prepared(meshes: &Meshes) {
    println!("\n## A prepared transfer: CPU seconds for the field, then for each garment\n");
    println!("| outfit | target | field s | garment | vertices | cells of its own | s |");
    println!("|{}", " --- |".repeat(7));
    for (outfit, target) in [("casual_man", "heavy_man"), ("casual_woman", "thin_woman")] {
        let outfit = meshes.outfit(outfit);
        let device = Device::cpu();
        let (prepared, seconds) =
            timed(|| prepare(&device, &outfit.body, &meshes.bodies[target], &Params::default()));
        let prepared = prepared.expect("bodies of one topology");
        prepared.carry(&device, &[]).expect("carries"); // makes the target's surface
        for (name, garment) in &outfit.garments {
            let (carried, each) = timed(|| (0..10).map(|_| prepared.carry(&device, &garment.points)).last());
            let carried = carried.expect("ten").expect("carries");
            println!(
                "| {} | {target} | {seconds:.2} | {name} | {} | {} | {:.3} |",
                outfit.name,
                garment.points.len(),
                carried.extra_cells,
                each / 10.0,
            );
        }
    }
}
