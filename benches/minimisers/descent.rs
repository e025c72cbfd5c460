//! Vertex block descent [Chen et al. 2024]: each node in turn to the minimum of the objective's
//! quadratic model in its place alone, colour by colour, with Chebyshev acceleration.
//!
//! The local Hessian is projected: stretch as the drape's, bending Gauss-Newton. Nodes of a colour
//! share no element, so that their order does not matter (on a GPU they move at once).

use dressform::drape::cloth::Cloth;
use dressform::drape::elastic::element::{self, BendElement, NONE};
use dressform::drape::elastic::hinge::{self, HingeRest};
use dressform::drape::elastic::stretch::{self, StretchRest};
use dressform::model::Vec3;
use nalgebra::Matrix3;

use crate::problem::{GRAVITY, Problem, Step};
use crate::settling::{Minimiser, Until, Watch};

/// Sweeps after which the objective and the net force are looked at, off the clock.
const LOOK: usize = 10;
/// Marks a hinge that a node is not part of.
const ELSEWHERE: u8 = u8::MAX;

/// What a node takes part in.
#[derive(Clone, Default)]
struct Around {
    /// Triangles, and which corner of them it is.
    triangles: Vec<(u32, u8)>,
    /// Hinges, and which of their points it is.
    hinges: Vec<(u32, u8)>,
    /// Bending elements, and where each of their hinges is among `hinges`.
    elements: Vec<(u32, [u8; 3])>,
}

pub struct Descent {
    stretch: Vec<StretchRest<f64>>,
    triangles: Vec<[u32; 3]>,
    hinges: Vec<([u32; 4], HingeRest<f64>)>,
    elements: Vec<([u32; 3], [f64; 9])>,
    around: Vec<Around>,
    /// Free nodes by colour.
    colours: Vec<Vec<u32>>,
    /// Bends of the hinges where the nodes are [rad].
    bends: Vec<f64>,
    /// The spectral radius that the acceleration takes a sweep to have; 0 is none.
    radius: f64,
    /// How far each node went in the step before [m].
    moved: Vec<Vec3>,
}

impl Descent {
    pub fn new(problem: &Problem, radius: f64) -> Descent {
        let cloth = &problem.cloth;
        let bending = element::bend_elements(cloth);
        let weights = |e: &BendElement| std::array::from_fn(|k| e.weights[k / 3][k % 3]);
        let triangles: Vec<[u32; 3]> = (0..cloth.triangles.len()).map(|t| cloth.nodes(t)).collect();
        let hinges: Vec<_> = cloth
            .hinges
            .iter()
            .map(|h| (element::hinge_nodes(cloth, h), element::hinge_rest(cloth, h)))
            .collect();
        Descent {
            stretch: (0..triangles.len()).map(|t| element::stretch_rest(cloth, t)).collect(),
            around: around(cloth, &triangles, &hinges, &bending),
            colours: colours(&problem.held, &bending),
            bends: vec![0.0; hinges.len()],
            triangles,
            hinges,
            elements: bending.iter().map(|e| (e.hinges, weights(e))).collect(),
            radius,
            moved: Vec::new(),
        }
    }

    fn bend(&self, h: u32, x: &[Vec3]) -> f64 {
        let (nodes, rest) = &self.hinges[h as usize];
        let [e, a, b] = edges(nodes, x);
        hinge::bend(rest.angle, hinge::angle(&e, &a, &b))
    }

    fn measure(&mut self, x: &[Vec3]) {
        self.bends = (0..self.hinges.len() as u32).map(|h| self.bend(h, x)).collect();
    }

