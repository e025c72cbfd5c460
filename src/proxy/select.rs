//! Which panels are details.
//!
//! What the stage says of a panel comes first, then the settings' labels, then geometry: a panel
//! that lies wholly on others, and is sewn onto one that is larger, is a detail whatever its name.

use std::collections::BTreeSet;

use super::{Error, Params, label};
use crate::geometry::Surface;
use crate::model::{Garment, Panel, Role};

/// A panel sewn edge to edge to the shell that reaches farther than this beyond the shell's
/// border is a part of the shell: a zip between two fronts, the straps of a top [m].
const OVERHANG: f64 = 5e-3;

/// What was decided.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// For each panel, why it is left out.
    pub left_out: Vec<Option<String>>,
    /// Panels whose label names a detail, but which are a part of the shell.
    pub shell_after_all: Vec<u32>,
}

impl Selection {
    /// Whether each panel stays.
    pub fn shell(&self) -> Vec<bool> {
        self.left_out.iter().map(Option::is_none).collect()
    }
}

/// Decides on every panel of `garment`.
///
/// # Errors
/// [`Error::NothingLeft`] if no panel with triangles would stay.
pub fn run(garment: &Garment, params: &Params) -> Result<Selection, Error> {
    let count = garment.panels.len();
    let mut chosen = Selection { left_out: vec![None; count], shell_after_all: Vec::new() };
    if !params.enabled {
        return Ok(chosen);
    }
    let seams = Seams::new(garment);
    let mut by_label = Vec::new();
    for (p, panel) in garment.panels.iter().enumerate() {
        let named = |patterns: &[String]| patterns.iter().find(|pattern| names(pattern, panel)).cloned();
        match panel.role {
            Role::Shell => {}
            Role::Detail => chosen.left_out[p] = Some("its role is 'detail'".to_owned()),
            Role::Auto if named(&params.keep).is_some() => {}
            Role::Auto => {
                if let Some(pattern) = named(&params.leave_out) {
                    chosen.left_out[p] = Some(format!("its label matches '{pattern}'"));
                    by_label.push(p);
                } else if params.automatic && seams.lies_on(garment, p, params.thickness) {
                    chosen.left_out[p] = Some("it lies on others and is sewn onto one".to_owned());
                }
            }
        }
    }
    let has_triangles = |p: usize| seams.area[p] > 0.0;
    if (0..count).all(|p| chosen.left_out[p].is_some() || !has_triangles(p)) {
        return Err(nothing_left(garment));
    }
    // Every panel that comes back may hold the next one, so from the start after each.
    while let Some(i) = by_label.iter().position(|&p| seams.extends(garment, p, &chosen.shell())) {
        let p = by_label.remove(i);
        chosen.left_out[p] = None;
        chosen.shell_after_all.push(p as u32);
    }
    for p in 0..count {
        if !has_triangles(p) {
            chosen.left_out[p] = None;
        }
    }
    Ok(chosen)
}

/// Whether a pattern of the settings names the panel: its label, or its name if it has none.
fn names(pattern: &str, panel: &Panel) -> bool {
    label::matches(pattern, if panel.label.is_empty() { &panel.name } else { &panel.label })
}

fn nothing_left(garment: &Garment) -> Error {
    let labels: BTreeSet<&str> = garment
        .panels
        .iter()
        .map(|p| if p.label.is_empty() { p.name.as_str() } else { p.label.as_str() })
        .collect();
    Error::NothingLeft {
        garment: garment.path.clone(),
        labels: labels.into_iter().map(|l| format!("'{l}'")).collect::<Vec<_>>().join(", "),
    }
}

/// How the panels of a garment are sewn.
struct Seams {
    /// Area of each panel in the pattern [m^2].
    area: Vec<f64>,
    /// Panels that each panel is sewn onto: with an offset, or without to inner vertices.
    onto: Vec<BTreeSet<usize>>,
    /// Panels that each is sewn to edge to edge.
    beside: Vec<BTreeSet<usize>>,
}

impl Seams {
    fn new(garment: &Garment) -> Seams {
        let (count, groups) = (garment.panels.len(), &garment.groups);
        let mut area = vec![0.0; count];
        for (t, &p) in garment.panel_of_triangle.iter().enumerate() {
            let [a, b, c] = garment.pattern_corners(&garment.pattern, t);
            area[p as usize] += 0.5 * (b - a).perp(&(c - a)).abs();
        }
        let mut border = vec![false; garment.points.len()];
        garment.border_edges().iter().flatten().for_each(|&v| border[v as usize] = true);
        let mut members = vec![Vec::new(); groups.weld_count];
        for v in 0..garment.points.len() {
            members[groups.weld_of_vertex[v] as usize].push(v);
        }
        let (mut onto, mut beside) = (vec![BTreeSet::new(); count], vec![BTreeSet::new(); count]);
        for v in 0..garment.points.len() {
            let panel = |v: usize| garment.panel_of_vertex[v] as usize;
            if groups.has_offset[v] {
                let anchor = groups.anchor_of_node[groups.node_of_vertex[v] as usize];
                let below = &members[groups.weld_of_vertex[anchor as usize] as usize];
                onto[panel(v)].extend(below.iter().map(|&u| panel(u)).filter(|&q| q != panel(v)));
            }
            for &u in &members[groups.weld_of_vertex[v] as usize] {
                if panel(u) != panel(v) && border[v] {
                    let sewn = if border[u] { &mut beside } else { &mut onto };
                    sewn[panel(v)].insert(panel(u));
                }
            }
        }
        Seams { area, onto, beside }
    }

    /// Whether panel `p` is sewn onto larger ones and nowhere farther than `thickness` [m] from
    /// what is not sewn onto it.
    fn lies_on(&self, garment: &Garment, p: usize, thickness: f64) -> bool {
        let below: f64 = self.onto[p].iter().map(|&q| self.area[q]).sum();
        if self.area[p] == 0.0 || self.area[p] >= below {
            return false;
        }
        let others: Vec<bool> = (0..self.area.len()).map(|q| q != p && !self.onto[q].contains(&p)).collect();
        let surface = panels_surface(garment, &others);
        vertices_of(garment, p).all(|v| surface.closest_within(&garment.points[v], thickness).is_some())
    }

    /// Whether panel `p` is sewn edge to edge to the shell and reaches beyond its border.
    fn extends(&self, garment: &Garment, p: usize, shell: &[bool]) -> bool {
        if !self.beside[p].iter().any(|&q| shell[q]) {
            return false;
        }
        let surface = panels_surface(garment, shell);
        vertices_of(garment, p).any(|v| {
            let x = garment.points[v];
            let on = surface.closest(&x);
            let normal = surface.pseudo_normal(&on);
            let offset = x - on.point;
            surface.is_boundary(&on) && (offset - normal * normal.dot(&offset)).norm() > OVERHANG
        })
    }
}

fn vertices_of(garment: &Garment, p: usize) -> impl Iterator<Item = usize> {
    (0..garment.points.len()).filter(move |&v| garment.panel_of_vertex[v] as usize == p)
}

/// The welded surface of some panels on the source body.
fn panels_surface(garment: &Garment, take: &[bool]) -> Surface {
    let mut mesh = garment.welded_mesh(&garment.points);
    let mut of_panel = garment.panel_of_triangle.iter().map(|&p| take[p as usize]);
    mesh.triangles.retain(|_| of_panel.next() == Some(true));
    Surface::new(mesh)
}
