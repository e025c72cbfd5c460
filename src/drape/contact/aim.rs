//! Where tangled points are to go.
//!
//! An *aim* is a one-sided spring that draws a weighted sum of contact points along a direction
//! until it gets to a goal. Aims are set where the cloth is classified and hold until it is
//! classified again, so that a push minimises over one fixed set of them:
//! - a point inside of a collider aims at its way out, plus the contact distance, and so does the
//!   middle of an edge that a solid has swallowed between its ends;
//! - a point of a region inside of another part of the sheet ([`super::regions`]) aims through
//!   the closest triangle of what cut it off;
//! - a crossing that belongs to no region aims along its contour's gradient ([`super::contour`]).

use rayon::prelude::*;

use super::contour;
use super::crossing::Tangles;
use super::fixed::{Fixed, SOLID_THRESHOLD};
use super::pairs::{Radii, Scene};
use super::regions::Cut;
use super::sheet::Sheet;
use super::stencil::{Kind, Stencil};
use super::tree::bounds;
use crate::geometry::triangle;
use crate::model::Vec3;

/// How far a push draws an edge through a triangle, each of the two half of it [m].
const CONTOUR_STEP: f64 = 4e-3;

/// Length of the sum of two unit normals below which they are of no ridge.
const RIDGE: f64 = 0.3;

/// See the module's documentation.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    /// Contact points; unused ones repeat the first with weight 0.
    pub points: [u32; 4],
    /// Their weights.
    pub weights: [f64; 4],
    /// Direction, a unit vector.
    pub direction: Vec3,
    /// Where the weighted sum's component along the direction is to be [m].
    pub goal: f64,
    /// Distance over which the spring builds up [m].
    pub radius: f64,
    /// Whether it leads out of a solid.
    pub of_solid: bool,
}

impl Aim {
    /// How far the goal is [m]; negative beyond it.
    pub fn short_of(&self, x: &[Vec3]) -> f64 {
        let at: Vec3 = (0..4).map(|k| x[self.points[k] as usize] * self.weights[k]).sum();
        self.goal - self.direction.dot(&at)
    }

    /// The spring at `x`; `None` where the goal is met.
    pub fn stencil(&self, node: &[u32], x: &[Vec3], stiffness: f64) -> Option<Stencil> {
        let short = self.short_of(x);
        if short <= 0.0 {
            return None;
        }
        let mut stencil = Stencil {
            kind: Kind::Spring,
            nodes: [node[self.points[0] as usize]; 4],
            weights: [0.0; 4],
            normal: self.direction,
            gap: self.radius - short,
            radius: self.radius,
            stiffness,
        };
        let mut count = 0;
        for k in (0..4).filter(|&k| self.weights[k] != 0.0) {
            let n = node[self.points[k] as usize];
            let slot = (0..count).find(|&j| stencil.nodes[j] == n).unwrap_or(count);
            count = count.max(slot + 1);
            stencil.nodes[slot] = n;
            stencil.weights[slot] += self.weights[k];
        }
        Some(stencil)
    }
}

/// The aims of everything that is tangled at `x`.
pub fn aims(scene: &Scene<'_>, tangles: &Tangles, radii: &Radii, x: &[Vec3]) -> Vec<Aim> {
    let mut aims = out_of_colliders(scene, tangles, radii, x);
    aims.extend(through_itself(&scene.sheet, tangles, radii.own, x));
    aims.extend(shorter_contours(&scene.sheet, tangles, radii.own, x));
    aims
}

/// The aims of points inside of colliders.
pub fn out_of_colliders(scene: &Scene<'_>, tangles: &Tangles, radii: &Radii, x: &[Vec3]) -> Vec<Aim> {
    if tangles.inside.iter().flatten().all(|inside| !inside) {
        return Vec::new();
    }
    let normals = scene.sheet.normals(x);
    let mut aims = Vec::new();
    for (c, collider) in scene.colliders.iter().enumerate() {
        let facing = collider.solid && tangles.outward[c];
        let radius = radii.collider[c];
        collider.hidden(); // in parallel itself, so not first from within the loop
        aims.par_extend((0..x.len()).into_par_iter().filter(|&p| tangles.inside[c][p]).map(|p| {
            let side = collider.way_out(&x[p], facing.then_some(&normals[p]));
            let away = side.point - x[p];
            let direction = if side.signed.abs() > 1e-6 { away / away.norm() } else { side.normal };
            let goal = direction.dot(&side.point) + radius;
            let (points, weights) = ([p as u32; 4], [1.0, 0.0, 0.0, 0.0]);
            Aim { points, weights, direction, goal, radius, of_solid: collider.solid }
        }));
        if collider.solid {
            let edges = (0..scene.sheet.edges.ends.len()).into_par_iter();
            let crossed = edges.filter(|&e| tangles.edges.get(c).is_some_and(|list| list[e]));
            aims.par_extend(crossed.filter_map(|e| {
                let ends = scene.sheet.edges.ends[e];
                let outside = ends.iter().all(|&p| !tangles.inside[c][p as usize]);
                if outside { over_ridge(collider, ends, radius, x) } else { None }
            }));
        }
    }
    aims
}

