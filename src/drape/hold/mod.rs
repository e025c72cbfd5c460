//! Holding: bands that stay where they are worn.
//!
//! Loose trousers slide off under real gravity, as on a body without a belt. Panels chosen by
//! label can be held in two ways, each a potential in the implicit step ([`ties`]):
//!
//! - *Elastic*: a tape sewn into the band that is shorter than the body's girth there. It
//!   presses the band onto the skin, and friction carries the garment, as in life.
//! - *Tether*: springs from the band to where the transfer put it, for what has no ring to
//!   close (a strap, a collar stand).
//!
//! A garment is held only as it was on its source: [`find`] asks there whether the band lies on
//! the body. What was done is in the report ([`Held`]).

pub mod ties;

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::geometry::Surface;
use crate::model::{Garment, Panel, Vec3};
use crate::proxy::label;

/// When panels are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum When {
    /// Where their band lies on the body on the source.
    #[default]
    Auto,
    /// Wherever a label matches.
    Always,
    /// Nowhere.
    Never,
}

/// How panels are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// By a tape that is shorter than the body's girth.
    Elastic,
    /// By springs to their transferred place.
    Tether,
}

/// Settings of holding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// When panels are held: `auto` where their band lies on the body on the source, `always`
    /// wherever a label matches, `never`.
    pub when: When,
    /// Labels of panels that an elastic holds (matched as those of details are). A band that is
    /// no closed ring is tethered instead.
    pub elastic: Vec<String>,
    /// Labels of panels that are tethered to their transferred place.
    pub tether: Vec<String>,
    /// Largest median distance to the source body of a band that lies on it [m]: a thickness or
    /// two above the contact distance that the source was draped with.
    pub reach: f64,
    /// How far the elastic is stretched around the body's girth (a tenth: 0.1).
    pub elastic_stretch: f64,
    /// Tension of the elastic for each unit of stretch and each metre of the band's height [N/m].
    pub elastic_stiffness: f64,
    /// Stiffness of tethers for each unit of cloth area [N/m^3].
    pub tether_stiffness: f64,
}

impl Default for Params {
    fn default() -> Self {
        let list = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
        Params {
            when: When::Auto,
            elastic: list(&["waistband", "cuff"]),
            tether: list(&["strap", "collar stand"]),
            reach: 6e-3,
            elastic_stretch: 0.1,
            elastic_stiffness: 500.0,
            tether_stiffness: 1e5,
        }
    }
}

impl Params {
    /// Numbers that must be finite and not negative, with their names.
    pub fn numbers(&self) -> [(&'static str, f64); 4] {
        [
            ("hold.reach", self.reach),
            ("hold.elastic_stretch", self.elastic_stretch),
            ("hold.elastic_stiffness", self.elastic_stiffness),
            ("hold.tether_stiffness", self.tether_stiffness),
        ]
    }

    /// How a panel's label (its name, if it has none) asks to be held.
    fn kind(&self, panel: &Panel) -> Option<Kind> {
        let name = if panel.label.is_empty() { &panel.name } else { &panel.label };
        let any = |patterns: &[String]| patterns.iter().any(|p| label::matches(p, name));
        match (any(&self.elastic), any(&self.tether)) {
            (true, _) => Some(Kind::Elastic),
            (false, true) => Some(Kind::Tether),
            (false, false) => None,
        }
    }
}

/// Panels sewn together that are held in one way.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Panels of the garment.
    pub panels: Vec<u32>,
    /// How they are held.
    pub kind: Kind,
    /// Median distance of their vertices to the source body [m].
    pub source_distance_m: f64,
}

/// What held a band, and how hard; an element of the report's `held`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Labels (or names) of its panels.
    pub panels: Vec<String>,
    /// How it was held.
    pub kind: Kind,
    /// Median distance of its vertices to the source body [m].
    pub source_distance_m: f64,
    /// Tension all around of an elastic, or the sum of a tether's forces [N].
    pub force_n: f64,
    /// Mean stretch of an elastic over its natural length; 0 for a tether.
    pub extension: f64,
    /// Mean distance of the band from its transferred place [m].
    pub moved_mean_m: f64,
    /// Largest distance of the band from its transferred place [m].
    pub moved_max_m: f64,
}

