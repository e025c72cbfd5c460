//! Which minimiser brings cloth to rest in the least CPU time: the drape's own against its rivals,
//! over the same energies, from the same start, by the same quasi-static steps, without contact.
//!
//! ```text
//! cargo bench --bench minimisers -- [limit=30] [sizes=3] [WORD ...]
//! ```
//! Cotton hangs from a disc clamped in its middle (Cusick's test) and as a square from two corners,
//! each at three sizes. Prints a Markdown table for each: CPU seconds of one thread until the
//! largest net force on a node, in `f64`, is below 1, 0.1 and 0.05 mean node weights for the first
//! time, iterations, and in which equilibrium it ends. Words choose among the tables' names and the
//! minimisers'; `limit` is the CPU seconds of a run, `sizes` how many of the sizes are taken.
//!
//! Ends that are at rest are polished to a net force of a millionth; those with the same energy then
//! are the same equilibrium, and what polishing gained is asserted to be small.

#[path = "shared/clock.rs"]
mod clock;
#[path = "minimisers/descent.rs"]
mod descent;
#[path = "shared/disc.rs"]
mod disc;
#[path = "minimisers/newton.rs"]
mod newton;
#[path = "minimisers/problem.rs"]
mod problem;
#[path = "minimisers/settling.rs"]
mod settling;

use std::io::Write;

use dressform::device::Device;
use dressform::drape::{self, Input, Params};
use dressform::model::Vec3;

use descent::Descent;
use newton::Newton;
use problem::{Problem, Step};
use settling::{BARS, Minimiser, Until, Watch, fall, settle};

/// CPU seconds of a run.
const LIMIT: f64 = 30.0;
/// Spectral radii that the acceleration of block descent takes a sweep to have: in quasi-static steps
/// and in short time steps. Not tuned but for what does not diverge: 0.99 and 0.8 are worse.
const RADII: [f64; 2] = [0.95, 0.5];
/// Length [s] of the time steps, sweeps in each, and drag [1/s].
const TIME_STEPS: (f64, usize, f64) = (1.0 / 60.0, 20, 3.0);
/// Net force down to which ends are polished [mean node weights].
const POLISHED: f64 = 1e-6;
/// Polished ends whose energies differ by less than this share of what the start had to lose are the
/// same equilibrium.
const SAME: f64 = 1e-6;
/// Largest share of it that polishing may gain.
const GAINED: f64 = 1e-3;

/// How a run takes the cloth to rest.
type Run = dyn Fn(&Problem, &mut Watch) -> Vec<Vec3>;