/// For an edge with both ends outside of a solid: the middle of what is inside, over the ridge
/// between the skin where the edge enters and where it leaves.
fn over_ridge(solid: &Fixed<'_>, ends: [u32; 2], radius: f64, x: &[Vec3]) -> Option<Aim> {
    let [p, q] = ends.map(|i| x[i as usize]);
    let length = (q - p).norm();
    let along = (q - p).try_normalize(0.0)?;
    let mut hits: Vec<(f64, u32)> = Vec::new();
    solid.triangle_tree.query(&bounds(&[p, q], 0.0), &mut |t| {
        let hit = triangle::ray(&p, &along, &solid.mesh().corners(t as usize));
        hits.extend(hit.filter(|(at, _)| *at <= length).map(|(at, _)| (at, t)));
    });
    let first = hits.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let last = hits.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let middle = p + along * (0.5 * (first.0 + last.0));
    let normal = |hit: &(f64, u32)| solid.triangle_normals[hit.1 as usize];
    // On the two sides of a plate there is no ridge to go over.
    let direction = (normal(first) + normal(last)).try_normalize(RIDGE)?;
    if solid.surface.winding_number(&middle) <= SOLID_THRESHOLD {
        return None;
    }
    let goal = direction.dot(&middle) + (last.0 - first.0) + radius;
    let share = (middle - p).norm() / length;
    let weights = [1.0 - share, share, 0.0, 0.0];
    Some(Aim {
        points: [ends[0], ends[1], ends[0], ends[0]],
        weights,
        direction,
        goal,
        radius,
        of_solid: false,
    })
}

/// Points of inside regions, through what cut them off.
fn through_itself(sheet: &Sheet, tangles: &Tangles, radius: f64, x: &[Vec3]) -> Vec<Aim> {
    let regions = &tangles.regions;
    let targets: Vec<(u32, Vec<(u32, f64)>)> =
        regions.cuts.iter().map(|(&region, cut)| (region, targets(sheet, tangles, cut))).collect();
    (0..x.len() as u32)
        .into_par_iter()
        .filter_map(|p| {
            let region = *regions.of_point.get(p as usize)?;
            let at = targets.binary_search_by_key(&region, |(r, _)| *r).ok()?;
            closest_target(sheet, p, &targets[at].1, radius, x)
        })
        .collect()
}

/// Triangles that a cut-off region is to pass, with the sign of the side where it belongs:
/// those that cut it off and, of regions inside in turn, all.
fn targets(sheet: &Sheet, tangles: &Tangles, cut: &Cut) -> Vec<(u32, f64)> {
    let regions = &tangles.regions;
    let majority = cut.triangles.values().sum::<f64>().signum();
    let inside = |p: &u32| regions.is_inside(*p) && cut.regions.contains(&regions.of_point[*p as usize]);
    let whole = (0..sheet.triangles.len() as u32)
        .filter(|t| !cut.triangles.contains_key(t) && sheet.triangles[*t as usize].iter().all(inside));
    cut.triangles.iter().map(|(&t, &s)| (t, s)).chain(whole.map(|t| (t, majority))).collect()
}

fn closest_target(sheet: &Sheet, p: u32, targets: &[(u32, f64)], radius: f64, x: &[Vec3]) -> Option<Aim> {
    let at = x[p as usize];
    let mut best: Option<(f64, u32, f64, [f64; 3])> = None;
    for &(t, sign) in targets {
        let tri = &sheet.triangles[t as usize];
        if sheet.share_node(&[p], tri) {
            continue;
        }
        let corners = tri.map(|i| x[i as usize]);
        let b = triangle::closest(&at, &corners);
        let d = (at - triangle::at(&corners, &b)).norm_squared();
        if best.is_none_or(|(least, ..)| d < least) {
            best = Some((d, t, sign, b));
        }
    }
    let (_, t, sign, b) = best?;
    let [i, j, k] = sheet.triangles[t as usize];
    let corners = [i, j, k].map(|i| x[i as usize]);
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).try_normalize(0.0)?;
    let (points, weights) = ([p, i, j, k], [1.0, -b[0], -b[1], -b[2]]);
    Some(Aim { points, weights, direction: normal * sign, goal: radius, radius, of_solid: false })
}

/// Crossings that no region explains: the edge one way, the triangle the other.
fn shorter_contours(sheet: &Sheet, tangles: &Tangles, radius: f64, x: &[Vec3]) -> Vec<Aim> {
    let regions = &tangles.regions;
    let open: Vec<[u32; 2]> = tangles
        .own
        .iter()
        .copied()
        .filter(|&[e, t]| {
            let of = sheet.edges.ends[e as usize].iter().chain(&sheet.triangles[t as usize]);
            !of.copied().any(|p| regions.is_inside(p))
        })
        .collect();
    let mut aims = Vec::new();
    for node in contour::nodes(sheet, &open, x) {
        let Some(direction) = node.shrink.try_normalize(0.1) else { continue };
        let [p, q] = sheet.edges.ends[node.edge as usize];
        let [i, j, k] = sheet.triangles[node.triangle as usize];
        let b = node.barycentric;
        let mut draw = |points: [u32; 4], weights: [f64; 4], direction: Vec3| {
            let at: Vec3 = (0..4).map(|k| x[points[k] as usize] * weights[k]).sum();
            let goal = direction.dot(&at) + 0.5 * CONTOUR_STEP;
            aims.push(Aim { points, weights, direction, goal, radius, of_solid: false });
        };
        draw([p, q, p, p], [1.0 - node.along, node.along, 0.0, 0.0], direction);
        draw([i, j, k, i], [b[0], b[1], b[2], 0.0], -direction);
    }
    aims
}
