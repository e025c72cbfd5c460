//! What is minimised: cloth that hangs from held nodes, without contact.

use dressform::device::Device;
use dressform::drape::cloth::{Cloth, Options};
use dressform::drape::elastic::Elastic;
use dressform::model::{Fabric, Garment, GarmentSource, Vec2, Vec3};

use crate::disc;

/// Acceleration of gravity along -Y [m/s^2].
pub const GRAVITY: f64 = 9.81;
/// Waves of the ripple that the disc starts from.
const WAVES: f64 = 7.0;
/// Side of the sheet [m].
const SIDE: f64 = 0.4;

/// Cloth of one panel: nodes and vertices are the same.
pub struct Problem {
    pub garment: Garment,
    pub cloth: Cloth,
    /// Which nodes are held.
    pub held: Vec<bool>,
    /// Mean weight of a free node [N].
    weight: f64,
    elastic: Elastic,
}

/// A quasi-static step: from rest at `from`, with `inertia` = 1/h^2 [1/s^2].
pub struct Step {
    pub from: Vec<Vec3>,
    pub inertia: f64,
}

/// The objective of a step at one configuration.
pub struct Here {
    /// [J]
    pub energy: f64,
    /// By node, 0 where it is held [N].
    pub gradient: Vec<Vec3>,
    /// The largest net force on a node, without inertia, in mean node weights.
    pub net: f64,
}

impl Problem {
    fn new(garment: Garment, held: &[u32]) -> Problem {
        let cloth = Cloth::new(&garment, &garment.pattern, &Options::default()).expect("a cloth");
        assert!((0..).zip(&cloth.node_of_vertex).all(|(v, n)| v == *n), "one panel has no seams");
        let mut is_held = vec![false; cloth.node_count];
        held.iter().for_each(|&v| is_held[v as usize] = true);
        let free: Vec<f64> =
            cloth.masses.iter().zip(&is_held).filter(|(_, held)| !**held).map(|(m, _)| *m).collect();
        let weight = GRAVITY * free.iter().sum::<f64>() / free.len() as f64;
        let elastic = Elastic::new(&Device::cpu(), &cloth).expect("fits");
        Problem { garment, cloth, held: is_held, weight, elastic }
    }

    /// The disc of Cusick's test, of elements of about `h` [m], clamped in its middle.
    pub fn disc(h: f64) -> Problem {
        let garment = disc::garment(&Fabric::default(), h, WAVES, 1.0);
        let clamped = disc::clamped(&garment, h);
        Problem::new(garment, &clamped)
    }

    /// A level square of `n` times `n` nodes, held at two neighbouring corners.
    pub fn sheet(n: usize) -> Problem {
        let at = |i: usize, j: usize| Vec2::new(i as f64, j as f64) * (SIDE / (n - 1) as f64);
        let pattern: Vec<Vec2> = (0..n * n).map(|k| at(k % n, k / n)).collect();
        // A ripple of a tenth of a millimetre, for folds to start from.
        let place = |p: &Vec2| Vec3::new(p.x, 1e-4 * (40.0 * p.x + 25.0 * p.y).sin(), -p.y);
        let square = |k: usize| {
            let [a, b, c, d] = [k, k + 1, k + n, k + n + 1].map(|v| v as u32);
            [[a, b, d], [a, d, c]]
        };
        let triangles: Vec<[u32; 3]> = (0..n * (n - 1)).filter(|k| k % n != n - 1).flat_map(square).collect();
        let source = GarmentSource::sheet("sheet", &pattern, &triangles, &Fabric::default(), place);
        let garment = Garment::from_source(source).expect("a sheet is a garment");
        let corner = |v: &u32| {
            let p = garment.pattern[*v as usize];
            p.y == 0.0 && (p.x == 0.0 || p.x == at(n - 1, 0).x)
        };
        let held: Vec<u32> = (0..garment.points.len() as u32).filter(corner).collect();
        Problem::new(garment, &held)
    }

    /// The objective of `step` with the nodes at `x` [m], and its gradient, in `f64`:
    /// elasticity and weight, `sum m |x - from|^2 / (2 h^2)`.
    pub fn evaluate(&self, x: &[Vec3], step: &Step) -> Here {
        let (mut energy, mut gradient) = self.elastic.judge(x);
        let mut net: f64 = 0.0;
        for (i, g) in gradient.iter_mut().enumerate() {
            if self.held[i] {
                *g = Vec3::zeros();
                continue;
            }
            let (m, moved) = (self.cloth.masses[i], x[i] - step.from[i]);
            g.y += m * GRAVITY;
            net = net.max(g.norm());
            *g += moved * (m * step.inertia);
            energy += m * (GRAVITY * x[i].y + 0.5 * step.inertia * moved.norm_squared());
        }
        Here { energy, gradient, net: net / self.weight }
    }

    /// Elastic energy and that of the weight with the nodes at `x` [m], and its gradient.
    pub fn potential(&self, x: &[Vec3]) -> Here {
        self.evaluate(x, &Step { from: x.to_vec(), inertia: 0.0 })
    }

    /// The elastic energy's gradient with the nodes at `x` [m], by the crate's judge [N].
    pub fn elastic_gradient(&self, x: &[Vec3]) -> Vec<Vec3> {
        self.elastic.judge(x).1
    }

    /// The largest force on a node in mean node weights.
    pub fn residual(&self, gradient: &[Vec3]) -> f64 {
        gradient.iter().map(Vec3::norm).fold(0.0, f64::max) / self.weight
    }
}
