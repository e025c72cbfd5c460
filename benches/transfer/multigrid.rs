//! Conjugate gradients with multigrid at several cell sizes, and the parts of an outer iteration.

use dressform::device::{Buffer, Device};
use dressform::geometry::{Surface, outer_skin, submesh};
use dressform::model::{TriMesh, Vec3};
use dressform::solve::cg::{Cg, CgParams};
use dressform::transfer::Params;
use dressform::transfer::activity::{self, Active, Band, narrow_band};
use dressform::transfer::align::Motion;
use dressform::transfer::boundary::Boundary;
use dressform::transfer::domain::{Domain, Lattice};
use dressform::transfer::field::{Field, Problem};
use dressform::transfer::multigrid::Multigrid;
use dressform::transfer::stencil::Stencil;
use dressform::transfer::terms::Terms;

use crate::input::{Meshes, timed};

/// `beta h^2 / nu` at every cell size.
const STIFFNESS: f64 = 4.0;
/// How near to the solved field the garment's vertices are to come [m].
const NEAR: f64 = 5e-5;

/// The first outer iteration from one body to another.
struct Start {
    surface: Surface,
    displacement: Vec<Vec3>,
    motion: Motion,
}

impl Start {
    fn new(source: &TriMesh, target: &TriMesh) -> Start {
        let (skin, of_body) = submesh(source, &outer_skin(source));
        let goal: Vec<Vec3> = of_body.iter().map(|&i| target.points[i as usize]).collect();
        let motion = Motion::best(&skin.points, &goal, &skin.point_areas());
        let points: Vec<Vec3> = skin.points.iter().map(|p| motion.apply(p)).collect();
        let displacement = points.iter().zip(&goal).map(|(p, q)| q - p).collect();
        Start { surface: Surface::new(TriMesh { points, triangles: skin.triangles }), displacement, motion }
    }

    fn band(&self, params: &Params) -> (Domain, Vec<Active>) {
        let (lo, hi) = self.surface.mesh().bounds().expect("a body");
        let lattice = Lattice { origin: lo, cell: params.cell };
        let band = Band { width: params.band, fade: params.fade };
        let active = narrow_band(&self.surface, lattice, band, &lo, &hi);
        (activity::domain(lattice, &active).expect("of a body's size"), active)
    }

    fn boundary(&self, params: &Params, domain: &Domain, active: &[Active]) -> Boundary {
        Boundary::new(domain, &self.surface, &self.displacement, active, params.beta, params.quadrature)
    }
}

/// Prints iterations, time and memory over the cell size.
pub fn table(meshes: &Meshes) {
    println!(
        "\n## Multigrid: CG iterations until the garments' vertices are within 0.05 mm of the solved field"
    );
    println!(
        "beta h^2 / nu = {STIFFNESS} at every cell size, first outer iteration, linear system; CPU seconds\n"
    );
    println!(
        "| pair | cell cm | cells | nodes per grid | iterations | factor per iteration | set-up s | s per iteration | per million cells | memory MB | bytes per cell |"
    );
    println!("|{}", " --- |".repeat(11));
    for (outfit, target) in
        [("casual_man", "heavy_man"), ("casual_woman", "thin_woman"), ("casual_man", "child_boy")]
    {
        let outfit = meshes.outfit(outfit);
        let start = Start::new(&outfit.body, &meshes.bodies[target]);
        let points: Vec<Vec3> = outfit.points().iter().map(|p| start.motion.apply(p)).collect();
        for cell in [0.04, 0.03, 0.02, 0.015, 0.01] {
            row(&format!("{} on {target}", outfit.name), cell, &start, &points);
        }
    }
}

fn row(name: &str, cell: f64, start: &Start, garment: &[Vec3]) {
    let nu = Params::default().nu;
    let params = Params { cell, beta: STIFFNESS * nu / (cell * cell), ..Params::default() };
    let device = Device::cpu();
    let (domain, active) = start.band(&params);
    let boundary = start.boundary(&params, &domain, &active);
    let terms = Terms::new(&domain, params.nu, params.gamma, &boundary);
    let stencil = Stencil::new(&device, &domain, &terms, &[]).expect("fits");
    let (multigrid, setup) = timed(|| Multigrid::new(&device, &domain, &terms, &[]).expect("fits"));
    let load: Vec<f32> = boundary.load.iter().flat_map(|f| f.map(|c| c as f32).data.0[0]).collect();
    let b = device.upload("load", &load).expect("fits");
    let x: Buffer<f32> = device.zeros("solution", load.len()).expect("fits");
    let cg = Cg::new(&device, load.len()).expect("fits").looking_every(1);
    let cycle = multigrid.over(&stencil);
    let sampled = |iterations: usize| -> (Vec<Vec3>, f64) {
        let limits = CgParams { tolerance: 1e-7, max_iterations: iterations };
        let (_, seconds) =
            timed(|| cg.solve_from_zero(&device, &stencil, &cycle, &b, &x, &limits).expect("runs"));
        let u = device.read(&x).expect("reads");
        let displacement =
            u.chunks_exact(3).map(|u| Vec3::new(u[0].into(), u[1].into(), u[2].into())).collect();
        let field = Field { domain: domain.clone(), displacement };
        (garment.iter().filter_map(|p| field.sample(p)).map(|s| s.0).collect(), seconds)
    };
    let (solved, seconds) = sampled(30);
    let error = |iterations: usize| -> f64 {
        sampled(iterations).0.iter().zip(&solved).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    let errors: Vec<f64> = (1..30).map(error).take_while(|e| *e > NEAR).collect();
    let cells = domain.cells.len();
    let factor = (errors.last().unwrap_or(&1.0) / errors[0]).powf(1.0 / (errors.len().max(2) - 1) as f64);
    println!(
        "| {name} | {:.1} | {cells} | {:?} | {} | {factor:.2} | {setup:.2} | {:.3} | {:.2} | {:.1} | {:.0} |",
        100.0 * cell,
        multigrid.nodes(),
        errors.len() + 1,
        seconds / 30.0,
        seconds / 30.0 / cells as f64 * 1e6,
        multigrid.bytes() as f64 / 1e6,
        multigrid.bytes() as f64 / cells as f64,
    );
}

/// Prints where the time of a first outer iteration goes.
pub fn stages(meshes: &Meshes) {
    println!("\n## Parts of the first outer iteration, CPU seconds\n");
    println!(
        "| pair | cell cm | surface | band | boundary | system and grids | inner loop | CG iterations |"
    );
    println!("|{}", " --- |".repeat(8));
    let outfit = meshes.outfit("casual_man");
    for (cell, band) in [(0.02, 0.12), (0.01, 0.04)] {
        let device = Device::cpu();
        let params = Params { cell, band, fade: 0.0, ..Params::default() };
        let (start, surface) = timed(|| Start::new(&outfit.body, &meshes.bodies["heavy_man"]));
        let ((domain, active), band) = timed(|| start.band(&params));
        let (boundary, integral) = timed(|| start.boundary(&params, &domain, &active));
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let (problem, setup) =
            timed(|| Problem::new(&device, &params, &domain, boundary, &[], &u).expect("fits"));
        let (info, inner) = timed(|| problem.solve(&mut u).expect("runs"));
        let iterations: usize = info.cg_iterations.iter().sum();
        println!(
            "| heavy_man | {} | {surface:.2} | {band:.2} | {integral:.2} | {setup:.2} | {inner:.2} | {iterations} |",
            100.0 * cell
        );
    }
}
