//! Colliders that move, and cloth that is carried along.
//!
//! Time steps see colliders that stand still ([`super::pairs`]). Between two steps the colliders
//! go to their next place, and the cloth near them with them: a joint move along straight lines,
//! made as far as no clean pair touches. After it the cloth is as clean as it was.

use rayon::prelude::*;

use super::Contact;
use super::fixed::Fixed;
use super::pairs::Mode;
use super::search::{Among, Beyond};
use crate::model::Vec3;

/// Least distance at which pairs are looked for, beyond what moves can bridge [m].
const REACH: f64 = 1e-3;

impl<'a> Contact<'a> {
    /// The share of a joint move (at most 1) that no clean pair forbids: contact points from `x`
    /// by `dx`, the points of collider `c` by `moves[c]`.
    pub fn carried_share(&self, x: &[Vec3], dx: &[Vec3], moves: &[Vec<Vec3>]) -> f64 {
        if self.tangles.is_clean() {
            return self.scene.swept_share(x, dx, moves);
        }
        let longest = |list: &[Vec3]| list.iter().map(Vec3::norm_squared).fold(0.0, f64::max).sqrt();
        let colliders = moves.iter().map(|m| longest(m)).fold(0.0, f64::max);
        let beyond = Beyond { collider: longest(dx) + colliders + REACH, own: 2.0 * longest(dx) + REACH };
        let pairs = self.scene.pairs(x, &self.radii, beyond, &self.tangles, Among(None));
        let clean = pairs.par_iter().filter(|pair| matches!(pair.mode, Mode::Clean));
        clean.map(|pair| self.scene.free_share(pair, x, (dx, moves), 1.0)).reduce(|| 1.0, f64::min)
    }

    /// Puts other colliders in their place; returns the ones before. `x` are the contact points;
    /// where the move was `clean` ([`Contact::carried_share`] was 1) what was clean still is.
    pub fn replace_colliders(
        &mut self,
        colliders: Vec<Fixed<'a>>,
        x: &[Vec3],
        clean: bool,
    ) -> Vec<Fixed<'a>> {
        let before = std::mem::replace(&mut self.scene.colliders, colliders);
        self.classified_at.clear();
        if clean && self.tangles.is_clean() {
            self.build(x);
        } else {
            self.built_at.clear();
            self.classify(x);
        }
        before
    }
}
