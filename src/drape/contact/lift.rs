//! Over the folds of a lower layer.
//!
//! A finished lower garment has folds that overhang, and an upper one that was transferred as if
//! they were not there passes through them. The closest way out of such a fold leads into the slot
//! beneath it, where the upper cloth would stay caught. Near a tangle with a layer the upper cloth
//! therefore looks outward along its own normals, and aims over the last sheet of the layer that
//! it sees the outside of: points in the slot, which the layer has below it, too.
//!
//! What it sees ends where a solid begins: from the flank, the sleeve around an arm is not above.

use rayon::prelude::*;

use super::aim::Aim;
use super::crossing::Tangles;
use super::fixed::{FACING, Fixed};
use super::pairs::{Radii, Scene};
use super::tree::{BoxTree, bounds};
use crate::geometry::triangle;
use crate::model::Vec3;

/// How far outward sheets of a layer count as above [m].
const REACH: f64 = 0.05;
/// How far around a tangle the cloth is lifted [m].
const AROUND: f64 = 0.05;

/// Aims over everything of lower layers that lies above the cloth, around what is tangled with them,
/// and which contact points are around it.
pub fn over_layers(scene: &Scene<'_>, tangles: &Tangles, radii: &Radii, x: &[Vec3]) -> (Vec<Aim>, Vec<bool>) {
    let (mut aims, mut free) = (Vec::new(), vec![false; x.len()]);
    let normals = scene.sheet.normals(x);
    for (c, layer) in scene.colliders.iter().enumerate() {
        if layer.solid || !tangles.outward[c] {
            continue;
        }
        let near = around(scene, tangles, c, x);
        near.iter().for_each(|&p| free[p as usize] = true);
        aims.par_extend(near.into_par_iter().filter_map(|p| {
            let (at, normal) = (x[p as usize], normals[p as usize]);
            let above = last_sheet(layer, &at, &normal, sight(scene, &at, &normal))?;
            let (points, weights) = ([p; 4], [1.0, 0.0, 0.0, 0.0]);
            let radius = radii.collider[c];
            let goal = normal.dot(&at) + above + radius;
            Some(Aim { points, weights, direction: normal, goal, radius, of_solid: false })
        }));
    }
    (aims, free)
}

/// Contact points close to one that is below collider `c` or that an edge through it belongs to.
fn around(scene: &Scene<'_>, tangles: &Tangles, c: usize, x: &[Vec3]) -> Vec<u32> {
    let mut tangled = tangles.inside[c].clone();
    for (triangle, _) in scene.sheet.triangles.iter().zip(&tangles.triangles[c]).filter(|(_, t)| **t) {
        triangle.iter().for_each(|&p| tangled[p as usize] = true);
    }
    let places: Vec<Vec3> = x.iter().zip(&tangled).filter(|(_, t)| **t).map(|(p, _)| *p).collect();
    let tree = BoxTree::new(places.iter().map(|p| (*p, *p)));
    let near = |p: &u32| {
        let at = x[*p as usize];
        let mut found = tangled[*p as usize];
        if !found {
            tree.query(&bounds(&[at], AROUND), &mut |i| {
                found |= (places[i as usize] - at).norm_squared() < AROUND * AROUND;
            });
        }
        found
    };
    (0..x.len() as u32).into_par_iter().filter(near).collect()
}

/// How far the cloth sees along `normal` before it looks into a solid [m].
fn sight(scene: &Scene<'_>, at: &Vec3, normal: &Vec3) -> f64 {
    let enters = |solid: &Fixed<'_>| {
        let hit = solid.surface.ray(at, normal, REACH)?;
        (solid.triangle_normals[hit.triangle as usize].dot(normal) < 0.0).then_some(hit.distance)
    };
    let solids = scene.colliders.iter().filter(|c| c.solid);
    solids.filter_map(enters).fold(REACH, f64::min)
}

/// How far above `at` the last sheet of `layer` is that faces along `normal` [m].
fn last_sheet(layer: &Fixed<'_>, at: &Vec3, normal: &Vec3, sight: f64) -> Option<f64> {
    let mut last: Option<f64> = None;
    layer.triangle_tree.query(&bounds(&[*at, at + normal * sight], 0.0), &mut |t| {
        if layer.triangle_normals[t as usize].dot(normal) < FACING {
            return;
        }
        let hit = triangle::ray(at, normal, &layer.mesh().corners(t as usize));
        if let Some((distance, _)) = hit.filter(|(distance, _)| *distance <= sight) {
            last = Some(last.map_or(distance, |l| l.max(distance)));
        }
    });
    last
}