    /// Gradient [N] and projected Hessian [N/m] of the elastic energy in the place of node `i`.
    fn local(&self, i: usize, x: &[Vec3]) -> (Vec3, Matrix3<f64>) {
        let (mut gradient, mut hessian) = (Vec3::zeros(), Matrix3::zeros());
        let around = &self.around[i];
        for &(t, corner) in &around.triangles {
            let rest = &self.stretch[t as usize];
            let [a, b, c] = self.triangles[t as usize].map(|n| x[n as usize]);
            let reference = stretch::reference(stretch::columns(rest, [b - a, c - a]));
            let s = stretch::stretch(&reference, [Vec3::zeros(); 2]);
            let [u, v] = stretch::shapes(rest)[corner as usize];
            let [w, f] = stretch::gradient(rest, &s);
            gradient += w * u + f * v;
            let [ww, wf, ff] = stretch::hessian(rest, &s);
            hessian += ww * (u * u) + (wf + wf.transpose()) * (u * v) + ff * (v * v);
        }
        let turn = |&(h, point): &(u32, u8)| {
            let (nodes, rest) = &self.hinges[h as usize];
            let [e, a, b] = edges(nodes, x);
            hinge::gradient(rest, &e, &a, &b)[point as usize]
        };
        let turns: Vec<Vec3> = around.hinges.iter().map(turn).collect();
        for (element, own) in &around.elements {
            let (hinges, weights) = &self.elements[*element as usize];
            let amounts = element::amounts(hinges, weights, |h| self.bends[h]);
            for row in 0..3 {
                let of_row = (0..3).filter(|&k| own[k] != ELSEWHERE);
                let by_place: Vec3 = of_row.map(|k| turns[own[k] as usize] * weights[3 * row + k]).sum();
                gradient += by_place * amounts[row];
                hessian += by_place * by_place.transpose();
            }
        }
        (gradient, hessian)
    }

    /// Moves every free node once.
    fn sweep(&mut self, problem: &Problem, step: &Step, x: &mut [Vec3]) {
        for colour in 0..self.colours.len() {
            for k in 0..self.colours[colour].len() {
                let i = self.colours[colour][k] as usize;
                let (mut gradient, mut hessian) = self.local(i, x);
                let m = problem.cloth.masses[i];
                gradient += (x[i] - step.from[i]) * (m * step.inertia) + Vec3::y() * (m * GRAVITY);
                hessian += Matrix3::identity() * (m * step.inertia);
                x[i] -= hessian.try_inverse().expect("inertia makes it definite") * gradient;
                for n in 0..self.around[i].hinges.len() {
                    let h = self.around[i].hinges[n].0;
                    self.bends[h as usize] = self.bend(h, x);
                }
            }
        }
    }

    /// The adaptive guess: beyond inertia every node falls as far as in the step before, at most freely.
    fn guess(&self, problem: &Problem, step: &Step, x: &mut [Vec3]) {
        let free_fall = GRAVITY / step.inertia;
        for i in (0..x.len()).filter(|&i| !problem.held[i]) {
            let fell = self.moved.get(i).map_or(free_fall, |moved| -moved.y);
            x[i] = step.from[i] - Vec3::y() * fell.clamp(0.0, free_fall);
        }
    }

    /// The free nodes' largest errors at `x`: of the local gradients against the judge's and of the
    /// local Hessians against the matrix' diagonal blocks `hessian`, as shares of the largest.
    pub fn errors(&mut self, problem: &Problem, hessian: &[Matrix3<f64>], x: &[Vec3]) -> [f64; 2] {
        self.measure(x);
        let judged = problem.elastic_gradient(x);
        let free = || (0..x.len()).filter(|&i| !problem.held[i]);
        let scale = free().map(|i| judged[i].norm()).fold(0.0, f64::max);
        let stiff = free().map(|i| hessian[i].norm()).fold(0.0, f64::max);
        let mut errors = [0.0f64; 2];
        for i in free() {
            let (g, h) = self.local(i, x);
            errors[0] = errors[0].max((g - judged[i]).norm() / scale);
            errors[1] = errors[1].max((h - hessian[i]).norm() / stiff);
        }
        errors
    }
}

fn edges(nodes: &[u32; 4], x: &[Vec3]) -> [Vec3; 3] {
    let [p0, p1, p2, p3] = nodes.map(|n| x[n as usize]);
    [p1 - p0, p2 - p0, p3 - p0]
}

