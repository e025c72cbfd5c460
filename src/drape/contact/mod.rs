//! Contact: which primitives are near, how they resist, and how far they may move.
//!
//! *Clean* pairs (point and triangle, edge and edge; cloth against collider and cloth against
//! itself) resist by a barrier over their distance and are never crossed: a move is cut
//! where additive continuous collision detection says so, which keeps clean what is clean.
//! *Tangled* primitives are found by exact orientation tests, pseudo-normals and winding
//! numbers ([`crossing`]) where a step starts, and get springs instead, which may pass; once
//! they are through, the next step counts them as clean. Springs act along the signed distance
//! of tangled pairs, and towards *aims* ([`aim`]) of points inside of a collider, of regions
//! inside of another part of the garment ([`regions`]) and of intersection contours
//! ([`contour`]). Cloth that is tangled with the folds of a lower layer is lifted over them first
//! ([`lift`]); what is caught in a slot too narrow for it is carried out ([`pinch`]).
//!
//! The sides of tangled pairs: a collider's outward pseudo-normal; for two parts of one
//! garment that are close on the source body, the side that they have to each other there; for
//! others, the side of the larger region.
//!
//! Broad phase, narrow phase and collision detection run on the host in f64; potentials,
//! their derivatives and the Hessian product run on the device ([`operator`]).

pub mod activation;
pub mod aim;
pub mod carried;
pub mod ccd;
pub mod contour;
pub mod crossing;
pub mod distance;
pub mod fixed;
mod kernels;
mod lift;
pub mod narrow;
pub mod operator;
pub mod pairs;
mod pinch;
pub mod regions;
pub mod search;
pub mod sheet;
pub mod stencil;
mod swept;
pub mod tree;

use rayon::prelude::*;

use aim::Aim;
use crossing::Tangles;
use narrow::Contacts;
use pairs::{Mode, Pair, Radii, Scene};
use search::{Among, Beyond};

use crate::device::Kernel;
use crate::model::Vec3;

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = kernels::KERNELS;

/// How far a contact point may move before pairs are searched again [m].
const BUDGET: f64 = 2e-3;
/// The same while anything is tangled: springs find what is this much farther away than a radius.
const TANGLED_BUDGET: f64 = 3e-3;

/// Shares of the budget that a point has moved by when its pairs are searched again: before a move,
/// where most of the budget should be left for it, and on the way.
const ASIDE: [f64; 2] = [0.2, 0.5];

/// A move longer than what is left by less is none longer [m].
const ROUNDING: f64 = 1e-12;

/// Longest move in an iteration [m].
const LONGEST: f64 = 0.05;

/// Pairs that a CPU task takes at least.
const PAIRS: usize = 1024;

/// What the cloth may pass through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Passing {
    /// What it is tangled with.
    Tangled,
    /// Lower layers, around what is tangled with them, see [`Contact::lift`].
    Layers,
    /// Colliders, where it is caught in their slots, see [`Contact::carry_out`].
    Slots,
    /// The kinds of things that it is tangled with, within a few edges of a tangle, see
    /// [`Contact::loosen`].
    Around,
    /// Everything; only aims act, see [`Contact::let_through`].
    All,
}

/// The contact problem of one garment.
pub struct Contact<'a> {
    /// Cloth and colliders.
    pub scene: Scene<'a>,
    radii: Radii,
    /// A pair's stiffness [N/m].
    stiffness: f64,
    tangles: Tangles,
    pairs: Vec<Pair>,
    aims: Vec<Aim>,
    /// Where each contact point was when its pairs were found; empty before the first search.
    built_at: Vec<Vec3>,
    /// Where everything was last classified; empty where that counts no more.
    classified_at: Vec<Vec3>,
    searches: u64,
    passing: Passing,
    /// Contact points that may pass, where that are not all.
    free: Vec<bool>,
}

