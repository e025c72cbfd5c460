//! Details over sharp creases.
//!
//! Where the proxy has creased, all vertices of a detail may be at their distance and still the
//! crest comes through a triangle between them. The triangles that cross something are raised,
//! a little in each round, until they are clear; of two details that cross, the outer one. The
//! round with the fewest crossings counts (in a valley raising does not help).

use super::Split;
use super::binding::Deformed;
use crate::geometry::{Surface, intersect};
use crate::model::{Garment, Vec3};

/// Share of its distance by which a vertex is raised in a round.
const STEP: f64 = 0.02;
/// Most rounds.
const ROUNDS: usize = 15;

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
        let mut up = vec![false; lifted.len()];
        for [a, b] in crossing {
            let outer = if height(a) > height(b) { a } else { b };
            bonds_of(outer).for_each(|b| up[b] = true);
        }
        for (b, bond) in split.bonds.iter().enumerate().filter(|(b, _)| up[*b]) {
            if bond.in_surface() || bond.beyond {
                continue;
            }
            let away = lifted[b] - deformed.on_patch(bond, &lifted[b]).point;
            lifted[b] += away.try_normalize(0.0).unwrap_or_else(Vec3::zeros) * (STEP * bond.distance);
            raised[b] = true;
        }
    }
    *lifted = best.1;
    best.2
}
