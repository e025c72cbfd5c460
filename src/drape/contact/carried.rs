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
use super::pairs::{Mode, Pair, Role};
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
            let (corners, _) = self.scene.corners(pair, x);
            ccd::free_share(pair.role.shape(), corners, self.corner_moves(pair, dx, moves), 1.0)
        };
        pairs.par_iter().map(share).reduce(|| 1.0, f64::min)
    }

    /// How the corners of a pair move, in the order of [`super::pairs::Scene::corners`].
    fn corner_moves(&self, pair: &Pair, dx: &[Vec3], moves: &[Vec<Vec3>]) -> [Vec3; 4] {
        let (sheet, a, b) = (&self.scene.sheet, pair.a as usize, pair.b as usize);
        let c = pair.collider as usize;
        let own = |i: u32| dx[i as usize];
        let its = |i: u32| moves[c][i as usize];
        match pair.role {
            Role::OwnFace => {
                let t = sheet.triangles[b];
                [dx[a], own(t[0]), own(t[1]), own(t[2])]
            }
            Role::OwnEdges => {
                let (p, q) = (sheet.edges.ends[a], sheet.edges.ends[b]);
                [own(p[0]), own(p[1]), own(q[0]), own(q[1])]
            }
            Role::OnCollider => {
                let t = self.scene.colliders[c].mesh().triangles[b];
                [dx[a], its(t[0]), its(t[1]), its(t[2])]
            }
            Role::UnderCloth => {
                let t = sheet.triangles[b];
                [its(pair.a), own(t[0]), own(t[1]), own(t[2])]
            }
            Role::EdgeCollider => {
                let (p, q) = (sheet.edges.ends[a], self.scene.colliders[c].edges.ends[b]);
                [own(p[0]), own(p[1]), its(q[0]), its(q[1])]
            }
        }
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
