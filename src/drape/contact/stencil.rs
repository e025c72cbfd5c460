//! Contact and friction as stencils: each a scalar gap between four weighted nodes.
//!
//! A stencil's relative displacement is `s = sum_i w_i u_i`. Its energy `e(s)` has the force
//! vector `f = de/ds`, so that the gradient on node `i` is `w_i f`. Contact has
//! `f = e'(d) n`; friction acts on the part of `s` across `n`. Second derivatives and the
//! Hessian product run on the device: [`super::operator`].

use super::activation::{self, Jet};
use crate::model::Vec3;

/// What a stencil stands for; the values of `kind` in stencil.wgsl.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Barrier on a pair that is on its right side.
    Barrier = 0,
    /// Spring on a pair that starts on the wrong side.
    Spring = 1,
    /// Lagged friction.
    Friction = 2,
    /// A force `stiffness * normal` without stiffness.
    Force = 3,
    /// A spring that pulls where it is longer than its slack length (holding).
    Tension = 4,
}

/// A stencil on the host.
#[derive(Clone, Copy, Debug)]
pub struct Stencil {
    /// What it stands for.
    pub kind: Kind,
    /// Nodes; unused ones repeat the first with weight 0.
    pub nodes: [u32; 4],
    /// Weights.
    pub weights: [f64; 4],
    /// Unit normal.
    pub normal: Vec3,
    /// Gap [m] (contact), length [m] (tension).
    pub gap: f64,
    /// Radius [m] (contact), sticking distance [m] (friction), slack length [m] (tension).
    pub radius: f64,
    /// Stiffness [N/m] (contact, tension), `mu` times normal force [N] (friction), force [N] (force).
    pub stiffness: f64,
}

impl Stencil {
    /// Sum of the weighted displacements.
    pub fn relative(&self, u: &[Vec3]) -> Vec3 {
        (0..4).map(|k| u[self.nodes[k] as usize] * self.weights[k]).sum()
    }

    fn jet(&self, gap: f64) -> Jet {
        match self.kind {
            Kind::Barrier => activation::barrier(gap, self.radius, self.stiffness),
            _ => activation::spring(gap, self.radius, self.stiffness),
        }
    }

    /// Energy [J] and force vector [N], in f64; `moved` are the displacements since the start
    /// of the step (friction).
    pub fn evaluate(&self, moved: &[Vec3]) -> (f64, Vec3) {
        (self.energy(moved), self.force(moved))
    }

    /// Energy [J], see [`Stencil::evaluate`].
    pub fn energy(&self, moved: &[Vec3]) -> f64 {
        match self.kind {
            Kind::Barrier | Kind::Spring => self.jet(self.gap).0,
            Kind::Friction => self.stiffness * activation::friction(self.slip(moved).norm(), self.radius).0,
            Kind::Force => 0.0,
            Kind::Tension => 0.5 * self.stiffness * self.longer() * self.longer(),
        }
    }

    /// Force vector [N], see [`Stencil::evaluate`].
    pub fn force(&self, moved: &[Vec3]) -> Vec3 {
        match self.kind {
            Kind::Barrier | Kind::Spring => self.normal * self.jet(self.gap).1,
            Kind::Friction => {
                let slip = self.slip(moved);
                slip * (self.stiffness * activation::friction(slip.norm(), self.radius).1)
            }
            Kind::Force => self.normal * self.stiffness,
            Kind::Tension => self.normal * (self.stiffness * self.longer()),
        }
    }

    /// The relative displacement across the normal [m].
    fn slip(&self, moved: &[Vec3]) -> Vec3 {
        let s = self.relative(moved);
        s - self.normal * self.normal.dot(&s)
    }

    /// By how much it is longer than its slack length [m].
    fn longer(&self) -> f64 {
        (self.gap - self.radius).max(0.0)
    }

    /// Normal force of a contact [N].
    pub fn normal_force(&self) -> f64 {
        match self.kind {
            Kind::Barrier | Kind::Spring => -self.jet(self.gap).1,
            _ => 0.0,
        }
    }
}
