//! The same energies in `f64` on the host, from positions.

use rayon::prelude::*;

use super::element::{self, BendElement, NONE};
use super::hinge::{self, HingeRest};
use super::stretch::{self, StretchReference, StretchRest};
use super::{Error, GRAIN, flat};
use crate::drape::cloth::{Cloth, Hinge};
use crate::model::Vec3;

/// The constants of all elements.
#[derive(Debug)]
pub(super) struct Judge {
    vertices: usize,
    nodes: usize,
    triangles: Vec<[u32; 3]>,
    pub weights: Vec<[f64; 9]>,
    pub triangle_nodes: Vec<[u32; 3]>,
    pub stretch: Vec<StretchRest<f64>>,
    pub hinges: Vec<Hinge>,
    pub hinge_nodes: Vec<[u32; 4]>,
    pub hinge_rest: Vec<HingeRest<f64>>,
    pub elements: Vec<BendElement>,
    /// Vertices of each element's corners and far points, as its nodes are; [`NONE`] likewise.
    element_vertices: Vec<[u32; 6]>,
    node_of_vertex: Vec<u32>,
}

/// Strains and bends at some positions: what a device needs of a reference, and the energy.
pub struct Measured {
    pub(super) stretch: Vec<StretchReference<f64>>,
    pub(super) hinge_edges: Vec<[Vec3; 3]>,
    pub(super) amounts: Vec<[f64; 3]>,
    /// [J]
    pub energy: f64,
}

impl Judge {
    pub fn new(cloth: &Cloth) -> Judge {
        let elements = element::bend_elements(cloth);
        Judge {
            vertices: cloth.node_of_vertex.len(),
            nodes: cloth.node_count,
            triangles: cloth.triangles.clone(),
            weights: elements.iter().map(|e| flat(&e.weights)).collect(),
            triangle_nodes: (0..cloth.triangles.len()).map(|t| cloth.nodes(t)).collect(),
            stretch: (0..cloth.triangles.len()).map(|t| element::stretch_rest(cloth, t)).collect(),
            hinges: cloth.hinges.clone(),
            hinge_nodes: cloth.hinges.iter().map(|h| element::hinge_nodes(cloth, h)).collect(),
            hinge_rest: cloth.hinges.iter().map(|h| element::hinge_rest(cloth, h)).collect(),
            element_vertices: elements.iter().enumerate().map(|(e, b)| vertices(cloth, e, b)).collect(),
            node_of_vertex: cloth.node_of_vertex.clone(),
            elements,
        }
    }

    /// Makes bending `factor` times as stiff as the fabrics are: what is more than theirs is about
    /// the hinges' angles `about` [rad].
    pub fn press(&mut self, factor: f64, about: &[f64]) {
        let root = factor.sqrt();
        self.weights = self.elements.iter().map(|e| flat(&e.weights).map(|w| w * root)).collect();
        for ((hinge, rest), about) in self.hinges.iter().zip(&mut self.hinge_rest).zip(about) {
            // Two quadratics of one variable are one, about the mean of where theirs are least.
            rest.angle = hinge.rest_angle + (1.0 - 1.0 / factor) * hinge::bend(hinge.rest_angle, *about);
        }
    }