/// A case by name, coarse to fine.
type Case = (&'static str, fn() -> Vec<Problem>);

/// The minimisers by name.
fn candidates() -> Vec<(&'static str, Box<Run>)> {
    type Named = (&'static str, Box<Run>);
    fn newton(name: &'static str, make: impl Fn(&Problem) -> Newton + 'static) -> Named {
        (name, Box::new(move |p: &Problem, w: &mut Watch| settle(p, &mut make(p), w)))
    }
    let descent = |p: &Problem, w: &mut Watch| settle(p, &mut Descent::new(p, RADII[0]), w);
    let falling = |p: &Problem, w: &mut Watch| fall(p, &mut Descent::new(p, RADII[1]), TIME_STEPS, w);
    vec![
        ("the drape, looking for contact", Box::new(drape)),
        newton("Newton, Cholesky, true Hessian", Newton::factored),
        newton("Newton, two-level CG, true Hessian", |p| Newton::two_level(p, true)),
        newton("Newton, two-level CG, projected", |p| Newton::two_level(p, false)),
        newton("Newton, block-Jacobi CG, projected", Newton::block_jacobi),
        ("vertex block descent", Box::new(descent)),
        ("vertex block descent, time steps", Box::new(falling)),
    ]
}

/// The drape as it is, looked at after each step. It ends by itself.
fn drape(problem: &Problem, watch: &mut Watch) -> Vec<Vec3> {
    let held: Vec<u32> = (0..).zip(&problem.held).filter(|(_, h)| **h).map(|(v, _)| v).collect();
    let garment = &problem.garment;
    let input = Input { pinned: &held, ..Input::alone(garment) };
    let params = Params { frames: 0, rest_tolerance: BARS[2], ..Params::default() };
    let output = drape::run_with_progress(&Device::cpu(), &input, &params, &mut |moment| {
        let net = watch.aside(|| problem.potential(&moment.points()).net);
        watch.look(net);
    })
    .expect("the cloth drapes");
    (watch.iterations, watch.linear) = (output.info.newton_iterations, output.info.cg_iterations);
    // It holds pinned nodes by a great mass, which lets them slip by micrometres.
    let held = problem.held.iter().zip(&garment.points).zip(output.points);
    held.map(|((held, start), end)| if *held { *start } else { end }).collect()
}

/// An end that was polished.
struct Rest {
    energy: f64,
    /// What polishing gained [J].
    gained: f64,
}

fn polish(problem: &Problem, x: &[Vec3]) -> Rest {
    let mut newton = Newton::factored(problem);
    let before = problem.potential(x).energy;
    let mut x = x.to_vec();
    for _ in 0..4 {
        let step = Step { from: x.clone(), inertia: 1.0 };
        let until = Until { tolerance: POLISHED, gain: 0.0, most: 200 };
        newton.minimise(problem, &step, until, &mut x, &mut Watch::start(f64::INFINITY));
    }
    let here = problem.potential(&x);
    assert!(here.net < 2.0 * POLISHED, "polished to {}", here.net);
    Rest { energy: here.energy, gained: before - here.energy }
}

/// A size of a case, and the energies of the equilibria that were found [J].
struct Size {
    problem: Problem,
    equilibria: Vec<f64>,
}

impl Size {
    /// The letter of the equilibrium near `x`.
    fn equilibrium(&mut self, x: &[Vec3]) -> char {
        let Rest { energy, gained } = polish(&self.problem, x);
        let scale = self.problem.potential(&self.problem.garment.points).energy - energy;
        assert!((-SAME..GAINED).contains(&(gained / scale)), "polishing gained {}", gained / scale);
        let known = self.equilibria.iter().position(|e| (e - energy).abs() < SAME * scale);
        let index = known.unwrap_or_else(|| {
            self.equilibria.push(energy);
            self.equilibria.len() - 1
        });
        (b'A' + index as u8) as char
    }

    /// Runs a minimiser; its cell of the table, and whether it came to rest.
    fn cell(&mut self, run: &Run, limit: f64) -> (String, bool) {
        let mut watch = Watch::start(limit);
        let x = run(&self.problem, &mut watch);
        let seconds = watch.reached.map(|s| s.map_or("–".to_owned(), |s| format!("{s:.2}"))).join(" / ");
        let linear = if watch.linear > 0 { format!(" ({})", watch.linear) } else { String::new() };
        let end = if watch.at_rest() {
            self.equilibrium(&x).to_string()
        } else {
            format!("{:.2} left after {:.0} s", watch.net, watch.seconds())
        };
        (format!("{seconds}; {}{linear}; {end}", watch.iterations), watch.at_rest())
    }
}

/// Prints the table of a case. A minimiser that did not come to rest is not tried on finer cloth.
fn table(title: &str, problems: Vec<Problem>, chosen: &dyn Fn(&str) -> bool, limit: f64) {
    let mut sizes: Vec<Size> =
        problems.into_iter().map(|problem| Size { problem, equilibria: Vec::new() }).collect();
    println!("\n{title}\n");
    let heads = sizes.iter().map(|s| format!(" {} nodes |", s.problem.cloth.node_count));
    println!("| minimiser |{}", heads.collect::<String>());
    println!("|{}", " --- |".repeat(1 + sizes.len()));
    for (name, run) in candidates().iter().filter(|(name, _)| chosen(name)) {
        print!("| {name} |");
        let mut rests = true;
        for size in &mut sizes {
            let cell;
            (cell, rests) = if rests { size.cell(run, limit) } else { (String::new(), false) };
            print!(" {cell} |");
            std::io::stdout().flush().expect("prints");
        }
        println!();
    }
    for size in &sizes {
        let energies: Vec<String> = size.equilibria.iter().map(|e| format!("{:.3}", 1e3 * e)).collect();
        println!("\n{} nodes, equilibria [mJ]: {}", size.problem.cloth.node_count, energies.join(", "));
    }
}

/// Asserts that block descent's local derivatives are those of the crate's energy, on cloth that is
/// stretched, sheared and bent.
fn verify(problem: &Problem) {
    let bent = |p: &Vec3| Vec3::new(1.1 * p.x + 0.1 * p.z, 0.02 * (30.0 * p.x - 20.0 * p.z).sin(), 0.9 * p.z);
    let x: Vec<Vec3> = problem.garment.points.iter().map(bent).collect();
    let hessian = Newton::block_jacobi(problem).diagonal(problem, &x);
    let [gradient, hessian] = Descent::new(problem, 0.0).errors(problem, &hessian, &x);
    assert!(gradient < 1e-12, "local gradients are wrong by {gradient:e}");
    assert!(hessian < 1e-5, "local Hessians are wrong by {hessian:e} (the matrix is f32)");
}

/// The number of an argument `name=number`.
fn option(arguments: &[String], name: &str) -> Option<f64> {
    let value = arguments.iter().find_map(|a| a.strip_prefix(name)?.strip_prefix('='))?;
    Some(value.parse().expect("a number"))
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let limit = option(&arguments, "limit").unwrap_or(LIMIT);
    let sizes = option(&arguments, "sizes").map_or(usize::MAX, |n| n as usize);
    let cases: [Case; 2] = [
        ("Disc", || [0.012, 0.006, 0.003].map(Problem::disc).into()),
        ("Sheet", || [25, 48, 95].map(Problem::sheet).into()),
    ];
    let is_case = |word: &String| cases.iter().any(|(case, _)| *case == word.as_str());
    let words = arguments.into_iter().filter(|a| !a.contains('='));
    let (chosen_cases, others): (Vec<String>, Vec<String>) = words.partition(is_case);
    let chosen = |name: &str| others.is_empty() || others.iter().any(|word| name.contains(word.as_str()));
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    one_thread.install(|| {
        for (case, problems) in &cases {
            if !chosen_cases.is_empty() && !chosen_cases.iter().any(|c| c == case) {
                continue;
            }
            let problems: Vec<Problem> = problems().into_iter().take(sizes).collect();
            verify(&problems[0]);
            table(case, problems, &chosen, limit);
        }
    });
}
