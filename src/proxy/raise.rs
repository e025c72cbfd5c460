//! Details over sharp creases.
//!
//! Where the proxy has creased, all vertices of a detail may be at their distance and still the
//! crest comes through a triangle between them. The triangles that cross something are raised,
//! a little in each round, until they are clear; of two details that cross, the outer one. The
//! round with the fewest crossings counts (in a valley raising does not help).
//!
//! Corners of a triangle go the same way, the mean of their own ways off the proxy. Over a crest whose
//! flanks slope by `b` that clears it at `cos^2 b` of the change of distance that each corner's own
//! way would take.

use super::Split;
use super::binding::Deformed;
use crate::geometry::{Surface, intersect};
use crate::model::{Garment, Vec3};

/// Share of its distance by which a vertex is raised in a round.
const STEP: f64 = 0.01;
/// Most rounds.
const ROUNDS: usize = 30;

/// Raises the bonds' positions `lifted` [m] over the proxy at `points` [m]; says which were.
pub fn run(
    split: &Split,
    whole: &Garment,
    deformed: &Deformed,
    points: &[Vec3],
    lifted: &mut Vec<Vec3>,
) -> Vec<bool> {
    let mut bond_of = vec![None; whole.points.len()];
    for (&v, &b) in split.details.vertices.iter().zip(&split.bond_of) {
        bond_of[v as usize] = Some(b as usize);
    }
    let bonds_of = |t: u32| whole.triangles[t as usize].iter().filter_map(|&v| bond_of[v as usize]);
    let height = |t: u32| bonds_of(t).map(|b| split.bonds[b].distance).sum::<f64>();
    let mut best = (usize::MAX, lifted.clone(), vec![false; lifted.len()]);
    let mut raised = best.2.clone();
    for round in 0..=ROUNDS {
        let surface = Surface::new(whole.welded_mesh(&split.assemble(points, lifted)));
        let mut crossing = intersect::self_intersections(&surface);
        crossing.retain(|pair| pair.iter().any(|&t| bonds_of(t).next().is_some()));
        if crossing.len() < best.0 {
            best = (crossing.len(), lifted.clone(), raised.clone());
        }
        if crossing.is_empty() || round == ROUNDS {
            break;
        }
        let away = |b: usize| {
            let bond = Some(&split.bonds[b]).filter(|bond| !bond.in_surface() && !bond.beyond)?;
            (lifted[b] - deformed.on_patch(bond, &lifted[b]).point).try_normalize(0.0)
        };
        let mut ways = vec![Vec3::zeros(); lifted.len()];
        for [a, b] in crossing {
            let outer = if height(a) > height(b) { a } else { b };
            let mean: Vec3 = bonds_of(outer).filter_map(away).sum();
            bonds_of(outer).for_each(|b| ways[b] += mean);
        }
        let steps: Vec<(usize, Vec3)> = (0..lifted.len())
            .filter(|&b| ways[b] != Vec3::zeros())
            .filter_map(|b| away(b).map(|own| (b, ways[b].try_normalize(1e-9).unwrap_or(own))))
            .collect();
        for (b, way) in steps {
            lifted[b] += way * (STEP * split.bonds[b].distance);
            raised[b] = true;
        }
    }
    *lifted = best.1;
    best.2
}
