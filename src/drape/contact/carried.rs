//! Colliders that move, and cloth that is carried along.
//!
//! Time steps see colliders that stand still ([`super::pairs`]). Between two steps the colliders
//! go to their next place, and the cloth near them with them: a joint move along straight lines,
//! which [`Contact::carry`] makes as far as no clean pair touches. After it the cloth is as clean
//! as it was.

use rayon::prelude::*;

use super::Contact;
use super::ccd;
use super::fixed::Fixed;
use super::pairs::{Mode, Pair};
use super::search::{Among, Beyond};
use crate::model::Vec3;

/// Least distance at which pairs are looked for, beyond what moves can bridge [m].
const REACH: f64 = 1e-3;

impl<'a> Contact<'a> {
    /// The share of a joint move (at most 1) that no clean pair forbids: contact points from `x`
    /// by `dx`, the points of collider `c` by `moves[c]`.
    pub fn carried_share(&self, x: &[Vec3], dx: &[Vec3], moves: &[Vec<Vec3>]) -> f64 {
        let longest = |list: &[Vec3]| list.iter().map(Vec3::norm_squared).fold(0.0, f64::max).sqrt();
        let colliders = moves.iter().map(|m| longest(m)).fold(0.0, f64::max);
        let beyond = Beyond { collider: longest(dx) + colliders + REACH, own: 2.0 * longest(dx) + REACH };
        let pairs = self.scene.pairs(x, &self.radii, beyond, &self.tangles, Among(None));
        let share = |pair: &Pair| {
            if !matches!(pair.mode, Mode::Clean) {
                return 1.0;
            }
            let its = |i: u32| moves[pair.collider as usize][i as usize];
            let moves = self.scene.of_corners(pair, |i| dx[i as usize], its);
            ccd::free_share(pair.role.shape(), self.scene.corners(pair, x), moves, 1.0)
        };
        pairs.par_iter().map(share).reduce(|| 1.0, f64::min)
    }

    /// Puts colliders where they are now. `x` are the contact points; where the move was `clean`
    /// ([`Contact::carried_share`] was 1) what was clean still is.
    pub fn replace_colliders(&mut self, colliders: Vec<Fixed<'a>>, x: &[Vec3], clean: bool) {
        self.scene.colliders = colliders;
        if clean && self.tangles.is_clean() {
            self.build(x);
        } else {
            self.classify(x);
        }
    }
}

/// A joint move longer than this is better made in parts [m]: the pairs that it can bring
/// together grow with its square.
pub const LONGEST_MOVE: f64 = 0.012;
