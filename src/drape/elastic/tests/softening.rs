//! The second derivatives that the device leaves out, against finite differences.

use nalgebra::{DMatrix, Matrix6};

use super::super::Elastic;
use super::super::hinge::{self, HingeRest};
use super::super::judge::Judge;
use super::super::stretch;
use super::derivatives::{STEP, at, deformations, folded, moved, nudged, rest, states};
use super::*;
use crate::drape::curvature::Curvature;
use crate::solve::block_cholesky::{Block, BlockFactor, BlockPattern};

#[test]
fn what_stretch_drops_and_keeps_is_the_gradients_derivative() {
    let rest = rest([3.0, 2.0, 0.7]);
    for f in deformations() {
        let mut expected = Matrix6::zeros();
        for k in 0..6 {
            let [a, b] = [STEP, -STEP].map(|by| stretch::gradient(&rest, &at(moved(&f, k, by))));
            for r in 0..6 {
                expected[(r, k)] = (a[r / 3][r % 3] - b[r / 3][r % 3]) / (2.0 * STEP);
            }
        }
        let (kept, dropped) = (stretch::hessian(&rest, &at(f)), stretch::dropped(&rest, &at(f)));
        let [ww, wf, ff] = [0, 1, 2].map(|i| kept[i] + dropped[i]);
        let mut found = Matrix6::zeros();
        found.fixed_view_mut::<3, 3>(0, 0).copy_from(&ww);
        found.fixed_view_mut::<3, 3>(0, 3).copy_from(&wf);
        found.fixed_view_mut::<3, 3>(3, 0).copy_from(&wf.transpose());
        found.fixed_view_mut::<3, 3>(3, 3).copy_from(&ff);
        let smallest = f[0].norm().min(f[1].norm());
        if smallest < 0.1 {
            continue; // there what is dropped is bounded
        }
        let tolerance = 1e-8 * (1.0 + expected.norm()) / smallest.powi(3).min(1.0);
        assert!((found - expected).abs().max() < tolerance, "{f:?}: {found} {expected}");
    }
}

#[test]
fn hinge_hessian_is_the_gradients_derivative() {
    let rest = HingeRest { angle: 0.0, floor_edge: 1e-12, floor_normal: [1e-18; 2] };
    let gradient = |p: &[Vec3; 4]| hinge::gradient(&rest, &(p[1] - p[0]), &(p[2] - p[0]), &(p[3] - p[0]));
    for (l, h) in [(0.01, 0.01), (0.01, 2e-4), (5e-4, 0.02)] {
        for angle in [0.0, 1e-6, 0.3, -1.57, 3.1, -3.1] {
            let p = folded(l, h, angle);
            let blocks = hinge::hessian(&rest, &(p[1] - p[0]), &(p[2] - p[0]), &(p[3] - p[0]));
            let size = blocks.iter().flatten().map(|b| b.norm()).fold(0.0, f64::max);
            let step = 1e-4 * l.min(h);
            for k in 0..12 {
                let [a, b] = [step, -step].map(|by| {
                    let mut p = p;
                    p[k / 3][k % 3] += by;
                    gradient(&p)
                });
                for i in 0..4 {
                    let expected = (a[i] - b[i]) / (2.0 * step);
                    let found = blocks[i][k / 3].column(k % 3).into_owned();
                    let error = (found - expected).norm();
                    assert!(error < 1e-5 * size, "l {l} h {h} angle {angle} {i} {k}: {error:e} of {size:e}");
                }
            }
        }
    }
}

