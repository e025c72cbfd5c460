//! Pairs of primitives that may come into contact, and the scene that they are of.

use super::ccd::Shape;
use super::fixed::Fixed;
use super::sheet::Sheet;
use crate::model::Vec3;

/// Marks a corner that belongs to a collider.
pub const FIXED: u32 = u32::MAX;

/// Who the two primitives are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Contact point `a`, collider triangle `b`.
    OnCollider,
    /// Collider point `a`, cloth triangle `b`.
    UnderCloth,
    /// Cloth edge `a`, collider edge `b`.
    EdgeCollider,
    /// Contact point `a`, cloth triangle `b`.
    OwnFace,
    /// Cloth edges `a` and `b`.
    OwnEdges,
}

impl Role {
    /// Whether both are of the cloth.
    pub fn is_own(self) -> bool {
        matches!(self, Role::OwnFace | Role::OwnEdges)
    }

    /// Its closest-point problem.
    pub fn shape(self) -> Shape {
        match self {
            Role::EdgeCollider | Role::OwnEdges => Shape::SegmentSegment,
            _ => Shape::PointTriangle,
        }
    }
}

/// How a pair is treated during a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// On its right side: barrier, never crossed.
    Clean,
    /// Starts tangled: spring along the signed distance, may pass. Pairs of one garment have
    /// the sign that the gap has on the source; colliders know theirs.
    Wrong {
        /// The sign that the gap is to have.
        sign: f64,
    },
}

/// A pair of primitives.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Who they are.
    pub role: Role,
    /// Collider, where there is one.
    pub collider: u16,
    /// See [`Role`].
    pub a: u32,
    /// See [`Role`].
    pub b: u32,
    /// Distance at which it resists [m].
    pub radius: f64,
    /// Distance where it was found [m].
    pub found_at: f64,
    /// Treatment.
    pub mode: Mode,
}

/// Everything that poses closest-point problems.
pub struct Scene<'a> {
    /// The cloth.
    pub sheet: Sheet,
    /// What does not move.
    pub colliders: Vec<Fixed<'a>>,
}

impl Scene<'_> {
    /// What belongs to the four points of a pair: `cloth` of a contact point, `fixed` of a point of
    /// the pair's collider.
    #[inline]
    pub fn of_corners<T>(
        &self,
        pair: &Pair,
        cloth: impl Fn(u32) -> T + Copy,
        fixed: impl Fn(u32) -> T + Copy,
    ) -> [T; 4] {
        let (sheet, a, b) = (&self.sheet, pair.a as usize, pair.b as usize);
        let collider = || &self.colliders[pair.collider as usize];
        let one_and_three = |p: T, [q, r, s]: [T; 3]| [p, q, r, s];
        let two_and_two = |[p, q]: [T; 2], [r, s]: [T; 2]| [p, q, r, s];
        match pair.role {
            Role::OwnFace => one_and_three(cloth(pair.a), sheet.triangles[b].map(cloth)),
            Role::OnCollider => one_and_three(cloth(pair.a), collider().mesh().triangles[b].map(fixed)),
            Role::UnderCloth => one_and_three(fixed(pair.a), sheet.triangles[b].map(cloth)),
            Role::OwnEdges => two_and_two(sheet.edges.ends[a].map(cloth), sheet.edges.ends[b].map(cloth)),
            Role::EdgeCollider => {
                two_and_two(sheet.edges.ends[a].map(cloth), collider().edges.ends[b].map(fixed))
            }
        }
    }

    /// The four points of a pair.
    #[inline]
    pub fn corners(&self, pair: &Pair, x: &[Vec3]) -> [Vec3; 4] {
        let fixed = |i: u32| self.colliders[pair.collider as usize].mesh().points[i as usize];
        self.of_corners(pair, |i| x[i as usize], fixed)
    }

    /// Which contact points the four are ([`FIXED`] if none).
    #[inline]
    pub fn ids(&self, pair: &Pair) -> [u32; 4] {
        self.of_corners(pair, |i| i, |_| FIXED)
    }
}

/// The gap's component along the triangle's normal, or along the edges' cross product.
pub fn orientation(role: Role, x: &[Vec3; 4], gap: &Vec3) -> f64 {
    match role.shape() {
        Shape::PointTriangle => gap.dot(&(x[2] - x[1]).cross(&(x[3] - x[1]))),
        Shape::SegmentSegment => gap.dot(&(x[1] - x[0]).cross(&(x[3] - x[2]))),
    }
}

/// Distances at which pairs resist [m].
#[derive(Clone, Debug)]
pub struct Radii {
    /// For each collider.
    pub collider: Vec<f64>,
    /// Between parts of the garment.
    pub own: f64,
}
