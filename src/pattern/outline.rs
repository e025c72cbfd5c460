//! The outline: neighbourhoods of border vertices and their shared scale factors.
//!
//! Paper section 4.2.3, edge energy, with the weight made dimensionless. For a border vertex
//! `i` with neighbours `k` along the border, rest vectors `z_k^r` and a scale `S`:
//!
//! `W_i = w/2 * l * L_i * sum_k |z_k - S z_k^r|^2 / |z_k^r|^2`
//!
//! `L_i` is half the sum of the rest lengths and `l` the reference length, the pattern's area
//! over the length of its border. So `sum_i l L_i` is the garment's area, and `w` says how
//! heavily the outline's shape weighs beside the strain of the cloth, whatever the units and
//! however fine the mesh (the paper's `W` is a length cubed, its `E` an area). One `S` is
//! shared by all vertices of a seam group; vertices sewn with an offset have their own.
//!
//! At a corner the paper's one scale would resist any refit that widens a panel more than it
//! lengthens it. There each arm has a scale of its own, shared with the arm that it is sewn
//! to: both keep their directions, so the corner keeps its angle.
//!
//! The term above holds directions, and a straight run would rather turn as a whole than bend:
//! trousers for a heavier man flare. So its edges `e` have a second, stiffer term in which the
//! turn `phi` of the run is free, with the unit normal `n_e` and length `l_e` of the rest edge
//! and the reference length `l_p` of its own panel:
//!
//! `V = v/2 * l_p * sum_e l_e (n_e . (x_j - x_i) / l_e - phi)^2`

use std::collections::BTreeMap;

use super::runs::Runs;
use crate::model::{Garment, Vec2};

/// A border that turns by more than this has a corner [rad].
pub const CORNER: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// One border vertex and its neighbours along the border.
#[derive(Clone, Debug)]
pub struct Neighbourhood {
    /// The vertex.
    pub vertex: u32,
    /// Neighbours with their rest vectors [m].
    pub arms: Vec<(u32, Vec2)>,
    /// Index of the scale factor.
    pub scale: usize,
    /// Half the sum of the rest lengths [m].
    pub length: f64,
}

/// An edge of a straight run: vertices and rest vector [m].
pub type Edge = ([u32; 2], Vec2);

/// A straight run that may turn.
#[derive(Clone, Debug)]
pub struct StraightRun {
    /// Its edges.
    pub edges: Vec<Edge>,
    /// Reference length of its panel: area over border length [m].
    pub reference_length: f64,
}

/// The outline of a whole garment.
#[derive(Clone, Debug)]
pub struct Outline {
    /// One for each border vertex.
    pub neighbourhoods: Vec<Neighbourhood>,
    /// Number of scale factors.
    pub scales: usize,
    /// Straight runs of more than one edge.
    pub straight: Vec<StraightRun>,
    /// Reference length: area over border length [m].
    pub reference_length: f64,
}

/// Whether a border turns at a vertex with these arms.
fn is_corner(arms: &[(u32, Vec2)]) -> bool {
    match arms {
        [(_, a), (_, b)] => -a.dot(b) < CORNER.cos() * a.norm() * b.norm(),
        _ => true,
    }
}

impl Outline {
    /// The outline of the garment's original pattern.
    pub fn new(garment: &Garment, runs: &Runs) -> Outline {
        let mut arms: BTreeMap<u32, Vec<(u32, Vec2)>> = BTreeMap::new();
        let mut border_length = 0.0;
        for [u, v] in garment.border_edges() {
            let z = garment.pattern[v as usize] - garment.pattern[u as usize];
            border_length += z.norm();
            arms.entry(u).or_default().push((v, z));
            arms.entry(v).or_default().push((u, -z));
        }
        let area: f64 = (0..garment.triangles.len())
            .map(|t| {
                let [a, b, c] = garment.pattern_corners(&garment.pattern, t);
                0.5 * (b - a).perp(&(c - a)).abs()
            })
            .sum();
        let mut scale_of_key = BTreeMap::new();
        let mut neighbourhoods = Vec::new();
        for (vertex, arms) in arms {
            let group = match garment.groups.has_offset[vertex as usize] {
                true => (true, vertex),
                false => (false, garment.groups.node_of_vertex[vertex as usize]),
            };
            let mut add = |arms: Vec<(u32, Vec2)>, side: Option<u32>| {
                let next = scale_of_key.len();
                let scale = *scale_of_key.entry((group, side)).or_insert(next);
                let length = 0.5 * arms.iter().map(|(_, z)| z.norm()).sum::<f64>();
                neighbourhoods.push(Neighbourhood { vertex, arms, scale, length });
            };
            if is_corner(&arms) {
                for arm in arms {
                    add(vec![arm], Some(garment.groups.node_of_vertex[arm.0 as usize]));
                }
            } else {
                add(arms, None);
            }
        }
        Outline {
            neighbourhoods,
            scales: scale_of_key.len(),
            straight: straight_runs(garment, runs),
            reference_length: area / border_length,
        }
    }

    /// Weight of one arm's squared deviation, `w l L_i / |z_r|^2` (dimensionless).
    pub fn arm_weight(&self, weight: f64, hood: &Neighbourhood, rest: &Vec2) -> f64 {
        weight * self.reference_length * hood.length / rest.norm_squared()
    }
}

fn straight_runs(garment: &Garment, runs: &Runs) -> Vec<StraightRun> {
    let edge = |u: u32, v: u32| ([u, v], garment.pattern[v as usize] - garment.pattern[u as usize]);
    let (mut areas, mut borders) = (vec![0.0; garment.panels.len()], vec![0.0; garment.panels.len()]);
    for t in 0..garment.triangles.len() {
        let [a, b, c] = garment.pattern_corners(&garment.pattern, t);
        areas[garment.panel_of_triangle[t] as usize] += 0.5 * (b - a).perp(&(c - a)).abs();
    }
    for run in &runs.runs {
        borders[run.panel as usize] += run.length(&garment.pattern);
    }
    let straight = runs.runs.iter().filter(|run| run.straight && run.vertices.len() > 2);
    straight
        .map(|run| StraightRun {
            edges: run.vertices.windows(2).map(|e| edge(e[0], e[1])).collect(),
            reference_length: areas[run.panel as usize] / borders[run.panel as usize],
        })
        .collect()
}
