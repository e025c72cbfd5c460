//! Out of slots that are too narrow for the cloth.
//!
//! Where an arm lies against its flank, or a lower sleeve does, skin or cloth leaves a slot that
//! closes towards its bottom. The closest way out of what is on one side of a slot leads into what
//! is on the other, so that cloth caught there goes back and forth and stays. Its way leads along
//! the slot, to a place in front of which there is room for it: all cloth in the slot that hangs
//! together with what is tangled aims there, each point to a triangle that faces as the cloth
//! does, with no collider in its way.

use rayon::prelude::*;

use super::aim::Aim;
use super::crossing::Tangles;
use super::fixed::{FACING, Fixed};
use super::pairs::{Radii, Scene};
use crate::geometry::topology::neighbours;
use crate::model::Vec3;

/// How far cloth is carried out of a slot [m]: what is deeper, between thighs say, has to stay
/// between them.
const REACH: f64 = 0.08;
/// Where on a triangle its slot is measured: shares of the corners.
const PROBES: [[f64; 3]; 4] = [[1.0 / 3.0; 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]];
/// A ray starts this far from the triangle that it leaves [m].
const CLEAR: f64 = 1e-6;

/// The aims of what is caught in slots of colliders, out of them; one for each contact point, and
/// of those that several colliders ask for the farthest.
pub fn out_of_slots(scene: &Scene<'_>, tangles: &Tangles, radii: &Radii, x: &[Vec3]) -> Vec<Aim> {
    let normals = scene.sheet.normals(x);
    let neighbours = neighbours(x.len(), &scene.sheet.triangles);
    let mut farthest: Vec<Option<Aim>> = vec![None; x.len()];
    for (c, collider) in scene.colliders.iter().enumerate() {
        // A sheet that faces the other way by and large has no side that is known to be outside.
        if !collider.solid && !tangles.outward[c] {
            continue;
        }
        // Room for two layers, each off the collider and off the other.
        let radius = radii.collider[c];
        let width = 2.0 * radius + radii.own;
        let closed = closed(collider, width);
        let in_slot = |p: u32| {
            let side = collider.side(&x[p as usize]);
            side.signed < width && closed[side.triangle as usize]
        };
        for p in caught(tangles.around(&scene.sheet, 0), &neighbours, &in_slot) {
            let (at, normal) = (x[p as usize], tangles.outward[c].then_some(&normals[p as usize]));
            let Some(target) = exit(collider, &closed, radius, &at, normal) else { continue };
            let Some(direction) = (target - at).try_normalize(1e-9) else { continue };
            let goal = direction.dot(&target);
            let (points, weights) = ([p; 4], [1.0, 0.0, 0.0, 0.0]);
            let aim = Aim { points, weights, direction, goal, radius, of_solid: collider.solid };
            let best = &mut farthest[p as usize];
            if best.is_none_or(|best| best.short_of(x) < aim.short_of(x)) {
                *best = Some(aim);
            }
        }
    }
    farthest.into_iter().flatten().collect()
}

/// The triangles of a collider in front of which the next is nearer than `width` [m], or that lie
/// inside of it.
fn closed(collider: &Fixed<'_>, width: f64) -> Vec<bool> {
    let mesh = collider.mesh();
    let hidden = &collider.hidden().partly;
    let meets = |t: usize| {
        let (corners, normal) = (mesh.corners(t), collider.triangle_normals[t]);
        PROBES.iter().any(|shares| {
            let at: Vec3 = corners.iter().zip(shares).map(|(c, s)| c * *s).sum();
            let hit = collider.surface.ray(&(at + normal * CLEAR), &normal, width - CLEAR);
            // The far side of another fold of a sheet has the sheet's own inside before it.
            hit.is_some_and(|hit| {
                collider.solid || collider.triangle_normals[hit.triangle as usize].dot(&normal) < 0.0
            })
        })
    };
    (0..mesh.triangles.len()).into_par_iter().map(|t| hidden[t] || meets(t)).collect()
}

/// Where cloth at `at` with this outward `normal` leaves the slot that it is in.
fn exit(
    collider: &Fixed<'_>,
    closed: &[bool],
    radius: f64,
    at: &Vec3,
    normal: Option<&Vec3>,
) -> Option<Vec3> {
    let open = |t: u32| !closed[t as usize];
    let faces = |t: u32| normal.is_none_or(|n| collider.triangle_normals[t as usize].dot(n) > FACING);
    let closest = |keep: &dyn Fn(u32) -> bool| collider.surface.closest_among(at, REACH, keep);
    let out = closest(&|t| open(t) && faces(t)).or_else(|| closest(&open))?;
    Some(out.point + collider.triangle_normals[out.triangle as usize] * radius)
}

/// Points in a slot that hang together with the `tangled` ones.
fn caught(tangled: Vec<bool>, neighbours: &[Vec<u32>], in_slot: &dyn Fn(u32) -> bool) -> Vec<u32> {
    let mut seen = tangled;
    let mut front: Vec<u32> = (0..seen.len() as u32).filter(|&p| seen[p as usize]).collect();
    let mut caught = Vec::new();
    while let Some(p) = front.pop() {
        if !in_slot(p) {
            continue;
        }
        caught.push(p);
        for &q in &neighbours[p as usize] {
            if !std::mem::replace(&mut seen[q as usize], true) {
                front.push(q);
            }
        }
    }
    caught
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::contact::sheet::Sheet;
    use crate::drape::tests::patches;
    use crate::geometry::Surface;

    /// A slot along z between walls that are 2 mm apart where `x` is 0.15: 4 cm deep, open at y = 0.
    fn slot(x: f64, z: f64) -> Vec3 {
        let (s, side) = ((x - 0.15).abs(), (x - 0.15).signum());
        let depth = 0.04;
        Vec3::new(0.15 + side * (s.min(1e-3) + (s - depth).max(0.0)), (s - depth).min(0.0), z)
    }

    #[test]
    fn what_is_caught_in_a_slot_of_a_lower_layer_aims_out_of_it() {
        let layer = Surface::new(patches(60, 0.3, &[&slot]).mesh());
        // A fold that reaches into the slot to 1 cm above its bottom and passes through its wall.
        let fold = |x: f64, z: f64| {
            let s = x - 0.08;
            Vec3::new(0.1507 + 0.03 * s.min(0.0).abs().min(0.02) + 1e-4 * s, s.abs() - 0.03, z + 0.07)
        };
        let garment = patches(16, 0.16, &[&fold]);
        let sheet = Sheet::new(&garment);
        let x = sheet.points(&garment.points);
        let scene = Scene { sheet, colliders: vec![Fixed::new(&layer, false)] };
        let mut tangles = Tangles::find(&scene.sheet, &scene.colliders, &x);
        assert!(tangles.crossings > 0);
        tangles.outward = vec![true];
        let radii = Radii { collider: vec![2e-3], own: 2e-3 };
        let aims = out_of_slots(&scene, &tangles, &radii, &x);
        let deep: Vec<&Aim> = aims.iter().filter(|aim| x[aim.points[0] as usize].y < -0.015).collect();
        assert!(deep.len() > 17, "{}", deep.len());
        for aim in deep {
            let at = x[aim.points[0] as usize];
            let end = at + aim.direction * aim.short_of(&x);
            assert!(end.y > -5e-3 && end.y < 0.01 && (end.x - 0.15).abs() < 0.02, "{at} {end}");
        }
        // On the flat part of the layer there is no slot.
        assert!(aims.iter().all(|aim| x[aim.points[0] as usize].y < 6e-3));
    }
}
