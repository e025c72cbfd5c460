//! Proxies: paper section 6, Automatic Semantic Proxy Generation.
//!
//! Pockets, straps and trims lie on a garment within a thickness. Simulated, they fight with what
//! they lie on; so transfer, pattern refit and drape work on a *proxy*, the garment without its
//! detail panels ([`select`] says which, [`part`] cuts). Details are bound to the proxy
//! ([`binding`]) and come back after each layer, so that the next layer collides with them.
//!
//! # What differs from the paper
//! - Details are bound in local frames and not by world-space offsets, so that they follow
//!   rotation and stretch, and keep their distance and their side.
//! - Which panels are details is said by the stage, by labels, and by geometry: what lies within
//!   a thickness of others and is sewn onto a larger one is a detail whatever its label.
//! - Where a crease of the proxy comes through a detail the detail is raised over it ([`raise`]);
//!   where there is no room for its thickness it is pressed together ([`squeeze`]).
//! - A panel whose label names a detail, but which is sewn edge to edge to the shell and reaches
//!   beyond it (the strap of a top), is no detail.
//! - The refitted pattern includes the details: their panels are refitted to their bound shape,
//!   as the proxy's are to theirs.
//!
//! # Seams
//! All vertices of a weld have one bond, so seams among details stay closed; what is sewn to the
//! proxy without an offset is at the proxy's vertex exactly. What is sewn with an offset stays
//! over the spot where it is stitched, at its distance. (A drape that simulates details holds the
//! vector to the nearest *vertex* instead, which may be a centimetre aside.)

mod binding;
pub mod label;
mod part;
mod raise;
mod refit;
mod select;
mod squeeze;
#[cfg(test)]
mod tests;
mod weights;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error as ThisError;

use crate::geometry::Surface;
use crate::model::{Garment, Vec3};
use binding::{Bond, Deformed, Neighbours};
pub(crate) use label::matches as names_part;
use part::Part;

/// Settings of the proxies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Whether detail panels are left out of transfer and drape and bound back; without, every
    /// panel is simulated.
    pub enabled: bool,
    /// Labels of panels that are details. A pattern must match whole words of a label (of the
    /// panel's name where it has no label), whatever the case; `*` and `?` stand for letters.
    pub leave_out: Vec<String>,
    /// Labels of panels that are simulated whatever else speaks against it.
    pub keep: Vec<String>,
    /// Whether a panel that lies within `thickness` of others, and is sewn onto a larger one, is a
    /// detail whatever its label.
    pub automatic: bool,
    /// Farthest that a panel may lie from others to be a detail without a label [m].
    pub thickness: f64,
    /// Farthest that a vertex of a detail may be from the proxy [m]; beyond it is an error.
    pub reach: f64,
}

/// Labels that name a detail.
const DETAILS: &[&str] = &[
    "pocket",
    "strap",
    "trim",
    "patch",
    "label",
    "tag",
    "badge",
    "emblem",
    "logo",
    "applique",
    "button",
    "snap",
    "rivet",
    "buckle",
    "zip",
    "zipper",
    "belt loop",
    "epaulette",
    "braid",
    "ribbon",
    "piping",
    "tape",
    "reflector",
    "reflective",
];

impl Default for Params {
    fn default() -> Self {
        Params {
            enabled: true,
            leave_out: DETAILS.iter().map(|&d| d.to_owned()).collect(),
            keep: Vec::new(),
            automatic: true,
            thickness: 5e-3,
            reach: 0.03,
        }
    }
}

/// A panel that was left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its name.
    pub panel: String,
    /// Its label.
    pub label: String,
    /// Why, in words.
    pub why: String,
    /// Its vertices.
    pub vertices: usize,
    /// Farthest of them from the proxy, on the source [m].
    pub distance_max_m: f64,
}

/// What was left out and how it came back; keys of the report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Panels that were left out.
    pub left_out: Vec<LeftOut>,
    /// Panels whose label names a detail, but which are sewn to the shell as a part of it.
    pub shell_after_all: Vec<String>,
    /// Vertices that were bound.
    pub bound_vertices: usize,
    /// Farthest of them from the proxy, on the source [m].
    pub distance_max_m: f64,
    /// Least share of its distance from the proxy that a bound vertex kept (1 without any; those
    /// in the proxy's surface, beyond its border or pressed together do not count).
    pub offset_least: f64,
    /// Largest share.
    pub offset_most: f64,
    /// Bound vertices on the wrong side of the proxy.
    pub inside: usize,
    /// Bound vertices that were raised over a crease.
    pub raised: usize,
    /// Bound vertices that were pressed together for want of room.
    pub squeezed: usize,
}

impl Info {
    /// Largest change of a distance, relative to itself.
    pub fn offset_change(&self) -> f64 {
        (1.0 - self.offset_least).max(self.offset_most - 1.0)
    }
}

impl Default for Info {
    fn default() -> Self {
        Info {
            left_out: Vec::new(),
            shell_after_all: Vec::new(),
            bound_vertices: 0,
            distance_max_m: 0.0,
            offset_least: 1.0,
            offset_most: 1.0,
            inside: 0,
            raised: 0,
            squeezed: 0,
        }
    }
}

