//! A simulation from what the caller gave.

use super::contact::fixed::Fixed;
use super::contact::pairs::{Radii, Scene};
use super::contact::sheet::Sheet;
use super::hold::ties::Hold;
use super::offsets::Offsets;
use super::press::Press;
use super::simulation::{Parts, Simulation};
use super::{Error, Input, Params, cloth, elastic};
use crate::device::Device;

/// The garment of `input` at rest where it starts, classified.
pub(super) fn simulation<'a>(
    device: &'a Device,
    input: &'a Input<'a>,
    params: &'a Params,
) -> Result<Simulation<'a>, Error> {
    let garment = input.garment;
    let cloth = cloth::Cloth::new(garment, input.pattern, &params.cloth)?;
    let nodes = cloth.node_count;
    let mut masses = cloth.masses.clone();
    let mut is_pinned = vec![false; nodes];
    let friction = node_friction(&cloth);
    let area = cloth.areas.iter().sum::<f64>() / nodes.max(1) as f64;
    for &v in input.pinned {
        let p = garment.groups.node_of_vertex[v as usize] as usize;
        is_pinned[p] = true;
        masses[p] = PINNED_MASS;
    }
    let solids = input.colliders.iter().map(|s| Fixed::new(s, true));
    let colliders: Vec<Fixed<'a>> = solids.chain(input.layers.iter().map(|s| Fixed::new(s, false))).collect();
    let radius = |c: &Fixed<'_>| if c.solid { params.body_distance } else { params.layer_distance };
    let radii = Radii { collider: colliders.iter().map(radius).collect(), own: params.self_distance };
    let parts = Parts {
        scene: Scene { sheet: Sheet::new(garment), colliders },
        radii,
        elastic: elastic::Elastic::new(device, &cloth)?,
        offsets: Offsets::new(garment, input.points, input.pattern),
        hold: Hold::new(
            garment,
            input.points,
            input.pattern,
            input.held,
            input.colliders,
            params.body_distance,
            &params.hold,
        ),
        masses,
        friction,
        pinned: is_pinned,
        x: garment.groups.node_points(input.points),
        stiffness: params.contact_stiffness * area,
        press: Press::new(&cloth, garment, input.points, params.press),
    };
    Simulation::new(device, params, parts)
}

/// Mass that holds a pinned node against any force [kg].
const PINNED_MASS: f64 = 1e4;

/// Friction coefficient of each node: its triangles' fabrics, weighted by area.
fn node_friction(cloth: &cloth::Cloth) -> Vec<f64> {
    let (mut sum, mut area) = (vec![0.0; cloth.node_count], vec![0.0; cloth.node_count]);
    for t in 0..cloth.triangles.len() {
        for n in cloth.nodes(t) {
            sum[n as usize] += cloth.areas[t] * cloth.fabric(t).friction;
            area[n as usize] += cloth.areas[t];
        }
    }
    sum.iter().zip(&area).map(|(s, a)| if *a > 0.0 { s / a } else { 0.0 }).collect()
}
