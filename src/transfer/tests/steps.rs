//! Tight solves, early stops, refined and closing steps, garments beyond the band, folds.

use super::*;

#[test]
fn a_tight_solve_is_the_fixed_point_of_the_device() {
    let source = sphere(Vec3::zeros(), 0.12, 4);
    let target = mapped(&source, |p| Vec3::new(1.2 * p.x, 0.8 * p.y, p.z));
    let garment = sphere(Vec3::zeros(), 0.14, 3).points;
    let standard = Params { cell: 0.03, ..Params::default() };
    let tight = transfer(&source, &target, &garment, &Params { exact: true, ..standard.clone() });
    for inner in &tight.infos[0].inner {
        assert!(inner.converged && *inner.residuals.last().unwrap() <= exact::TOLERANCE, "{inner:?}");
    }
    let loose = transfer(&source, &target, &garment, &standard);
    assert!(loose.infos[0].cg_iterations < tight.infos[0].cg_iterations / 2);
    // Each inner loop stops a third of its tolerance of 0.1 mm from the solution.
    let apart = farthest(&loose.garments[0], &tight.garments[0]);
    assert!(apart > 1e-9 && apart < 1.5e-4, "{apart}");
}

#[test]
fn refinement_waits_until_the_gap_asks_for_it() {
    let source = sphere(Vec3::zeros(), 0.12, 5);
    let target = mapped(&source, |p| p * (1.1 + 0.2 * (150.0 * p.y).sin()));
    let run = |gap_p99: f64| {
        let params = Params { gap_p99, ..Params::default() };
        prepare(&Device::cpu(), &source, &target, &params).unwrap()
    };
    let first = run(1.0).course.gaps[0];
    // Closing is enough, and nothing is refined.
    let early = run(0.7 * first);
    assert!(early.course.stop == Stop::Reached && early.course.gaps.len() == 2);
    assert!(early.flow.steps[0].fine.is_none() && early.flow.closings.len() == 1);
    // Where it was tried in vain it is taken back.
    let vain = run(0.95 * early.course.gaps[1]);
    assert!(first < 5.0 * 0.95 * early.course.gaps[1] && vain.course.gaps[..2] == early.course.gaps[..2]);
    assert!(vain.flow.steps[0].fine.is_some() && vain.flow.closings.len() < vain.course.gaps.len() - 1);
    // It is not tried where it cannot be enough, and not for a gap that asks for fine cells.
    for asked in [0.15 * first, 4e-4] {
        let fine = run(asked);
        assert!(fine.flow.steps.len() == 1 && fine.flow.steps[0].fine.is_some());
        assert_eq!(fine.flow.closings.len(), fine.course.gaps.len() - 2);
    }
}

#[test]
fn what_bends_between_the_vertices_does_not_push_the_skin() {
    // Large triangles that grow: the flow rounds off the edges, and closing leaves what is between.
    let source = sphere(Vec3::zeros(), 0.12, 3);
    let target = mapped(&source, |p| p * 1.25);
    let prepared = prepare(&Device::cpu(), &source, &target, &Params::default()).unwrap();
    assert_eq!(prepared.body().len(), source.points.len());
    let surface = Surface::new(target.clone());
    let middles: Vec<Vec3> =
        (0..source.triangles.len()).map(|t| source.corners(t).iter().sum::<Vec3>() / 3.0).collect();
    let carried = prepared.carry(&Device::cpu(), &middles).unwrap().points;
    let mean = carried.iter().map(|p| surface.closest(p).distance).sum::<f64>() / carried.len() as f64;
    assert!(mean < 1e-4, "{mean}");
}

/// The sphere that is to be waved, with its first step refined.
fn refined(params: &Params) -> Prepared {
    let source = sphere(Vec3::zeros(), 0.12, 5);
    let target = mapped(&source, |p| p * (1.1 + 0.05 * (60.0 * p.y).sin()));
    prepare(&Device::cpu(), &source, &target, params).unwrap()
}