    pub fn check(&self, points: &[Vec3]) -> Result<(), Error> {
        if points.len() != self.vertices {
            let (found, expected) = (points.len(), self.vertices);
            return Err(Error::Length { what: "the reference", found, expected });
        }
        match points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            Some(vertex) => Err(Error::NotFinite(vertex)),
            None => Ok(()),
        }
    }

    pub fn measure(&self, points: &[Vec3]) -> Measured {
        let stretch: Vec<_> = (0..self.triangles.len())
            .into_par_iter()
            .with_min_len(GRAIN)
            .map(|t| stretch::reference(self.columns(points, t)))
            .collect();
        let (hinge_edges, bends): (Vec<_>, Vec<f64>) = self
            .hinges
            .par_iter()
            .zip(&self.hinge_rest)
            .with_min_len(GRAIN)
            .map(|(hinge, rest)| {
                let edges = hinge.edges(points);
                let [e, a, b] = &edges;
                (edges, hinge::bend(rest.angle, hinge::angle(e, a, b)))
            })
            .unzip();
        let amounts: Vec<[f64; 3]> = self
            .elements
            .iter()
            .zip(&self.weights)
            .map(|(e, w)| element::amounts(&e.hinges, w, |h| bends[h]))
            .collect();
        let energy = self.stretch_energy(&stretch) + bend_energy(&amounts);
        Measured { stretch, hinge_edges, amounts, energy }
    }

    fn columns(&self, points: &[Vec3], t: usize) -> [Vec3; 2] {
        let [p0, p1, p2] = self.triangles[t].map(|v| points[v as usize]);
        stretch::columns(&self.stretch[t], [p1 - p0, p2 - p0])
    }

    fn stretch_energy(&self, references: &[StretchReference<f64>]) -> f64 {
        let still = [Vec3::zeros(); 2];
        let elements = references.iter().zip(&self.stretch);
        elements.map(|(r, rest)| stretch::energy(rest, &stretch::stretch(r, still))).sum()
    }

    pub fn judge(&self, points: &[Vec3]) -> (f64, Vec<Vec3>) {
        let measured = self.measure(points);
        (measured.energy, self.gradient(&measured))
    }

    /// The gradient by node [N].
    pub fn gradient(&self, measured: &Measured) -> Vec<Vec3> {
        let mut gradient = vec![Vec3::zeros(); self.nodes];
        self.accumulate(measured, |v, g| gradient[self.node_of_vertex[v as usize] as usize] += g);
        gradient
    }

    /// The gradient by vertex [N].
    pub fn by_vertex(&self, points: &[Vec3]) -> Vec<Vec3> {
        let mut gradient = vec![Vec3::zeros(); self.vertices];
        self.accumulate(&self.measure(points), |v, g| gradient[v as usize] += g);
        gradient
    }

    /// Calls `add` with every element's part of the gradient at a vertex.
    fn accumulate(&self, measured: &Measured, mut add: impl FnMut(u32, Vec3)) {
        for (t, vertices) in self.triangles.iter().enumerate() {
            let rest = &self.stretch[t];
            let s = stretch::stretch(&measured.stretch[t], [Vec3::zeros(); 2]);
            let [w, f] = stretch::gradient(rest, &s);
            for (&vertex, [a, b]) in vertices.iter().zip(stretch::shapes(rest)) {
                add(vertex, w * a + f * b);
            }
        }
        let hinge_gradients: Vec<[Vec3; 4]> = measured
            .hinge_edges
            .par_iter()
            .zip(&self.hinge_rest)
            .with_min_len(GRAIN)
            .map(|([e, a, b], rest)| hinge::gradient(rest, e, a, b))
            .collect();
        for (i, element) in self.elements.iter().enumerate() {
            let rows = element::amount_gradients(&element.hinges, &self.weights[i], |h| hinge_gradients[h]);
            let c = measured.amounts[i];
            for (&vertex, row) in self.element_vertices[i].iter().zip(rows) {
                if vertex != NONE {
                    add(vertex, row[0] * c[0] + row[1] * c[1] + row[2] * c[2]);
                }
            }
        }
    }
}

/// The vertices behind an element's nodes.
fn vertices(cloth: &Cloth, element: usize, bend: &BendElement) -> [u32; 6] {
    let hinge = |i: usize| &cloth.hinges[(bend.hinges[i] / 4) as usize];
    let Some(&[a, b, c]) = cloth.triangles.get(element) else {
        let Hinge { edge: [[x0, x1], _], opposite: [x2, x3], .. } = *hinge(0);
        return [x2, x0, x1, x3, NONE, NONE];
    };
    let far = |i: usize| match bend.hinges[i] {
        NONE => NONE,
        h => hinge(i).opposite[1 - (h / 2 % 2) as usize],
    };
    [a, b, c, far(0), far(1), far(2)]
}

fn bend_energy(amounts: &[[f64; 3]]) -> f64 {
    amounts.iter().flatten().map(|c| 0.5 * c * c).sum()
}