/// Why a garment has no proxy.
#[derive(Clone, Debug, ThisError, PartialEq)]
#[expect(missing_docs, reason = "the messages name the fields")]
pub enum Error {
    /// Every panel is a detail.
    #[error(
        "{garment}: nothing is left to simulate, every panel counts as a detail: {labels}. See the settings \
         proxy.leave_out and proxy.keep, or garment:panel:role"
    )]
    NothingLeft { garment: String, labels: String },
    /// A detail has nothing to be bound to.
    #[error(
        "{garment}: panel '{panel}' counts as a detail ({why}), but its vertex {vertex} is {distance:.4} m from \
         the garment without details; the setting proxy.reach allows {reach} m. To simulate the panel name \
         it in proxy.keep, or give it the role 'shell'"
    )]
    Far { garment: String, panel: String, why: String, vertex: u32, distance: f64, reach: f64 },
    /// A setting is out of its range.
    #[error("proxy.{name} is {value}; it must be finite and above 0")]
    Setting { name: &'static str, value: f64 },
}

/// A garment without its details, and what is needed to put them back.
pub struct Proxy<'a> {
    whole: &'a Garment,
    /// `None` if nothing was left out.
    split: Option<Split>,
    info: Info,
}

struct Split {
    shell: Part,
    details: Part,
    /// The proxy's welded surface on the source body.
    rest: Surface,
    bonds: Vec<Bond>,
    /// Bond of each vertex of the details.
    bond_of: Vec<u32>,
}

impl<'a> Proxy<'a> {
    /// Decides which panels of `garment` are details, and binds them.
    ///
    /// # Errors
    /// Nothing is left, or a detail has no proxy near; see [`Error`].
    pub fn new(garment: &'a Garment, params: &Params) -> Result<Proxy<'a>, Error> {
        for (name, value) in [("thickness", params.thickness), ("reach", params.reach)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::Setting { name, value });
            }
        }
        let chosen = select::run(garment, params)?;
        let name = |&p: &u32| garment.panels[p as usize].name.clone();
        let mut info =
            Info { shell_after_all: chosen.shell_after_all.iter().map(name).collect(), ..Info::default() };
        let stays = chosen.shell();
        if stays.iter().all(|&s| s) {
            return Ok(Proxy { whole: garment, split: None, info });
        }
        let split = Split::new(garment, &stays);
        for (p, why) in chosen.left_out.iter().enumerate() {
            let Some(why) = why else { continue };
            let (vertices, farthest) = split.farthest(p as u32);
            let distance = split.bond(farthest).distance;
            let panel = garment.panels[p].name.clone();
            if distance > params.reach {
                return Err(Error::Far {
                    garment: garment.path.clone(),
                    panel,
                    why: why.clone(),
                    vertex: split.details.vertices[farthest],
                    distance,
                    reach: params.reach,
                });
            }
            let label = garment.panels[p].label.clone();
            info.left_out.push(LeftOut {
                panel,
                label,
                why: why.clone(),
                vertices,
                distance_max_m: distance,
            });
            info.bound_vertices += vertices;
            info.distance_max_m = info.distance_max_m.max(distance);
        }
        Ok(Proxy { whole: garment, split: Some(split), info })
    }

    /// The garment to transfer and drape: without details, or the whole if it has none.
    pub fn garment(&self) -> &Garment {
        self.split.as_ref().map_or(self.whole, |split| &split.shell.garment)
    }

    /// What was left out; how it came back is in what [`Proxy::restore`] returns.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// What a label got wrong, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        let path = &self.whole.path;
        let said = |panel| {
            format!(
                "<{path}>: panel '{panel}' counts as a detail by its label, but the garment goes on in it: it is simulated"
            )
        };
        self.info.shell_after_all.iter().map(said).collect()
    }

    /// The whole garment for its proxy at `points` [m], shape `[vertices of the proxy, 3]`: details at
    /// their bonds, whatever else is there.
    pub fn lift(&self, points: &[Vec3]) -> Vec<Vec3> {
        let Some(split) = &self.split else { return points.to_vec() };
        let lifted = split.lift(&split.deformed(points));
        split.assemble(points, &lifted)
    }

    /// As [`Proxy::lift`], with details raised over creases and pressed together where `obstacles` or the proxy itself leave
    /// no room; also says how well they kept their place.
    pub fn restore(&self, points: &[Vec3], obstacles: &[&Surface]) -> (Vec<Vec3>, Info) {
        let Some(split) = &self.split else { return (points.to_vec(), self.info.clone()) };
        let deformed = split.deformed(points);
        let mut lifted = split.lift(&deformed);
        let mut info = self.info.clone();
        let raised = raise::run(split, self.whole, &deformed, points, &mut lifted);
        info.raised = split.bond_of.iter().filter(|&&b| raised[b as usize]).count();
        let squeezed: Vec<Option<Vec3>> = split
            .bonds
            .par_iter()
            .zip(&lifted)
            .map(|(bond, x)| squeeze::run(bond, x, &deformed, obstacles))
            .collect();
        for (x, squeezed) in lifted.iter_mut().zip(&squeezed) {
            *x = squeezed.unwrap_or(*x);
        }
        info.squeezed = split.bond_of.iter().filter(|&&b| squeezed[b as usize].is_some()).count();
        let free: Vec<bool> = squeezed.iter().map(Option::is_none).collect();
        split.judge(&deformed, &lifted, &free, &mut info);
        (split.assemble(points, &lifted), info)
    }

    /// A figure of each vertex of the whole from those of the proxy's vertices; what the details
    /// have is asked of `detail` by their vertex in the whole.
    pub fn scatter<T: Copy>(&self, of_proxy: &[T], detail: impl Fn(usize) -> T) -> Vec<T> {
        let Some(split) = &self.split else { return of_proxy.to_vec() };
        let mut all: Vec<Option<T>> = vec![None; self.whole.points.len()];
        for (&v, &value) in split.shell.vertices.iter().zip(of_proxy) {
            all[v as usize] = Some(value);
        }
        all.into_iter().enumerate().map(|(v, value)| value.unwrap_or_else(|| detail(v))).collect()
    }
}