#[test]
fn a_refined_step_goes_over_into_the_coarse_one() {
    let params = Params { outer_iterations: 2, gap_p99: 1e-6, ..Params::default() };
    let prepared = refined(&params);
    let [step] = &prepared.flow.steps[..] else { panic!("one step, refined") };
    let (coarse, fine) = (&step.field, step.fine.as_ref().unwrap());
    assert_eq!(fine.domain.lattice.cell, params.cell / params.refinement as f64);
    let mut seed = 3;
    for _ in 0..2000 {
        let direction = Vec3::from_fn(|_, _| pseudo_random(&mut seed)).normalize();
        // Out along a ray to where the fine cells end.
        let last =
            (0..2000).map(|k| 0.12 + 1e-4 * f64::from(k)).find(|r| fine.sample(&(direction * *r)).is_none());
        let edge = direction * last.unwrap();
        let (inside, outside) = (edge - direction * 1e-4, edge);
        let jump = (fine.sample(&inside).unwrap().0 - coarse.sample(&outside).unwrap().0).norm();
        assert!(jump < 3e-5, "{jump} at {edge}");
    }
}

#[test]
fn refinement_brings_coarse_cells_near_to_fine_ones() {
    let cloth = sphere(Vec3::zeros(), 0.135, 4).points;
    let carried = |params: Params| {
        let params = Params { gap_p99: 1e-6, ..params };
        refined(&params).carry(&Device::cpu(), &cloth).unwrap().points
    };
    let standard = Params::default();
    let coarse = carried(Params { outer_iterations: 1, ..standard.clone() });
    let refined = carried(Params { outer_iterations: 2, ..standard.clone() });
    let fine = Params { cell: 0.01, beta: 4.0 * standard.beta, outer_iterations: 1, ..standard };
    let fine = carried(fine);
    let (before, after) = (farthest(&coarse, &fine), farthest(&refined, &fine));
    assert!(after < 0.3 * before, "{before} {after}");
}

#[test]
fn garments_far_from_the_body_stay_whole() {
    let source = sphere(Vec3::zeros(), 0.12, 4);
    let target = mapped(&source, |p| Vec3::new(1.3 * p.x, p.y, 0.9 * p.z));
    // A flared skirt from the skin to a third of a metre away, far outside of the band.
    let (rings, sectors) = (40, 60);
    let at = |ring: usize, sector: usize| {
        let (t, turn) = (ring as f64 / rings as f64, std::f64::consts::TAU * sector as f64 / sectors as f64);
        let radius = 0.13 + 0.35 * t;
        Vec3::new(radius * turn.cos(), -0.1 * t, radius * turn.sin())
    };
    let skirt: Vec<Vec3> = (0..=rings * sectors).map(|k| at(k / sectors, k % sectors)).collect();
    let prepared = prepare(&Device::cpu(), &source, &target, &Params::default()).unwrap();
    let carried = prepared.carry(&Device::cpu(), &skirt).unwrap();
    assert!(carried.extra_cells > 1000 && carried.converged);
    assert!(carried.determinant_min > 0.5, "{}", carried.determinant_min);
    let moved = |k: usize| carried.points[k] - skirt[k];
    for k in 0..rings * sectors - sectors {
        // Along a ray from the body the cloth follows without a jump at the band's edge.
        let jump = (moved(k + sectors) - moved(k)).norm();
        assert!(jump < 5e-3, "{jump} at {k}");
    }
    // What is solved beyond the band follows the body that it hangs from.
    assert!(moved(rings * sectors - 1).x.signum() == skirt[rings * sectors - 1].x.signum());
}

#[test]
fn folds_are_where_the_skin_comes_back_to_itself() {
    // A tube pinched to a crease of 4 mm along one side, and the same without a gap.
    let ball = sphere(Vec3::zeros(), 0.12, 5);
    let creased = mapped(&ball, |p| {
        let depth = 0.06 * (-(p.y / 0.004).powi(2)).exp() * (p.x.max(0.0) / 0.12);
        p * (1.0 - depth / 0.12)
    });
    let surface = Surface::new(creased);
    let areas = surface.mesh().point_areas();
    let gaps = vec![1e-3; areas.len()];
    let found = folds::find(&surface, &gaps, &areas, 5e-4, 0.02);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].center_m[0] > 0.0 && found[0].center_m[1].abs() < 0.01, "{found:?}");
    assert_eq!(found[0].gap_max_m, 1e-3);
    assert!(folds::find(&surface, &gaps, &areas, 2e-3, 0.02).is_empty(), "a closed gap is no fold");
    assert!(folds::find(&Surface::new(ball), &gaps, &areas, 5e-4, 0.02).is_empty(), "smooth skin");
}
