//! One garment while it is refined.

use nalgebra::DVector;
use rayon::prelude::*;

use super::contact::{Contact, Sinking};
use super::known::Known;
use super::{STILL, Scene, Worn, fit};
use crate::certificate::posed::Resting;
use crate::geometry::Surface;
use crate::geometry::skinning::{blend, skin_points, transform};
use crate::model::{TriMesh, Vec3};
use crate::pose::Pose;
use crate::rig::cloth::Cloth;
use crate::rig::influences::{self, Posed};
use crate::rig::table::{Sparse, Table, body_weights, normalise};
use crate::rig::{Error, rows_of, skin, smooth};

/// Length along the cloth over which a correction fades [m]. Shorter ones sink less, but stretch edges
/// more than plain inpainting does on bodies where much sinks.
const FADE: f64 = 0.05;
/// How much a corrected vertex clings to its correction; the others cling to none with 1. With more
/// than this, see [`FADE`].
const CLING: f64 = 10.0;
/// How far corrections may widen the spread of the edges' stretch over poses, as a factor; more where
/// more has sunk, for each metre of mean depth.
const STRETCH: f64 = 1.01;
/// See [`STRETCH`] [1/m].
const GIVE: f64 = 200.0;
/// Up to this spread corrections may go in any case: cloth that hangs from the waist is stretched little,
/// and its corrections cost little. With it and the factor 1.01 skirts sink less, and shirts are stretched
/// less, than with a factor of 1.025 for all.
const ROOM: f64 = 0.33;
/// Shares of a round's corrections that are tried, until the stretch allows them.
const SHARES: [f64; 6] = [1.0, 0.8, 0.6, 0.4, 0.25, 0.12];
/// Smaller changes of a weight are none: a joint that turns by a radian half a metre away moves a vertex
/// by a tenth of a millimetre.
const NOTHING: f64 = 2e-4;
/// Weights below this are no reason to consider a joint.
const SLIGHT: f64 = 1e-3;

/// A garment being refined.
pub(super) struct Garment<'a> {
    pub resting: Resting<'a>,
    /// In each pose.
    pub posed: Vec<InPose>,
    /// Whether nothing more can be done for it.
    pub settled: bool,
    /// The rows that sink the least so far.
    pub best: Vec<Sparse>,
    /// Sums of the depths over poses, nodes and faces, before and at best [m].
    pub depths: Option<[f64; 2]>,
    cloth: Cloth,
    table: Table,
    rows: Vec<Sparse>,
    influences: usize,
    /// Spread of the edges' stretch before.
    stretch: f64,
}

/// A garment in a pose.
pub(super) struct InPose {
    /// Its nodes [m].
    pub points: Vec<Vec3>,
    pub known: Known,
    /// Difference of the edges' stretch at 99 and 1 percent.
    spread: f64,
}

impl<'a> Garment<'a> {
    /// `mesh` is the cloth's, over its nodes.
    pub fn new(scene: &Scene<'_>, worn: &Worn<'_>, mesh: &'a TriMesh) -> Garment<'a> {
        let rows = rows_of(worn.skin, worn.sewn.groups);
        let table = Table::new(
            &rows.iter().cloned().map(Some).collect::<Vec<_>>(),
            scene.character.skeleton.joints.len(),
        );
        let resting = Resting::new(mesh, &scene.body.surface);
        let nodes: Vec<u32> = (0..rows.len() as u32).collect();
        let of_nodes = skin(&rows, &nodes, worn.skin.influences);
        let in_pose = |pose: &Pose| {
            let points = skin_points(&mesh.points, &of_nodes, &pose.matrices);
            let spread = spread(&resting, &points);
            InPose { points, known: Known::new(&resting), spread }
        };
        let posed = scene.poses.iter().map(in_pose).collect();
        let mut garment = Garment {
            cloth: Cloth::new(&worn.sewn),
            resting,
            posed,
            settled: false,
            table,
            best: rows.clone(),
            rows,
            influences: worn.skin.influences,
            depths: None,
            stretch: 0.0,
        };
        garment.stretch = garment.spread();
        garment
    }

    /// Number of vertices and faces that are looked at.
    pub fn spots(&self) -> usize {
        self.resting.vertices.len() + self.resting.faces.len()
    }

    /// Finds out what is in the body in a pose.
    pub fn look<'b>(&mut self, pose: usize, body: &dyn Fn() -> &'b Surface) {
        let InPose { points, known, .. } = &mut self.posed[pose];
        known.update(&self.resting, points, body);
    }

    /// Keeps the present weights if they sink less than any before.
    pub fn keep_best(&mut self, sinking: &Sinking) {
        match &mut self.depths {
            None => self.depths = Some([sinking.depth; 2]),
            Some([_, best]) if sinking.depth < *best => {
                *best = sinking.depth;
                self.best.clone_from(&self.rows);
            }
            Some(_) => {}
        }
    }

    /// Fits the weights of the nodes in contact and takes their neighbours along.
    pub fn correct(&mut self, scene: &Scene<'_>, sinking: &Sinking, jump: f64) -> Result<(), Error> {
        self.settled |= sinking.contacts.is_empty();
        if self.settled {
            return Ok(());
        }
        let changes = self.changes(scene, sinking)?;
        let sunk = self.depths.map_or(0.0, |d| d[0]) / (scene.poses.len() * self.spots()) as f64;
        let allowed = ((STRETCH + GIVE * sunk) * self.stretch).max(ROOM);
        let (values, rows) = (self.table.values.clone(), self.rows.clone());
        for share in SHARES {
            let changed = self.apply(&changes, share, &scene.turns, jump);
            self.pose(scene.poses, &changed);
            if self.spread() <= allowed {
                return Ok(());
            }
            self.table.values.clone_from(&values);
            self.rows.clone_from(&rows);
            self.pose(scene.poses, &changed);
        }
        self.settled = true;
        Ok(())
    }

