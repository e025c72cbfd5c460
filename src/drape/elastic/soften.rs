//! The second derivatives that the device's positive semi-definite matrix leaves out, in `f64`.
//!
//! Of stretch the negative eigenvalues, of bending the angles' own curvature,
//! `sum_h m_h d^2 theta_h / dx^2` with `m_h` the moment at hinge `h`. Added to the device's blocks
//! they make the Hessian of the elastic energy (seam offsets held).

use nalgebra::Matrix3;

use super::judge::Judge;
use super::stretch::{self, StretchHessian};
use super::{Elastic, hinge};
use crate::drape::elastic::element::NONE;
use crate::model::Vec3;

impl Elastic {
    /// Nodes of the elements that [`Elastic::soften`] goes through: triangles, then hinges.
    pub fn softened_elements(&self) -> impl Iterator<Item = &[u32]> {
        let triangles = self.judge.triangle_nodes.iter().map(|t| &t[..]);
        triangles.chain(self.judge.hinge_nodes.iter().map(|h| &h[..]))
    }

    /// Row and column of every block that [`Elastic::soften`] gives, in its order.
    pub fn softened(&self) -> impl Iterator<Item = [u32; 2]> {
        let triangles = self.judge.triangle_nodes.iter().flat_map(square);
        triangles.chain(self.judge.hinge_nodes.iter().flat_map(square))
    }

    /// Calls `add` with every block that the device's matrix leaves out at vertex positions
    /// `points` [m], in the order of [`Elastic::softened`].
    ///
    /// # Panics
    /// If `points` has another length than the cloth has vertices.
    pub fn soften(&self, points: &[Vec3], add: &mut dyn FnMut(&Matrix3<f64>)) {
        let measured = self.judge.measure(points);
        for (rest, reference) in self.judge.stretch.iter().zip(&measured.stretch) {
            let s = stretch::stretch(reference, [Vec3::zeros(); 2]);
            let dropped = stretch::dropped(rest, &s);
            let shapes = stretch::shapes(rest);
            for g in shapes {
                shapes.iter().for_each(|h| add(&pulled_back(&dropped, g, *h)));
            }
        }
        let moments = moments(&self.judge, &measured.amounts);
        let hinges = measured.hinge_edges.iter().zip(&self.judge.hinge_rest).zip(moments);
        for (([e, a, b], rest), moment) in hinges {
            let blocks = hinge::hessian(rest, e, a, b);
            blocks.iter().flatten().for_each(|block| add(&(block * moment)));
        }
    }
}

/// All pairs of some nodes, row by row.
fn square<const N: usize>(nodes: &[u32; N]) -> impl Iterator<Item = [u32; 2]> + use<N> {
    let nodes = *nodes;
    (0..N * N).map(move |k| [nodes[k / N], nodes[k % N]])
}

/// The block of two corners from the blocks `ww`, `wf`, `ff`.
fn pulled_back([ww, wf, ff]: &StretchHessian<f64>, g: [f64; 2], h: [f64; 2]) -> Matrix3<f64> {
    ww * (g[0] * h[0]) + wf * (g[0] * h[1]) + wf.transpose() * (g[1] * h[0]) + ff * (g[1] * h[1])
}

/// The derivative of the bending energy in each hinge's angle [N m].
fn moments(judge: &Judge, amounts: &[[f64; 3]]) -> Vec<f64> {
    let mut moments = vec![0.0; judge.hinges.len()];
    for ((element, weights), c) in judge.elements.iter().zip(&judge.weights).zip(amounts) {
        for i in (0..3).filter(|&i| element.hinges[i] != NONE) {
            let moment = (0..3).map(|row| c[row] * weights[3 * row + i]).sum::<f64>();
            moments[(element.hinges[i] / 4) as usize] += moment;
        }
    }
    moments
}
