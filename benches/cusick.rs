//! Cusick's drape test of the fabric presets.
//!
//! A disc of 15 cm radius is clamped between two discs of 9 cm and hangs down around them; the
//! drape coefficient is the part of the ring that its shadow covers [Cusick 1968, BS EN ISO
//! 9073-9]. Run `cargo bench --bench cusick`; names of fabrics as arguments choose among them, and
//! `NAME*FACTOR` bends as many times harder.
//! Limp cloth hangs in folds whose number depends on how it falls, as on the real instrument, so
//! that the coefficient is the mean of six falls, as there of three specimens with either face up.

use std::time::Instant;

use dressform::device::Device;
use dressform::drape::{self, Input, Params};
use dressform::model::{Fabric, Garment, Vec2, Vec3};

#[path = "shared/disc.rs"]
mod disc;

use disc::{DISC, PEDESTAL};

/// Waves of the ripples that the falls start from, and the face that is up.
const STARTS: [(f64, f64); 6] = [(7.0, 1.0), (9.0, 1.0), (11.0, 1.0), (7.0, -1.0), (9.0, -1.0), (11.0, -1.0)];
/// Side of a shadow's cell [m].
const CELL: f64 = 5e-4;
/// Lengths of the elements [m].
const EDGES: [f64; 4] = [0.012, 0.008, 0.006, 0.0043];
/// Drape coefficients that the fabrics are known by [%].
const EXPECTED: [(&str, [f64; 2]); 5] = [
    ("silk", [20.0, 40.0]),
    ("cotton", [60.0, 76.0]),
    ("wool", [40.0, 70.0]),
    ("leather", [47.0, 70.0]),
    ("denim", [70.0, 90.0]),
];

/// Area that the cloth covers, seen from above [m^2].
fn shadow(points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let n = (2.4 * DISC / CELL) as usize;
    let mut covered = vec![false; n * n];
    let cell = |x: f64| ((x + 1.2 * DISC) / CELL).clamp(0.0, n as f64 - 1.0) as usize;
    for t in triangles {
        let [a, b, c] = t.map(|v| Vec2::new(points[v as usize].x, points[v as usize].z));
        let double = (b - a).perp(&(c - a));
        if double == 0.0 {
            continue;
        }
        let (lo, hi) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        for i in cell(lo.x)..=cell(hi.x) {
            for j in cell(lo.y)..=cell(hi.y) {
                let p = Vec2::new(i as f64 + 0.5, j as f64 + 0.5) * CELL - Vec2::repeat(1.2 * DISC);
                let side = |u: Vec2, v: Vec2| (v - u).perp(&(p - u)) / double;
                if side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0 {
                    covered[i * n + j] = true;
                }
            }
        }
    }
    covered.iter().filter(|c| **c).count() as f64 * CELL * CELL
}

/// Folds: maxima of the rim's height around the disc that stand out by 2 mm.
fn folds(garment: &Garment, points: &[Vec3]) -> usize {
    let mut rim: Vec<(f64, f64)> = (0..points.len())
        .filter(|&v| garment.pattern[v].norm() > DISC - 1e-6)
        .map(|v| (garment.pattern[v].y.atan2(garment.pattern[v].x), points[v].y))
        .collect();
    rim.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (low, high) = rim.iter().fold((f64::MAX, f64::MIN), |(l, h), r| (l.min(r.1), h.max(r.1)));
    let middle = 0.5 * (low + high);
    if high - low < 2e-3 {
        return 0;
    }
    (0..rim.len()).filter(|&i| rim[i].1 <= middle && rim[(i + 1) % rim.len()].1 > middle).count()
}

/// How a disc came to hang.
struct Fall {
    nodes: usize,
    /// Part of the ring that the shadow covers [%].
    coefficient: f64,
    folds: usize,
    residual: f64,
    at_rest: bool,
}

/// Drapes a disc of elements of about `h` [m] from a ripple, see [`STARTS`].
fn fall(fabric: &Fabric, h: f64, (waves, face): (f64, f64)) -> Fall {
    let garment = disc::garment(fabric, h, waves, face);
    let held = disc::clamped(&garment, h);
    let params = Params {
        frames: 0,
        settle: true,
        settle_steps: 240,
        tolerance: 0.02,
        rest_tolerance: 0.05,
        press: 1.0, // it falls flat: no folds to press out
        ..Params::default()
    };
    let input = Input { pinned: &held, ..Input::alone(&garment) };
    let out = drape::run(&Device::cpu(), &input, &params).expect("the disc drapes");
    let clamped = std::f64::consts::PI * PEDESTAL * PEDESTAL;
    let ring = std::f64::consts::PI * DISC * DISC - clamped;
    Fall {
        nodes: garment.points.len(),
        coefficient: 100.0 * (shadow(&out.points, &garment.triangles) - clamped) / ring,
        folds: folds(&garment, &out.points),
        residual: out.info.residual,
        at_rest: out.info.at_rest && out.info.converged,
    }
}