impl<'a> Contact<'a> {
    /// Sets the problem up, classified at the contact points `x`.
    pub fn new(scene: Scene<'a>, radii: Radii, stiffness: f64, x: &[Vec3]) -> Contact<'a> {
        let mut contact = Contact {
            scene,
            radii,
            stiffness,
            tangles: Tangles::default(),
            pairs: Vec::new(),
            aims: Vec::new(),
            built_at: Vec::new(),
            classified_at: Vec::new(),
            searches: 0,
            passing: Passing::Tangled,
            free: Vec::new(),
        };
        contact.classify(x);
        contact
    }

    /// What was tangled at the last classification.
    pub fn tangles(&self) -> &Tangles {
        &self.tangles
    }

    /// How often pairs have been searched.
    pub fn searches(&self) -> u64 {
        self.searches
    }

    /// Finds what is tangled at `x`, and the pairs there.
    pub fn classify(&mut self, x: &[Vec3]) {
        let held = self.passing == Passing::Tangled && !self.built_at.is_empty();
        if held && self.classified_at == x {
            return;
        }
        let was_clean = held && self.tangles.is_clean();
        self.tangles = Tangles::find(&self.scene.sheet, &self.scene.colliders, x);
        self.classified_at = x.to_vec();
        if was_clean && self.tangles.is_clean() {
            self.keep_up(x); // its pairs are all clean, as they were
            return;
        }
        self.aims = aim::aims(&self.scene, &self.tangles, &self.radii, x);
        self.passing = Passing::Tangled;
        self.build(x);
    }

    /// Keeps nothing but the aims of points inside of solids, until the next classification.
    pub fn let_through(&mut self, x: &[Vec3]) {
        self.tangles.find_inside(&self.scene.sheet, &self.scene.colliders, x);
        self.aims = aim::out_of_colliders(&self.scene, &self.tangles, &self.radii, x);
        self.pairs.clear();
        self.built_at = x.to_vec();
        self.passing = Passing::All;
    }

    /// Until the next classification, lets the cloth around tangles with lower layers through these,
    /// with aims over what lies above it; returns whether there are any.
    pub fn lift(&mut self, x: &[Vec3]) -> bool {
        let (over, free) = lift::over_layers(&self.scene, &self.tangles, &self.radii, x);
        if over.is_empty() {
            return false;
        }
        self.free = free;
        self.aims.retain(|aim| aim.of_solid);
        self.aims.extend(over);
        self.passing = Passing::Layers;
        self.build(x);
        true
    }

    /// Until the next classification, lets cloth up to so many `rings` of edges from a tangle through
    /// whatever is tangled (itself or a collider), without aims: what its neighbours pull out by
    /// itself needs no push.
    pub fn loosen(&mut self, x: &[Vec3], rings: usize) {
        self.aims.clear();
        self.free = self.tangles.around(&self.scene.sheet, rings);
        self.passing = Passing::Around;
        self.build(x);
    }

    /// Until the next classification, lets what is caught in narrow slots of colliders through
    /// these, with aims out of the slots; returns whether there is anything.
    pub fn carry_out(&mut self, x: &[Vec3]) -> bool {
        let out = pinch::out_of_slots(&self.scene, &self.tangles, &self.radii, x);
        if out.is_empty() {
            return false;
        }
        self.free = vec![false; x.len()];
        out.iter().for_each(|aim| self.free[aim.points[0] as usize] = true);
        self.aims.retain(|aim| !aim.points.iter().any(|&p| self.free[p as usize]));
        self.aims.extend(out);
        self.passing = Passing::Slots;
        self.build(x);
        true
    }

    /// How deep the deepest point inside of a solid is [m].
    pub fn deepest(&self, x: &[Vec3]) -> f64 {
        let depth = |aim: &Aim| aim.short_of(x) - aim.radius;
        let solids = self.aims.iter().filter(|aim| aim.of_solid);
        solids.map(depth).fold(0.0, f64::max)
    }

    /// Searches all pairs at `x`.
    fn build(&mut self, x: &[Vec3]) {
        self.built_at = x.to_vec();
        self.pairs.clear();
        self.search(None);
    }

    /// Searches the pairs of points that are farther than `share` of the budget from where their
    /// pairs were found. Pairs are those near each other where each of their points was then, so
    /// that two points may move by the whole budget each, whenever they were looked at.
    fn build_moved(&mut self, x: &[Vec3], share: f64) {
        let far = share * self.budget();
        let moved: Vec<bool> = self.moves(x).map(|by| by > far).collect();
        self.built_at.iter_mut().zip(x).zip(&moved).filter(|(_, m)| **m).for_each(|((b, x), _)| *b = *x);
        let scene = &self.scene;
        let goes = |pair: &Pair| scene.of_corners(pair, |i| moved[i as usize], |_| false).contains(&true);
        self.pairs.retain(|pair| !goes(pair));
        self.search(Some(&moved));
    }

    fn search(&mut self, among: Option<&[bool]>) {
        self.searches += 1;
        let sides = if self.tangles.is_clean() { 1.0 } else { 2.0 };
        let beyond = Beyond { collider: sides * self.budget(), own: 2.0 * self.budget() };
        let x = &self.built_at;
        let mut found = self.scene.pairs(x, &self.radii, beyond, &self.tangles, Among(among));
        found.retain(|pair| !self.passes(pair));
        self.pairs.append(&mut found);
    }

    /// Whether nothing holds the pair apart, as [`Passing`] says.
    fn passes(&self, pair: &Pair) -> bool {
        let (own, collider) = (pair.role.is_own(), pair.collider as usize);
        let may = match self.passing {
            Passing::Tangled => false,
            Passing::All => true,
            Passing::Layers => !own && !self.scene.colliders[collider].solid,
            Passing::Slots => !own,
            Passing::Around if own => !self.tangles.own.is_empty(),
            Passing::Around => self.tangles.with_collider(collider),
        };
        may && self.scene.of_corners(pair, |i| self.free[i as usize], |_| false).contains(&true)
    }

    /// How far each point has moved since its pairs were found [m].
    fn moves(&self, x: &[Vec3]) -> impl Iterator<Item = f64> {
        x.iter().zip(&self.built_at).map(|(x, b)| (x - b).norm())
    }

    /// The longest of these moves [m].
    fn moved(&self, x: &[Vec3]) -> f64 {
        self.moves(x).fold(0.0, f64::max)
    }

    fn budget(&self) -> f64 {
        if self.tangles.is_clean() { BUDGET } else { TANGLED_BUDGET }
    }

    /// Searches pairs again if a move of `wanted` [m] is longer than what is left of the budget of
    /// moves and a search would help; returns the longest move allowed now [m].
    ///
    /// Moves of clean cloth may be longer than the pairs reach ([`Contact::free_share`] looks at
    /// all that is on their way); [`Contact::keep_up`] then has to follow.
    pub fn refresh(&mut self, x: &[Vec3], wanted: f64) -> f64 {
        if self.passing == Passing::All {
            return LONGEST;
        }
        let budget = self.budget();
        let left = budget - self.moved(x);
        // What a search would add must be worth it.
        let enough = left >= wanted.min(0.8 * budget);
        let long = wanted > budget && wanted.is_finite() && self.tangles.is_clean();
        if enough || long {
            return if long { LONGEST } else { left };
        }
        self.build_moved(x, ASIDE[0]);
        budget - self.moved(x)
    }

    /// Searches pairs again at `x` if it is farther away than their budget.
    pub fn keep_up(&mut self, x: &[Vec3]) {
        if self.passing != Passing::All && self.moved(x) > self.budget() {
            self.build_moved(x, ASIDE[1]);
        }
    }

    /// The contacts at `x`.
    pub fn contacts(&self, x: &[Vec3]) -> Contacts {
        let moves: Vec<f64> = self.moves(x).collect();
        narrow::contacts(&self.scene, &self.pairs, &self.aims, x, self.stiffness, &moves)
    }

    /// The forces of clean pairs on the contact points that are `wanted` [N].
    pub fn forces_on(&self, x: &[Vec3], wanted: &[bool]) -> Vec<(u32, Vec3)> {
        narrow::forces_on(&self.scene, &self.pairs, x, self.stiffness, wanted)
    }

    /// The share of the move `dx` (at most 1) that no clean pair forbids.
    pub fn free_share(&self, x: &[Vec3], dx: &[Vec3], contacts: &Contacts) -> f64 {
        let longest = dx.iter().map(Vec3::norm_squared).fold(0.0, f64::max).sqrt();
        if self.passing != Passing::All && longest > self.budget() - self.moved(x) + ROUNDING {
            return self.scene.swept_share(x, dx, &[]);
        }
        let share = |(pair, &d): (&Pair, &f64)| {
            if !matches!(pair.mode, Mode::Clean) || 2.0 * longest < 0.9 * d {
                return 1.0;
            }
            self.scene.free_share(pair, x, (dx, &[]), 1.0)
        };
        self.pairs.par_iter().zip(&contacts.distances).with_min_len(PAIRS).map(share).reduce(|| 1.0, f64::min)
    }
}
