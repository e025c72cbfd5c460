//! The weights of a garment's nodes while they are refined, and what they do in every pose.
//!
//! With `x_np(w) = sum_k w_k G_kp x_n` the place of node `n` in pose `p`, the weights of all nodes minimise
//!
//! `1/P sum_p [ sum_edges (|x_ap - x_bp| - l)^2 + sum_contacts A / d^2 min(0, n . x - h)^2 ]`
//! `+ sum_n A_n / s^2 (w_n - w0_n)^T H (w_n - w0_n) + sum_edges e |w_a - w_b|^2`, `w >= 0`, `sum w = 1`:
//!
//! cloth that is stretched little, stays out of the body, and follows the skin that it was matched to,
//! with the metric `H` of [`crate::rig::influences`], which knows no poses. Areas `A` make that a matter of
//! the cloth and not of its mesh. One node after the other gets the best weights while all others hold
//! still (nonlinear Gauss-Seidel). For one node an edge pulls to the point of its rest length in its present
//! direction, which bounds its energy from above [Bouaziz 2014]; so a step is a quadratic programme in
//! a few weights, solved by moving weight between two joints at a time [Platt 1998].

use std::collections::BTreeSet;

use super::Scene;
use super::contact::Contact;
use super::exchange::exchange;
use crate::geometry::skinning::transform;
use crate::model::Vec3;
use crate::rig::cloth::Cloth;
use crate::rig::table::{Sparse, Table, normalise};
use crate::rig::{influences, smooth};

/// `s`: being displaced by this much, when every joint in turn is turned, weighs as much as being stretched
/// to twice the length [m]. Half as much leaves more in the body, in other poses too.
const STAY: f64 = 0.05;
/// `e`: a sum of squared differences of weights along an edge of 1 weighs as much as this [m^2]. Without it joints
/// that move alike in the poses take turns from node to node.
const EVEN: f64 = 1e-4;
/// Rounds of averaging that say which joints a node may have.
const AROUND: usize = 3;
/// An averaged weight below this is no reason to consider a joint.
const SLIGHT: f64 = 1e-3;
/// What moves by less in a step is quiet: it is left alone until something next to it moves [m].
const QUIET: f64 = 2e-5;

/// All nodes.
pub(super) struct Weights {
    nodes: Vec<Node>,
    poses: usize,
    /// Places, shape [nodes, poses] [m].
    places: Vec<Vec3>,
    /// How far each node moved in its last step, in the pose where that is the most [m].
    moved: Vec<f64>,
}

/// One node: `k` joints that may move it.
struct Node {
    joints: Vec<u32>,
    weights: Vec<f64>,
    /// Where each joint alone has it, shape [k, poses] [m].
    alone: Vec<Vec3>,
    /// Edges and nearness as a quadratic form, shape [k, k] [m^2].
    form: Vec<f64>,
    /// Nearness as a linear form.
    pull: Vec<f64>,
}

impl Weights {
    /// From `rows`, each with `influences` joints at most.
    pub fn new(scene: &Scene<'_>, cloth: &Cloth, rows: &[Sparse], influences: usize) -> Weights {
        let joints = candidates(scene, cloth, rows, influences);
        let node = |(n, joints): (usize, Vec<u32>)| Node::new(scene, cloth, n, joints, &rows[n]);
        let nodes: Vec<Node> = joints.into_iter().enumerate().map(node).collect();
        let poses = scene.poses.len();
        let count = nodes.len();
        let places = vec![Vec3::zeros(); count * poses];
        let mut weights = Weights { nodes, poses, places, moved: vec![f64::INFINITY; count] };
        (0..count).for_each(|n| weights.place(n));
        weights.moved.fill(f64::INFINITY);
        weights
    }

    /// Joints and weights of every node, the largest first, without those that move nothing.
    pub fn rows(&self) -> Vec<Sparse> {
        let row = |node: &Node| influences::sorted(influences::significant(&node.joints, &node.weights));
        self.nodes.iter().map(row).collect()
    }

    /// All nodes in a pose [m].
    pub fn points(&self, pose: usize) -> Vec<Vec3> {
        self.places.iter().skip(pose).step_by(self.poses).copied().collect()
    }

