//! One garment while it is refined.

use super::contact::Sinking;
use super::known::Known;
use super::weights::Weights;
use super::{Scene, Worn};
use crate::certificate::posed::Resting;
use crate::geometry::Surface;
use crate::model::{TriMesh, Vec3};
use crate::rig::cloth::Cloth;
use crate::rig::rows_of;
use crate::rig::table::Sparse;

/// Steps of every node in a round.
const SWEEPS: usize = 4;
/// In the first round, cloth that is this deep in the body weighs about as much as cloth that is stretched to
/// twice its length [m].
const DEPTH: f64 = 1.2e-3;
/// That much longer it is after a round that has stretched the cloth more than is allowed.
const SOFTER: f64 = 1.6;
/// That much shorter it is after a round that has stretched the cloth by less than [`CALM`] times that.
const HARDER: f64 = 1.3;
/// See [`HARDER`].
const CALM: f64 = 0.95;

/// Spread of the edges' stretch up to which a round may go in any case: cloth that hangs from the waist is
/// stretched little.
const ROOM: f64 = 0.33;
/// By this factor for each metre of mean depth a round may stretch the cloth more than it was [1/m]: weights
/// that are wrong by far need more than that.
const GIVE: f64 = 200.0;

/// A garment being refined.
pub(super) struct Garment<'a> {
    pub resting: Resting<'a>,
    pub cloth: Cloth,
    /// Areas of the faces [m^2].
    pub face_areas: Vec<f64>,
    /// In each pose.
    pub known: Vec<Known>,
    /// The rows of the best round so far.
    pub best: Vec<Sparse>,
    /// Sums of the depths over poses, vertices and faces, before and at best [m].
    pub depths: [f64; 2],
    weights: Weights,
    before: Option<Figures>,
    /// Sum of the best figures' shares of those before.
    least: f64,
    /// See [`DEPTH`].
    depth: f64,
}

/// What is judged: vertices inside, their depth, faces inside, spread of the edges' stretch.
type Figures = [f64; 4];

impl<'a> Garment<'a> {
    /// `mesh` is the cloth's, over its nodes.
    pub fn new(scene: &Scene<'_>, worn: &Worn<'_>, mesh: &'a TriMesh) -> Garment<'a> {
        let rows = rows_of(worn.skin, worn.sewn.groups);
        let resting = Resting::new(mesh, &scene.body.surface);
        let cloth = Cloth::new(&worn.sewn);
        let weights = Weights::new(scene, &cloth, &rows, worn.skin.influences);
        Garment {
            known: scene.poses.iter().map(|_| Known::new(&resting)).collect(),
            face_areas: (0..mesh.triangles.len()).map(|t| 0.5 * mesh.area_normal(t).norm()).collect(),
            resting,
            cloth,
            weights,
            best: rows,
            depths: [0.0; 2],
            before: None,
            least: f64::INFINITY,
            depth: DEPTH,
        }
    }

    /// Number of vertices and faces that are looked at.
    pub fn spots(&self) -> usize {
        self.resting.vertices.len() + self.resting.faces.len()
    }

    /// Finds out what is in the body in a pose.
    pub fn look<'b>(&mut self, pose: usize, body: &dyn Fn() -> &'b Surface) {
        self.known[pose].update(&self.resting, &self.weights.points(pose), body);
    }

    /// Keeps the present weights if they are the best so far, and no worse in any figure than those before.
    pub fn judge(&mut self, sinking: &Sinking) {
        let depth = sinking.depth.iter().sum();
        let [vertices, faces] = sinking.inside.map(|n| n as f64);
        let figures = [vertices, sinking.depth[0], faces, self.spread()];
        let Some(before) = self.before else {
            (self.before, self.depths) = (Some(figures), [depth; 2]);
            return;
        };
        let mean = self.depths[0] / (self.known.len() * self.spots()).max(1) as f64;
        let mut allowed = before;
        allowed[3] = (before[3] * (1.0 + GIVE * mean)).max(ROOM);
        let share = |(now, before): (&f64, &f64)| if *before > 0.0 { now / before } else { 0.0 };
        let sum: f64 = figures.iter().zip(&before).map(share).sum();
        if figures.iter().zip(&allowed).all(|(now, most)| now <= most) && sum < self.least {
            (self.best, self.least, self.depths[1]) = (self.weights.rows(), sum, depth);
        }
        if figures[3] > allowed[3] {
            self.depth *= SOFTER;
        } else if figures[3] < CALM * allowed[3] {
            self.depth /= HARDER;
        }
    }

    /// One round.
    pub fn correct(&mut self, sinking: &Sinking, jump: f64) {
        self.weights.relax(&self.cloth, &sinking.contacts, self.depth, SWEEPS);
        self.weights.limit_jumps(&self.cloth, jump);
    }

    /// Spread of the edges' stretch, averaged over poses.
    fn spread(&self) -> f64 {
        let one = |pose: usize| spread(&self.resting, &self.weights.points(pose));
        (0..self.known.len()).map(one).sum::<f64>() / self.known.len() as f64
    }
}

/// Difference of the edges' stretch at 99 and 1 percent.
fn spread(resting: &Resting<'_>, points: &[Vec3]) -> f64 {
    let [low, _, high] = resting.stretch(points).0;
    high - low
}