fn around(
    cloth: &Cloth,
    triangles: &[[u32; 3]],
    hinges: &[([u32; 4], HingeRest<f64>)],
    bending: &[BendElement],
) -> Vec<Around> {
    let mut around = vec![Around::default(); cloth.node_count];
    for (t, nodes) in (0..).zip(triangles) {
        (0..).zip(nodes).for_each(|(k, &n): (u8, &u32)| around[n as usize].triangles.push((t, k)));
    }
    for (h, (nodes, _)) in (0..).zip(hinges) {
        (0..).zip(nodes).for_each(|(k, &n): (u8, &u32)| around[n as usize].hinges.push((h, k)));
    }
    for (e, element) in (0..).zip(bending) {
        for &n in element.nodes.iter().filter(|n| **n != NONE) {
            let around = &mut around[n as usize];
            let place = |code: u32| {
                let own = around.hinges.iter().position(|(h, _)| code != NONE && *h == code / 4);
                own.map_or(ELSEWHERE, |place| place as u8)
            };
            let own = element.hinges.map(place);
            around.elements.push((e, own));
        }
    }
    around
}

/// Greedy colours of the free nodes; no two of a colour share a bending element.
fn colours(held: &[bool], bending: &[BendElement]) -> Vec<Vec<u32>> {
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); held.len()];
    for element in bending {
        for &n in element.nodes.iter().filter(|n| **n != NONE) {
            beside[n as usize].extend(element.nodes.iter().filter(|m| **m != NONE && **m != n));
        }
    }
    let mut colour_of = vec![usize::MAX; held.len()];
    let mut colours: Vec<Vec<u32>> = Vec::new();
    for i in (0..held.len()).filter(|&i| !held[i]) {
        let taken = |c: usize| beside[i].iter().any(|&j| colour_of[j as usize] == c);
        let colour = (0..).find(|&c| !taken(c)).expect("there are always more colours");
        colour_of[i] = colour;
        if colour == colours.len() {
            colours.push(Vec::new());
        }
        colours[colour].push(i as u32);
    }
    colours
}

impl Minimiser for Descent {
    fn minimise(
        &mut self,
        problem: &Problem,
        step: &Step,
        until: Until,
        x: &mut Vec<Vec3>,
        watch: &mut Watch,
    ) -> bool {
        self.guess(problem, step, x);
        self.measure(x);
        let (mut omega, mut older) = (1.0, x.clone());
        let first = watch.aside(|| problem.evaluate(&step.from, step).energy);
        let mut last = watch.aside(|| problem.evaluate(x, step).energy);
        for sweep in 1..=until.most {
            let before = x.clone();
            self.sweep(problem, step, x);
            if omega > 1.0 {
                x.iter_mut().zip(&older).for_each(|(x, old)| *x = (*x - old) * omega + old);
                self.measure(x);
            }
            omega = next_omega(omega, self.radius);
            older = before;
            watch.iterations += 1;
            if sweep % LOOK > 0 && sweep < until.most {
                continue;
            }
            let here = watch.aside(|| problem.evaluate(x, step));
            watch.look(here.net);
            let converged = problem.residual(&here.gradient) <= until.tolerance;
            let gained = last - here.energy;
            if watch.over() || converged || (gained >= 0.0 && gained < until.gain * (first - here.energy)) {
                break;
            }
            if gained < 0.0 {
                omega = 1.0; // the acceleration overshoots: it starts anew
            }
            last = here.energy;
        }
        self.moved = x.iter().zip(&step.from).map(|(x, from)| x - from).collect();
        true
    }
}

/// The weight of the next iterate against the one before the last [Chen et al. 2024, section 3.8].
fn next_omega(omega: f64, radius: f64) -> f64 {
    let square = radius * radius;
    if omega == 1.0 { 2.0 / (2.0 - square) } else { 4.0 / (4.0 - square * omega) }
}