    /// `sweeps` steps of every node, there and back; a depth of `depth` weighs as much as a stretch by the
    /// length of the cloth that is that deep [m].
    pub fn relax(&mut self, cloth: &Cloth, contacts: &[Contact], depth: f64, sweeps: usize) {
        let mut of_node = vec![Vec::new(); self.nodes.len()];
        for contact in contacts {
            contact.nodes().iter().for_each(|&n| of_node[n as usize].push(contact));
        }
        (0..self.nodes.len()).filter(|&n| !of_node[n].is_empty()).for_each(|n| self.moved[n] = f64::INFINITY);
        for sweep in 0..sweeps {
            for i in 0..self.nodes.len() {
                let n = if sweep % 2 == 0 { i } else { self.nodes.len() - 1 - i };
                let moves = |n: usize| self.moved[n] > QUIET;
                if moves(n) || cloth.around(n).iter().any(|e| moves(e.node as usize)) {
                    self.step(cloth, n, &of_node[n], depth);
                }
            }
        }
    }

    /// Averages nodes with their neighbours, over their own joints, while the weights along one of their edges
    /// change by more than `most` (the sum of the absolute differences), as
    /// [`crate::rig::smooth::limit_jumps`] does.
    pub fn limit_jumps(&mut self, cloth: &Cloth, most: f64) {
        let mut suspects: Vec<usize> = (0..self.nodes.len()).collect();
        for _ in 0..smooth::ROUNDS {
            let jumps = |m: &Node, n: &Node| m.jump(n) > most;
            let around = |n: usize| cloth.around(n).iter().map(|e| e.node as usize);
            suspects.retain(|&n| around(n).any(|m| jumps(&self.nodes[m], &self.nodes[n])));
            let averaged: Vec<Vec<f64>> = suspects.iter().map(|&n| self.averaged(cloth, n)).collect();
            for (&n, weights) in suspects.iter().zip(averaged) {
                self.nodes[n].weights = weights;
                self.place(n);
            }
            // What a change can disturb lies next to it.
            let next = suspects.iter().flat_map(|&n| around(n)).chain(suspects.iter().copied());
            suspects = next.collect::<BTreeSet<usize>>().into_iter().collect();
        }
    }

    /// Half of a node's own weights and half of the mean of its neighbours', over its own joints.
    fn averaged(&self, cloth: &Cloth, n: usize) -> Vec<f64> {
        let node = &self.nodes[n];
        let others = || cloth.around(n).iter().map(|e| &self.nodes[e.node as usize]);
        let own = cloth.around(n).len() as f64;
        let sum = |(&j, w): (&u32, &f64)| own * w + others().map(|m| m.weight(j)).sum::<f64>();
        let mut weights: Vec<f64> = node.joints.iter().zip(&node.weights).map(sum).collect();
        normalise(&mut weights);
        weights
    }

    /// The best weights of one node.
    fn step(&mut self, cloth: &Cloth, n: usize, contacts: &[&Contact], depth: f64) {
        let count = self.nodes[n].joints.len();
        let (around, wanted) = (cloth.around(n), self.wanted(cloth, n));
        let node = &self.nodes[n];
        let mut form = node.form.clone();
        let share = 1.0 / self.poses as f64;
        let linear = |k: usize| {
            let along: f64 = node.alone(k, self.poses).iter().zip(&wanted).map(|(a, b)| a.dot(b)).sum();
            let others: f64 = around.iter().map(|e| self.nodes[e.node as usize].weight(node.joints[k])).sum();
            node.pull[k] + share * along + EVEN * others
        };
        let mut pull: Vec<f64> = (0..count).map(linear).collect();
        for contact in contacts {
            let part = 1.0 / contact.nodes().len() as f64;
            let places = contact.nodes().iter().map(|&m| self.places[m as usize * self.poses + contact.pose]);
            let height = part * contact.normal.dot(&places.sum::<Vec3>());
            if height >= contact.height {
                continue;
            }
            let alone = |k: usize| part * contact.normal.dot(&node.alone(k, self.poses)[contact.pose]);
            let heights: Vec<f64> = (0..count).map(alone).collect();
            let now: f64 = heights.iter().zip(&node.weights).map(|(h, w)| h * w).sum();
            let push = share * contact.area / (depth * depth);
            for a in 0..count {
                pull[a] += push * heights[a] * (now + contact.height - height);
                (0..count).for_each(|b| form[a * count + b] += push * heights[a] * heights[b]);
            }
        }
        exchange(&form, &pull, &mut self.nodes[n].weights);
        self.place(n);
    }

    /// The sum of the points to which a node's edges pull it, in each pose [m].
    fn wanted(&self, cloth: &Cloth, n: usize) -> Vec<Vec3> {
        let own = &self.places[n * self.poses..(n + 1) * self.poses];
        let mut wanted = vec![Vec3::zeros(); self.poses];
        for edge in cloth.around(n) {
            let m = edge.node as usize;
            let other = &self.places[m * self.poses..(m + 1) * self.poses];
            let rest = (cloth.mesh.points[n] - cloth.mesh.points[m]).norm();
            for ((wanted, a), b) in wanted.iter_mut().zip(own).zip(other) {
                let along = a - b;
                *wanted += b + along * (rest / along.norm().max(f64::MIN_POSITIVE));
            }
        }
        wanted
    }

