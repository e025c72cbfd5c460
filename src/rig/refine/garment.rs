//! One garment while it is refined.

use nalgebra::DVector;
use rayon::prelude::*;

use super::{Contact, Contacts, Scene, Worn, fit};
use crate::certificate::posed::Resting;
use crate::geometry::skinning::skin_points;
use crate::model::{Skin, TriMesh};
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
/// more has sunk, for each metre of mean depth; and at all.
const STRETCH: f64 = 1.025;
/// See [`STRETCH`] [1/m].
const GIVE: f64 = 200.0;
/// See [`STRETCH`].
const SLACK: f64 = 1e-3;
/// Shares of a round's corrections that are tried, until the stretch allows them.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];
/// Smaller changes of a weight are none.
const NOTHING: f64 = 1e-6;
/// Weights below this are no reason to consider a joint.
const SLIGHT: f64 = 1e-3;

/// A garment being refined.
pub(super) struct Garment<'a> {
    pub cloth: Cloth,
    pub resting: Resting<'a>,
    table: Table,
    rows: Vec<Sparse>,
    influences: usize,
    /// The rows that sink the least so far.
    pub best: Vec<Sparse>,
    /// Sums of the depths over poses and nodes, before and at best [m].
    pub depths: Option<[f64; 2]>,
    /// Spread of the edges' stretch before, averaged over poses.
    stretch: Option<f64>,
}

impl<'a> Garment<'a> {
    /// `mesh` is the cloth's, over its nodes.
    pub fn new(scene: &Scene<'_>, worn: &Worn<'_>, mesh: &'a TriMesh) -> Garment<'a> {
        let cloth = Cloth::new(&worn.sewn);
        let rows = rows_of(worn.skin, worn.sewn.groups);
        let table = Table::new(
            &rows.iter().cloned().map(Some).collect::<Vec<_>>(),
            scene.character.skeleton.joints.len(),
        );
        let resting = Resting::new(mesh, &scene.body.surface);
        Garment {
            cloth,
            resting,
            table,
            best: rows.clone(),
            rows,
            influences: worn.skin.influences,
            depths: None,
            stretch: None,
        }
    }

    /// The weights of the cloth's nodes.
    pub fn node_skin(&self) -> Skin {
        let nodes: Vec<u32> = (0..self.rows.len() as u32).collect();
        skin(&self.rows, &nodes, self.influences)
    }

    /// Keeps the present weights if they sink less than any before.
    pub fn keep_best(&mut self, contacts: &Contacts) {
        let sum: f64 = contacts.values().flatten().map(|c| c.depth).sum();
        match &mut self.depths {
            None => self.depths = Some([sum; 2]),
            Some([_, best]) if sum < *best => {
                *best = sum;
                self.best.clone_from(&self.rows);
            }
            Some(_) => {}
        }
    }

    /// Fits the weights of the nodes in contact and takes their neighbours along.
    pub fn correct(&mut self, scene: &Scene<'_>, contacts: &Contacts, jump: f64) -> Result<(), Error> {
        let (size, width) = (self.cloth.len(), self.table.width());
        let fitted: Vec<(usize, Vec<f64>)> =
            contacts.par_iter().map(|(&node, own)| (node, self.fitted(scene, node, own))).collect();
        let mut changes = vec![0.0; size * width];
        for (node, row) in &fitted {
            let old = self.table.row(*node);
            (0..width).for_each(|c| changes[c * size + node] = row[c] - old[c]);
        }
        let pull = |n: usize| if contacts.contains_key(&n) { CLING } else { 1.0 };
        smooth::spread(&self.cloth, pull, FADE, &mut changes)?;
        let before = self.stretch.unwrap_or_else(|| self.spread(scene.poses));
        self.stretch = Some(before);
        let sunk = self.depths.map_or(0.0, |d| d[0]) / (scene.poses.len() * size) as f64;
        let allowed = (STRETCH + GIVE * sunk) * before + SLACK;
        let (values, rows) = (self.table.values.clone(), self.rows.clone());
        for share in SHARES {
            self.apply(&changes, share, &scene.turns, jump);
            if self.spread(scene.poses) <= allowed {
                break;
            }
            self.table.values.clone_from(&values);
            self.rows.clone_from(&rows);
        }
        Ok(())
    }

    /// Difference of the edges' stretch at 99 and 1 percent, averaged over poses.
    fn spread(&self, poses: &[Pose]) -> f64 {
        let skin = self.node_skin();
        let in_pose = |pose: &Pose| {
            let points = skin_points(&self.cloth.mesh.points, &skin, &pose.matrices);
            let [low, _, high] = self.resting.stretch(&points).0;
            high - low
        };
        poses.par_iter().map(in_pose).sum::<f64>() / poses.len() as f64
    }

    /// Adds a share of `changes` (column after column) to the weights.
    fn apply(&mut self, changes: &[f64], share: f64, turns: &Posed, jump: f64) {
        let (size, width) = (self.cloth.len(), self.table.width());
        let before = self.table.values.clone();
        for n in (0..size).filter(|n| (0..width).any(|c| changes[c * size + n].abs() > NOTHING)) {
            let row = self.table.row_mut(n);
            row.iter_mut().enumerate().for_each(|(c, w)| *w = (*w + share * changes[c * size + n]).max(0.0));
            normalise(row);
        }
        smooth::limit_jumps(&self.cloth, jump, &mut self.table);
        self.cap(turns, &before);
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

    /// Few influences again, for what differs from the weights `before`.
    fn cap(&mut self, turns: &Posed, before: &[f64]) {
        let (table, points, most) = (&self.table, &self.cloth.mesh.points, self.influences);
        let changed = |n: &usize| *table.row(*n) != before[n * table.width()..(n + 1) * table.width()];
        let capped = |n: usize| {
            let row = influences::significant(&table.joints, table.row(n));
            (n, influences::cap(turns, &points[n], &row, most).0)
        };
        let capped: Vec<(usize, Sparse)> =
            (0..points.len()).into_par_iter().filter(changed).map(capped).collect();
        for (n, row) in capped {
            self.table.set_row(n, &row);
            self.rows[n] = row;
        }
    }
}