#[test]
fn softened_hessian_is_the_gradients_derivative() {
    let device = crate::device::Device::cpu();
    for (cloth, points) in states() {
        let judge = Judge::new(&cloth);
        let n = 3 * cloth.node_count;
        let mut expected = DMatrix::zeros(n, n);
        for k in 0..n {
            let [a, b] = [1e-7, -1e-7].map(|by| judge.judge(&nudged(&cloth, &points, k, by)).1);
            for r in 0..n {
                expected[(r, k)] = (a[r / 3][r % 3] - b[r / 3][r % 3]) / 2e-7;
            }
        }
        let mut found = twins::dense_hessian(&device, &cloth, &points);
        let elastic = Elastic::new(&device, &cloth).unwrap();
        let mut places = elastic.softened();
        elastic.soften(&points, &mut |block| {
            let [row, column] = places.next().expect("a place for each block").map(|i| 3 * i as usize);
            let mut view = found.fixed_view_mut::<3, 3>(row, column);
            view += block;
        });
        assert!(places.next().is_none());
        let error = (&found - &expected).abs().max();
        assert!(error < 1e-4 * expected.abs().max(), "{error:e} of {:e}", expected.abs().max());
    }
}

#[test]
fn curvature_is_put_back_but_around_what_is_indefinite() {
    // A sheet under tension and shear but for one end of it, which is compressed in its plane.
    let place = |p: &Vec2| {
        let x = if p.x < 0.04 { 0.7 * p.x } else { 1.05 * p.x - 0.014 };
        Vec3::new(x, 0.0, 1.05 * p.y + 0.1 * p.x)
    };
    let garment = garment_of(&panel(12, 3, 0.02, Split::Irregular, 0.0), &Fabric::default(), place);
    let (cloth, points) = (cloth_of(&garment), garment.points.clone());
    let device = crate::device::Device::cpu();
    let mut elastic = Elastic::new(&device, &cloth).unwrap();
    elastic.rebase(&device, &points).unwrap();
    let rest = device.zeros("displacement", 3 * cloth.node_count).unwrap();
    elastic.linearise(&device, &rest).unwrap();
    let hessian = elastic.hessian();
    let (starts, columns) =
        (device.read(&hessian.row_start).unwrap(), device.read(&hessian.columns).unwrap());
    let pattern = BlockPattern::new(&starts, &columns).unwrap();
    let mut blocks: Vec<Block> =
        device.read(&hessian.blocks).unwrap().iter().map(|b| b.map(f64::from)).collect();
    for n in 0..cloth.node_count as u32 {
        [0, 4, 8].iter().for_each(|&k| blocks[pattern.slot(n, n).unwrap()][k] += 0.01);
    }
    let projected = blocks.clone();
    let mut true_blocks = blocks.clone();
    let mut places = elastic.softened();
    elastic.soften(&points, &mut |b| {
        let [row, column] = places.next().unwrap();
        let at = pattern.slot(row, column).unwrap();
        (0..9).for_each(|k| true_blocks[at][k] += b[(k / 3, k % 3)]);
    });
    let mut factor = BlockFactor::default();
    assert!(pattern.factor(&true_blocks, &mut factor).is_err());
    let mut curvature = Curvature::new(&pattern, &elastic).unwrap();
    assert!(curvature.put_back(&pattern, &mut blocks, &elastic, &points, &mut factor));
    let same = |a: &Block, b: &Block| (0..9).all(|k| (a[k] - b[k]).abs() < 1e-9 * (1.0 + b[k].abs()));
    let at = |node: u32| pattern.slot(node, node).unwrap();
    let (first, last) = (at(0), at(cloth.node_count as u32 - 1));
    assert!(same(&blocks[last], &true_blocks[last]) && !same(&blocks[last], &projected[last]));
    assert!(same(&blocks[first], &projected[first]) && !same(&blocks[first], &true_blocks[first]));
    // What the factor solves with is what `blocks` says.
    let x: Vec<Vec3> = (0..cloth.node_count).map(|i| Vec3::new(1.0, (i as f64).sin(), 0.5)).collect();
    let mut right = vec![Vec3::zeros(); x.len()];
    pattern.add_product(&blocks, &x, &mut right);
    let solved = pattern.solve(&mut factor, &right);
    assert!(solved.iter().zip(&x).all(|(a, b)| (a - b).norm() < 1e-6));
}