    /// Puts a node where its weights have it.
    fn place(&mut self, n: usize) {
        let node = &self.nodes[n];
        let mut moved: f64 = 0.0;
        for (pose, place) in self.places[n * self.poses..(n + 1) * self.poses].iter_mut().enumerate() {
            let alone = node.alone.iter().skip(pose).step_by(self.poses);
            let new: Vec3 = alone.zip(&node.weights).map(|(p, &w)| p * w).sum();
            moved = moved.max((new - *place).norm_squared());
            *place = new;
        }
        self.moved[n] = moved.sqrt();
    }
}

impl Node {
    fn new(scene: &Scene<'_>, cloth: &Cloth, n: usize, joints: Vec<u32>, row: &Sparse) -> Node {
        let p = &cloth.mesh.points[n];
        let (count, poses) = (joints.len(), scene.poses.len());
        let weight = |j: &u32| row.iter().filter(|w| w.0 == *j).map(|w| w.1).sum();
        let weights: Vec<f64> = joints.iter().map(weight).collect();
        let alone: Vec<Vec3> = joints
            .iter()
            .flat_map(|&j| scene.poses.iter().map(move |pose| transform(&pose.matrices[j as usize], p)))
            .collect();
        let metric = scene.turns.metric(p, &joints) * (influences::turn() * cloth.areas[n] / (STAY * STAY));
        let edges = cloth.around(n).len() as f64 / poses as f64;
        let mut form = vec![0.0; count * count];
        let mut pull = vec![0.0; count];
        for a in 0..count {
            for b in 0..count {
                let (of_a, of_b) = (&alone[a * poses..(a + 1) * poses], &alone[b * poses..(b + 1) * poses]);
                let product: f64 = of_a.iter().zip(of_b).map(|(a, b)| a.dot(b)).sum();
                form[a * count + b] = edges * product + metric[(a, b)];
                pull[a] += metric[(a, b)] * weights[b];
            }
        }
        (0..count).for_each(|k| form[k * count + k] += EVEN * cloth.around(n).len() as f64);
        Node { joints, weights, alone, form, pull }
    }

    /// Its weight on a joint.
    fn weight(&self, joint: u32) -> f64 {
        self.joints.iter().position(|&j| j == joint).map_or(0.0, |k| self.weights[k])
    }

    /// Sum of the absolute differences of two nodes' weights.
    fn jump(&self, other: &Node) -> f64 {
        let own = self.joints.iter().zip(&self.weights).map(|(&j, w)| (w - other.weight(j)).abs());
        let missing = other.joints.iter().zip(&other.weights).filter(|w| !self.joints.contains(w.0));
        own.sum::<f64>() + missing.map(|w| w.1).sum::<f64>()
    }

    /// Where a joint alone has it, in each pose.
    fn alone(&self, k: usize, poses: usize) -> &[Vec3] {
        &self.alone[k * poses..(k + 1) * poses]
    }
}

/// The joints that may move each node: its own, and those of the cloth around it while there is room.
fn candidates(scene: &Scene<'_>, cloth: &Cloth, rows: &[Sparse], influences: usize) -> Vec<Vec<u32>> {
    let given: Vec<Option<Sparse>> = rows.iter().cloned().map(Some).collect();
    let mut table = Table::new(&given, scene.character.skeleton.joints.len());
    for _ in 0..AROUND {
        let before = Table { joints: Vec::new(), values: table.values.clone() };
        let width = table.width();
        for n in 0..rows.len() {
            let around = cloth.around(n);
            let row = table.row_mut(n);
            row.iter_mut().for_each(|w| *w *= 0.5);
            for e in around {
                let other = &before.values[e.node as usize * width..(e.node as usize + 1) * width];
                row.iter_mut().zip(other).for_each(|(w, o)| *w += 0.5 * o / around.len() as f64);
            }
        }
    }
    let of_node = |(n, row): (usize, &Sparse)| {
        let mut joints: Vec<u32> = row.iter().map(|w| w.0).collect();
        let mut others: Vec<(u32, f64)> = table
            .joints
            .iter()
            .copied()
            .zip(table.row(n).iter().copied())
            .filter(|w| w.1 > SLIGHT && !joints.contains(&w.0))
            .collect();
        others = influences::sorted(others);
        joints.extend(others.iter().take(influences.saturating_sub(row.len())).map(|w| w.0));
        joints
    };
    rows.iter().enumerate().map(of_node).collect()
}