impl Split {
    fn new(whole: &Garment, stays: &[bool]) -> Split {
        let shell = Part::new(whole, stays);
        let details = Part::new(whole, &stays.iter().map(|s| !s).collect::<Vec<_>>());
        let rest = Surface::new(shell.garment.welded_mesh(&shell.garment.points));
        let around = Neighbours::new(rest.mesh());
        // A weld that the shell is a part of is where the shell is.
        let mut point_of_weld: Vec<Option<Vec3>> = vec![None; whole.groups.weld_count];
        for part in [&shell, &details] {
            for &v in &part.vertices {
                let weld = whole.groups.weld_of_vertex[v as usize] as usize;
                point_of_weld[weld].get_or_insert(whole.points[v as usize]);
            }
        }
        let mut bond_of_weld = vec![u32::MAX; whole.groups.weld_count];
        let mut ends = Vec::new();
        let bond_of: Vec<u32> = details
            .vertices
            .iter()
            .map(|&v| {
                let weld = whole.groups.weld_of_vertex[v as usize] as usize;
                if bond_of_weld[weld] == u32::MAX {
                    bond_of_weld[weld] = ends.len() as u32;
                    ends.push(point_of_weld[weld].unwrap_or(whole.points[v as usize]));
                }
                bond_of_weld[weld]
            })
            .collect();
        let bonds = ends.par_iter().map(|p| Bond::new(&rest, &around, p)).collect();
        Split { shell, details, rest, bonds, bond_of }
    }

    fn bond(&self, detail: usize) -> &Bond {
        &self.bonds[self.bond_of[detail] as usize]
    }

    /// Number of vertices of a panel among the details, and the one farthest from the proxy.
    fn farthest(&self, panel: u32) -> (usize, usize) {
        let own = || (0..self.bond_of.len()).filter(|&v| self.details.garment.panel_of_vertex[v] == panel);
        let farthest = own().max_by(|&a, &b| self.bond(a).distance.total_cmp(&self.bond(b).distance));
        (own().count(), farthest.expect("panels that are left out have triangles"))
    }

    fn deformed(&self, points: &[Vec3]) -> Deformed {
        Deformed::new(self.rest.mesh(), self.shell.garment.welded_mesh(points))
    }

    /// Position of each bond [m].
    fn lift(&self, deformed: &Deformed) -> Vec<Vec3> {
        self.bonds.par_iter().map(|bond| deformed.keep_distance(bond, deformed.place(bond))).collect()
    }

    /// Vertices of the whole from those of the shell and the positions of the bonds.
    fn assemble(&self, points: &[Vec3], lifted: &[Vec3]) -> Vec<Vec3> {
        let mut all = vec![Vec3::zeros(); points.len() + self.bond_of.len()];
        self.shell.vertices.iter().zip(points).for_each(|(&v, p)| all[v as usize] = *p);
        let details = self.details.vertices.iter().zip(&self.bond_of);
        details.for_each(|(&v, &b)| all[v as usize] = lifted[b as usize]);
        all
    }

    /// Measures sides, and distances from the whole proxy where details are `free` of others.
    fn judge(&self, deformed: &Deformed, lifted: &[Vec3], free: &[bool], info: &mut Info) {
        for &b in &self.bond_of {
            let (bond, x) = (&self.bonds[b as usize], &lifted[b as usize]);
            if bond.in_surface() || bond.beyond {
                continue;
            }
            let on = deformed.surface.closest(x);
            let share = on.distance / bond.distance;
            if free[b as usize] {
                info.offset_least = info.offset_least.min(share);
                info.offset_most = info.offset_most.max(share);
            }
            let own = deformed.on_patch(bond, x);
            let side = deformed.surface.pseudo_normal(&own).dot(&(x - own.point));
            info.inside += usize::from(side * bond.side() <= 0.0);
        }
    }
}