    /// What is to be added to the columns of the weights, as (column, value for each node).
    fn changes(&self, scene: &Scene<'_>, sinking: &Sinking) -> Result<Vec<(usize, Vec<f64>)>, Error> {
        let (size, width) = (self.cloth.len(), self.table.width());
        let contacts = &sinking.contacts;
        let fitted: Vec<(usize, Vec<f64>)> =
            contacts.par_iter().map(|(&node, own)| (node, self.fitted(scene, node, own))).collect();
        let change = |(node, row): &(usize, Vec<f64>), c: usize| row[c] - self.table.row(*node)[c];
        let columns: Vec<usize> =
            (0..width).filter(|&c| fitted.iter().any(|f| change(f, c).abs() > NOTHING)).collect();
        let mut all = vec![0.0; size * columns.len()];
        for (column, &c) in all.chunks_mut(size).zip(&columns) {
            fitted.iter().for_each(|f| column[f.0] = change(f, c));
        }
        let pull = |n: usize| if contacts.contains_key(&n) { CLING } else { 1.0 };
        smooth::spread(&self.cloth, pull, FADE, &mut all)?;
        Ok(columns.into_iter().zip(all.chunks(size).map(<[f64]>::to_vec)).collect())
    }

    /// Spread of the edges' stretch, averaged over poses.
    fn spread(&self) -> f64 {
        self.posed.iter().map(|posed| posed.spread).sum::<f64>() / self.posed.len() as f64
    }

    /// Moves nodes to where their weights have them in every pose.
    fn pose(&mut self, poses: &[Pose], nodes: &[usize]) {
        let (rows, rest, resting) = (&self.rows, &self.cloth.mesh.points, &self.resting);
        self.posed.par_iter_mut().zip(poses).for_each(|(posed, pose)| {
            let mut moved = false;
            for &n in nodes {
                let p = transform(&blend(rows[n].iter().copied(), &pose.matrices), &rest[n]);
                moved |= (p - posed.points[n]).norm() > STILL;
                posed.points[n] = p;
            }
            if moved {
                posed.spread = spread(resting, &posed.points);
            }
        });
    }

    /// Adds a share of `changes` to the weights; returns the nodes whose weights differ.
    fn apply(&mut self, changes: &[(usize, Vec<f64>)], share: f64, turns: &Posed, jump: f64) -> Vec<usize> {
        let before = self.table.values.clone();
        let changed = |n: &usize| changes.iter().any(|(_, change)| (share * change[*n]).abs() > NOTHING);
        for n in (0..self.cloth.len()).filter(changed) {
            let row = self.table.row_mut(n);
            changes.iter().for_each(|(c, change)| row[*c] = (row[*c] + share * change[n]).max(0.0));
            normalise(row);
        }
        smooth::limit_jumps(&self.cloth, jump, &mut self.table);
        self.cap(turns, &before)
    }

    /// The weights over all columns that put a node back on the skin in its `contacts`: on joints that
    /// it, its neighbours or its own skin have.
    fn fitted(&self, scene: &Scene<'_>, node: usize, contacts: &[Contact]) -> Vec<f64> {
        let anchor = contacts[0].anchor;
        let own_skin = body_weights(scene.body, &scene.character.skin, anchor.triangle, &anchor.barycentric);
        let row = self.table.row(node);
        let around = self.cloth.around(node);
        let of_skin = |c: usize| own_skin.iter().any(|w| w.0 == self.table.joints[c] && w.1 > SLIGHT);
        let of_neighbour = |c: usize| around.iter().any(|e| self.table.row(e.node as usize)[c] > SLIGHT);
        let used: Vec<usize> =
            (0..row.len()).filter(|&c| row[c] > SLIGHT || of_skin(c) || of_neighbour(c)).collect();
        let joints: Vec<u32> = used.iter().map(|&c| self.table.joints[c]).collect();
        let mut now = DVector::from_iterator(used.len(), used.iter().map(|&c| row[c]));
        now /= now.sum();
        let new = fit::run(scene, &self.cloth.mesh.points[node], contacts, &joints, &now);
        let mut dense = vec![0.0; row.len()];
        used.iter().zip(new.iter()).for_each(|(&c, &w)| dense[c] = w);
        dense
    }

    /// Few influences again, for what differs from the weights `before`; returns those nodes.
    fn cap(&mut self, turns: &Posed, before: &[f64]) -> Vec<usize> {
        let (table, points, most) = (&self.table, &self.cloth.mesh.points, self.influences);
        let differs = |n: &usize| *table.row(*n) != before[n * table.width()..(n + 1) * table.width()];
        let capped = |n: usize| {
            let row = influences::significant(&table.joints, table.row(n));
            (n, influences::cap(turns, &points[n], &row, most).0)
        };
        let capped: Vec<(usize, Sparse)> =
            (0..points.len()).into_par_iter().filter(differs).map(capped).collect();
        let changed = capped.iter().map(|(n, _)| *n).collect();
        for (n, row) in capped {
            self.table.set_row(n, &row);
            self.rows[n] = row;
        }
        changed
    }
}

/// Difference of the edges' stretch at 99 and 1 percent.
fn spread(resting: &Resting<'_>, points: &[Vec3]) -> f64 {
    let [low, _, high] = resting.stretch(points).0;
    high - low
}