/// The bands of a garment that are to be held, judged where it is on its source body.
pub fn find(garment: &Garment, source_body: &Surface, params: &Params) -> Vec<Band> {
    if params.when == When::Never {
        return Vec::new();
    }
    let asked: Vec<Option<Kind>> = garment.panels.iter().map(|panel| params.kind(panel)).collect();
    let mut bands = Vec::new();
    for (panels, kind) in groups(garment, &asked) {
        let source_distance_m = median_distance(garment, &panels, source_body);
        if params.when == When::Always || source_distance_m <= params.reach {
            let open = kind == Kind::Elastic && !is_ring(garment, &panels);
            let kind = if open { Kind::Tether } else { kind };
            bands.push(Band { panels, kind, source_distance_m });
        }
    }
    bands
}

/// Panels of one kind that share nodes, in order of their first panel.
fn groups(garment: &Garment, asked: &[Option<Kind>]) -> Vec<(Vec<u32>, Kind)> {
    let mut panels_of_node: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for (v, &panel) in garment.panel_of_vertex.iter().enumerate() {
        if asked[panel as usize].is_some() {
            panels_of_node.entry(garment.groups.node_of_vertex[v]).or_default().insert(panel);
        }
    }
    let mut first: Vec<usize> = (0..asked.len()).collect();
    loop {
        let before = first.clone();
        for panels in panels_of_node.values() {
            for (&a, &b) in panels.iter().zip(panels.iter().skip(1)) {
                let (a, b) = (a as usize, b as usize);
                if asked[a] == asked[b] {
                    let least = first[a].min(first[b]);
                    (first[a], first[b]) = (least, least);
                }
            }
        }
        if first == before {
            break;
        }
    }
    let used: BTreeSet<u32> = garment.panel_of_triangle.iter().copied().collect();
    let mut groups: BTreeMap<usize, (Vec<u32>, Kind)> = BTreeMap::new();
    for (panel, kind) in asked.iter().enumerate() {
        if let Some(kind) = kind.filter(|_| used.contains(&(panel as u32))) {
            groups.entry(first[panel]).or_insert((Vec::new(), kind)).0.push(panel as u32);
        }
    }
    groups.into_values().collect()
}

/// Triangles of the panels.
fn triangles<'a>(garment: &'a Garment, panels: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
    (0..garment.triangles.len()).filter(|&t| panels.contains(&garment.panel_of_triangle[t]))
}

/// Nodes of the panels, each once.
fn nodes(garment: &Garment, panels: &[u32]) -> BTreeSet<u32> {
    triangles(garment, panels)
        .flat_map(|t| garment.triangles[t].map(|v| garment.groups.node_of_vertex[v as usize]))
        .collect()
}

fn median_distance(garment: &Garment, panels: &[u32], body: &Surface) -> f64 {
    let mut distances: Vec<f64> = nodes(garment, panels)
        .into_iter()
        .map(|n| body.closest(&garment.points[garment.groups.anchor_of_node[n as usize] as usize]).distance)
        .collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Whether the panels close to a ring: an Euler characteristic of 0 (a disc, such as a band
/// with an open front, has 1).
fn is_ring(garment: &Garment, panels: &[u32]) -> bool {
    let (mut edges, mut faces) = (BTreeSet::new(), 0i64);
    for t in triangles(garment, panels) {
        let n = garment.triangles[t].map(|v| garment.groups.node_of_vertex[v as usize]);
        (0..3).for_each(|k| {
            edges.insert((n[k].min(n[(k + 1) % 3]), n[k].max(n[(k + 1) % 3])));
        });
        faces += 1;
    }
    nodes(garment, panels).len() as i64 - edges.len() as i64 + faces <= 0
}

/// Labels (or names) of the panels.
fn names(garment: &Garment, panels: &[u32]) -> Vec<String> {
    let name = |p: &Panel| if p.label.is_empty() { p.name.clone() } else { p.label.clone() };
    panels.iter().map(|&p| name(&garment.panels[p as usize])).collect()
}

/// Where each node of a garment is, from its vertices.
fn node_points(garment: &Garment, vertices: &[Vec3]) -> Vec<Vec3> {
    garment.groups.node_points(vertices)
}

#[cfg(test)]
mod tests;
