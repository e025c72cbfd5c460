//! What a step minimises, and its gradient, at one configuration.
//!
//! An evaluation has three stages, so that a trial which is refused costs no more than it must. What
//! the cloth itself resists (its elasticity and inertia) needs no search for pairs, and contact,
//! friction and holding only add to it; the gradient is that of trials which are not refused.

use super::contact::narrow::Contacts;
use super::contact::stencil::Stencil;
use super::elastic::Measured;
use super::simulation::Simulation;
use crate::model::Vec3;

/// What a step minimises over.
pub(super) struct Problem {
    pub start: Vec<Vec3>,
    pub target: Vec<Vec3>,
    pub inertia: f64,
    pub friction: Vec<Stencil>,
}

/// A configuration, and what the cloth itself resists there.
pub(super) struct Placed {
    x: Vec<Vec3>,
    vertices: Vec<Vec3>,
    pub points: Vec<Vec3>,
    measured: Measured,
    /// Elastic and inertial [J]; what is left out is not negative.
    pub energy: f64,
}

/// The same with all that touches.
pub(super) struct Touching {
    placed: Placed,
    moved: Vec<Vec3>,
    contacts: Contacts,
    held: Vec<Stencil>,
    /// [J]
    pub energy: f64,
}

/// The objective and its gradient at one configuration.
pub(super) struct Here {
    /// Node positions [m].
    pub x: Vec<Vec3>,
    pub vertices: Vec<Vec3>,
    pub points: Vec<Vec3>,
    pub moved: Vec<Vec3>,
    pub measured: Measured,
    /// See [`Placed::energy`].
    apart: f64,
    /// [J]
    pub energy: f64,
    pub gradient: Vec<Vec3>,
    pub contacts: Contacts,
    /// Number of the search that the contacts' pairs are of.
    pub search: u64,
    pub held: Vec<Stencil>,
}

impl Simulation<'_> {
    /// The first stage of an evaluation.
    pub(super) fn place(&self, x: Vec<Vec3>, problem: &Problem) -> Placed {
        let vertices = self.offsets.vertices(&x);
        let points = self.contact.scene.sheet.points(&vertices);
        let measured = self.elastic.measure(&vertices);
        let mut energy = measured.energy;
        for i in 0..x.len() {
            let d = x[i] - problem.target[i];
            energy += 0.5 * self.masses[i] * problem.inertia * d.norm_squared();
        }
        Placed { x, vertices, points, measured, energy }
    }

    /// The second stage.
    pub(super) fn touch(&self, placed: Placed, problem: &Problem) -> Touching {
        let moved: Vec<Vec3> = placed.x.iter().zip(&problem.start).map(|(x, s)| x - s).collect();
        let contacts = self.contact.contacts(&placed.points);
        let held = self.hold.stencils(&placed.x);
        let stencils = contacts.stencils.iter().chain(&held).chain(&problem.friction);
        let energy = placed.energy + stencils.map(|s| s.energy(&moved)).sum::<f64>();
        Touching { placed, moved, contacts, held, energy }
    }

    /// The gradient of what was found to be low enough.
    pub(super) fn linearise(&self, found: Touching, problem: &Problem) -> Here {
        let Touching {
            placed: Placed { x, vertices, points, measured, energy: apart },
            moved,
            contacts,
            held,
            energy,
        } = found;
        let mut gradient = self.elastic.gradient_at(&measured);
        for i in 0..x.len() {
            gradient[i] += (x[i] - problem.target[i]) * (self.masses[i] * problem.inertia);
        }
        for stencil in contacts.stencils.iter().chain(&held).chain(&problem.friction) {
            let force = stencil.force(&moved);
            for k in 0..4 {
                gradient[stencil.nodes[k] as usize] += force * stencil.weights[k];
            }
        }
        let search = self.contact.searches();
        Here { x, vertices, points, moved, measured, apart, energy, gradient, contacts, search, held }
    }

    /// All of it.
    pub(super) fn evaluate(&self, x: Vec<Vec3>, problem: &Problem) -> Here {
        self.linearise(self.touch(self.place(x, problem), problem), problem)
    }

    /// Evaluates anew if pairs have been searched since.
    pub(super) fn come_back(&mut self, here: Here, problem: &Problem) -> Here {
        if here.search == self.contact.searches() {
            return here;
        }
        self.contact.keep_up(&here.points);
        let Here { x, vertices, points, measured, apart: energy, .. } = here;
        self.linearise(self.touch(Placed { x, vertices, points, measured, energy }, problem), problem)
    }

    /// Largest force on a free node over the mean node weight.
    pub(super) fn residual(&self, gradient: &[Vec3]) -> f64 {
        let free = gradient.iter().zip(&self.pinned).filter(|(_, pinned)| !**pinned);
        let worst = free.map(|(g, _)| g.norm()).fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
        worst / self.node_weight()
    }
}