/// Sag of the rim [m] of a level annular plate of bending stiffness `k` [N m] in all directions, without
/// contraction across, clamped at the pedestal's rim and free at the disc's, under the load `q` [N/m^2]:
/// `w = q r^4 / 64 k + a + b ln r + c r^2 + d r^2 ln r`.
fn plate_sag(k: f64, q: f64) -> f64 {
    let height = |r: f64| [1.0, r.ln(), r * r, r * r * r.ln()];
    let slope = |r: f64| [0.0, 1.0 / r, 2.0 * r, r * (2.0 * r.ln() + 1.0)];
    let curvature = |r: f64| [0.0, -1.0 / (r * r), 2.0, 2.0 * r.ln() + 3.0];
    let force = |r: f64| [0.0, 0.0, 0.0, 4.0 / r];
    let (a, b) = (PEDESTAL, DISC);
    let rows = nalgebra::Matrix4::from_fn(|i, j| [height(a), slope(a), curvature(b), force(b)][i][j]);
    let load = nalgebra::Vector4::new(a.powi(4) / 64.0, a.powi(3) / 16.0, 3.0 * b * b / 16.0, 0.5 * b);
    let free = rows.lu().solve(&(-load * (q / k))).expect("a clamped plate");
    q / k * b.powi(4) / 64.0 + free.dot(&nalgebra::Vector4::from(height(b)))
}

/// Prints the mean sag of a stiff disc's rim for elements of about `h` [m].
fn plate(h: f64) {
    let fabric = isotropic(0.1);
    let garment = disc::garment(&fabric, h, 7.0, 0.0);
    let held = disc::clamped(&garment, h);
    let params = Params { frames: 0, press: 1.0, tolerance: 1e-3, rest_tolerance: 2e-3, ..Params::default() };
    let input = Input { pinned: &held, ..Input::alone(&garment) };
    let out = drape::run(&Device::cpu(), &input, &params).expect("the disc drapes");
    let rim: Vec<f64> = (0..garment.points.len())
        .filter(|&v| garment.pattern[v].norm() > DISC - 1e-6)
        .map(|v| -out.points[v].y)
        .collect();
    let sag = rim.iter().sum::<f64>() / rim.len() as f64;
    let exact = plate_sag(fabric.bending_warp, fabric.density * 9.81);
    println!("| {} | {:.3} | {:.3} | {:.3} |", garment.points.len(), 1e3 * sag, 1e3 * exact, sag / exact);
}

/// Drapes discs of elements of about `h` [m] and prints a row.
fn test(fabric: &Fabric, h: f64, expected: &str) {
    let mean = 0.5 * (fabric.bending_warp + fabric.bending_weft);
    let length = (mean / (fabric.density * 9.81)).cbrt() * 1e3;
    let clock = Instant::now();
    let falls = STARTS.map(|start| fall(fabric, h, start));
    let n = falls.len() as f64;
    let coefficient = falls.iter().map(|f| f.coefficient).sum::<f64>() / n;
    let squares = falls.iter().map(|f| (f.coefficient - coefficient).powi(2)).sum::<f64>();
    let error = (squares / (n * (n - 1.0))).sqrt();
    let each = falls.each_ref().map(|f| format!("{:.1}", f.coefficient)).join(" ");
    let folds = falls.each_ref().map(|f| f.folds.to_string()).join(" ");
    let residual = falls.iter().map(|f| f.residual).fold(0.0, f64::max);
    println!(
        "| {} | {length:.1} | {} | {coefficient:.1} ± {error:.1} ({each}) | {expected} | {folds} | {residual:.3}{} | {:.0} |",
        fabric.name,
        falls[0].nodes,
        if falls.iter().all(|f| f.at_rest) { "" } else { " (not at rest)" },
        clock.elapsed().as_secs_f64(),
    );
}

/// Cloth that bends alike in all directions, by its bending length [m].
fn isotropic(length: f64) -> Fabric {
    let cotton = Fabric::preset("cotton").expect("a preset");
    let k = cotton.density * 9.81 * length.powi(3);
    let name = "isotropic".to_owned();
    Fabric { name, bending_warp: k, bending_weft: k, bending_shear: 2.0 * k, ..cotton }
}

/// A fabric that bends `factor` times harder.
fn stiffer(fabric: &Fabric, factor: f64) -> Fabric {
    Fabric {
        bending_warp: fabric.bending_warp * factor,
        bending_weft: fabric.bending_weft * factor,
        bending_shear: fabric.bending_shear * factor,
        ..fabric.clone()
    }
}

fn main() {
    let chosen: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    if chosen.iter().any(|c| c == "plate") {
        println!("| nodes | sag mm | closed form | ratio |\n| --- | --- | --- | --- |");
        EDGES.iter().for_each(|&h| plate(h));
        return;
    }
    println!(
        "| cloth | bending length mm | nodes | coefficient % (each fall) | known for | folds | residual | s |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    if chosen.iter().any(|c| c == "sweep") {
        [0.012, 0.016, 0.02, 0.024, 0.028, 0.034].iter().for_each(|&c| test(&isotropic(c), 0.012, ""));
        return;
    }
    for (name, [low, high]) in EXPECTED {
        let asked = chosen.iter().filter_map(|c| {
            let (fabric, factor) = c.split_once('*').unwrap_or((c, "1"));
            (fabric == name).then(|| factor.parse().expect("a factor"))
        });
        let factors: Vec<f64> = if chosen.is_empty() { vec![1.0] } else { asked.collect() };
        for factor in factors {
            let fabric = stiffer(&Fabric::preset(name).expect("a preset"), factor);
            let expected = format!("{low} to {high}");
            EDGES.iter().for_each(|&h| test(&fabric, h, &expected));
        }
    }
}
