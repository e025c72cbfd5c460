//! Which joints of a skeleton are its arms, legs, spine and neck, and which way it faces.

use super::limbs::{self, Kind, Limb};
use super::names::{self, Part};
use super::set::Stance;
use crate::geometry::skinning::{self, SkinningError};
use crate::model::{Skeleton, Vec3};

/// The joints of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arm {
    /// What raises the shoulder, if the skeleton has it.
    pub clavicle: Option<usize>,
    /// Where the upper arm starts.
    pub upper: usize,
    /// Elbow.
    pub fore: usize,
    /// Wrist.
    pub hand: usize,
}

/// The joints of a leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leg {
    /// Where the thigh starts.
    pub thigh: usize,
    /// Knee.
    pub shin: usize,
    /// Ankle.
    pub foot: usize,
}

/// The figure's own directions in the world, each of length 1, and a point in its middle plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// To the figure's left.
    pub left: Vec3,
    /// Up; the world's +Y.
    pub up: Vec3,
    /// Where the figure faces.
    pub forward: Vec3,
    /// In the plane between left and right [m].
    pub middle: Vec3,
}

/// The parts of a skeleton; left before right.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Its directions.
    pub frame: Frame,
    /// Position of every joint in the bind pose [m].
    pub positions: Vec<Vec3>,
    /// Arms.
    pub arms: [Option<Arm>; 2],
    /// Legs.
    pub legs: [Option<Leg>; 2],
    /// Joints between hips and chest, the chest included.
    pub spine: Vec<usize>,
    /// Joints between chest and head, the head included.
    pub neck: Vec<usize>,
}

/// A skeleton's hierarchy with positions.
pub struct Tree<'a> {
    pub joints: &'a [String],
    pub parents: &'a [i32],
    pub positions: Vec<Vec3>,
    parts: Vec<Option<Part>>,
}

impl Tree<'_> {
    pub fn part(&self, joint: usize) -> Option<Part> {
        self.parts[joint]
    }

    pub fn side(&self, joint: usize) -> i32 {
        names::side(&self.joints[joint])
    }

    /// From a root down to `joint`, which is the last.
    pub fn path(&self, joint: usize) -> Vec<usize> {
        let up = std::iter::successors(Some(joint), |&j| usize::try_from(self.parents[j]).ok());
        let mut path: Vec<usize> = up.take(self.parents.len()).collect();
        path.reverse();
        path
    }

    /// Number of children.
    pub fn children(&self, joint: usize) -> usize {
        self.parents.iter().filter(|&&p| p == joint as i32).count()
    }

    /// Between the lowest and the highest joint [m].
    pub fn height(&self) -> f64 {
        let levels = || self.positions.iter().map(|p| p.y);
        levels().fold(f64::NEG_INFINITY, f64::max) - levels().fold(f64::INFINITY, f64::min)
    }

    /// The last joint that two paths have in common.
    fn fork(&self, a: usize, b: usize) -> Option<usize> {
        let (a, b) = (self.path(a), self.path(b));
        a.iter().zip(&b).take_while(|(x, y)| x == y).last().map(|(x, _)| *x)
    }
}

impl Figure {
    /// Finds the parts.
    ///
    /// # Errors
    /// A skeleton that is no tree or whose arrays do not fit.
    pub fn find(skeleton: &Skeleton) -> Result<Figure, SkinningError> {
        skinning::bind_world(skeleton)?;
        skinning::check_tree(skeleton)?;
        let tree = Tree {
            joints: &skeleton.joints,
            parents: &skeleton.parents,
            positions: skeleton.positions(),
            parts: skeleton.joints.iter().map(|j| names::part(j)).collect(),
        };
        let named = [Kind::Arm, Kind::Leg].map(|kind| limbs::by_name(&tree, kind));
        let frame = frame(&tree, &named);
        let [arms, legs] =
            [Kind::Arm, Kind::Leg].map(|kind| sides(&tree, &frame, &named[kind as usize], kind));
        let arms =
            arms.map(|l| l.map(|l| Arm { clavicle: l.clavicle, upper: l.upper, fore: l.lower, hand: l.end }));
        let legs = legs.map(|l| l.map(|l| Leg { thigh: l.upper, shin: l.lower, foot: l.end }));
        let spine = spine(&tree, &arms, &legs);
        let neck = spine.last().map_or_else(Vec::new, |&chest| neck(&tree, chest, &arms));
        Ok(Figure { frame, positions: tree.positions, arms, legs, spine, neck })
    }

    /// The part that a pose needs and the figure lacks.
    pub fn lacks(&self, stance: &Stance) -> Option<&'static str> {
        let needs = [
            (stance.arms.is_some(), self.arms.iter().all(Option::is_some), "arms"),
            (stance.legs.is_some(), self.legs.iter().all(Option::is_some), "legs"),
            (stance.trunk != [0.0; 3], !self.spine.is_empty(), "spine"),
            (stance.head != [0.0; 3], !self.neck.is_empty(), "neck"),
        ];
        needs.into_iter().find(|(needed, there, _)| *needed && !there).map(|n| n.2)
    }
}

/// Left from the names' sides; without them across the limbs, or along the widest spread of the
/// joints, with toes in front.
fn frame(tree: &Tree<'_>, named: &[Vec<Limb>; 2]) -> Frame {
    let up = Vec3::y();
    let flat = |v: Vec3| v - up * up.dot(&v);
    let mean = |sign: i32| {
        let own = named.iter().flatten().filter(|l| limbs::side(tree, l) == sign);
        let points: Vec<Vec3> = own.map(|l| tree.positions[l.upper]).collect();
        (!points.is_empty()).then(|| points.iter().sum::<Vec3>() / points.len() as f64)
    };
    let by_names = mean(1).zip(mean(-1)).and_then(|(l, r)| flat(l - r).try_normalize(1e-3));
    let left = by_names.unwrap_or_else(|| {
        let axis = widest(&tree.positions);
        let forward = limbs::toes(tree, &named[1], &up);
        let forward = if forward == Vec3::zeros() { lowest_spread(tree, &axis) } else { forward };
        let towards = up.cross(&forward).dot(&axis);
        let sign = if towards.abs() > 1e-6 { towards } else { axis.dot(&Vec3::x()) };
        if sign < 0.0 { -axis } else { axis }
    });
    let mut aside: Vec<f64> = tree.positions.iter().map(|p| p.dot(&left)).collect();
    aside.sort_by(f64::total_cmp);
    let half = aside.len() / 2;
    let middle = aside.get(half).map_or(0.0, |upper| (aside[(aside.len() - 1) / 2] + upper) / 2.0) * left;
    Frame { left, up, forward: left.cross(&up), middle }
}

/// The horizontal direction in which points spread most; +X if none stands out.
fn widest(points: &[Vec3]) -> Vec3 {
    let center = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
    let (mut xx, mut xz, mut zz) = (0.0, 0.0, 0.0);
    for d in points.iter().map(|p| p - center) {
        xx += d.x * d.x;
        xz += d.x * d.z;
        zz += d.z * d.z;
    }
    if xz == 0.0 && xx == zz {
        return Vec3::x();
    }
    let angle = 0.5 * (2.0 * xz).atan2(xx - zz);
    Vec3::new(angle.cos(), 0.0, angle.sin())
}

/// Where the lowest joints lie as seen from all, across `axis`: toes are in front of ankles.
fn lowest_spread(tree: &Tree<'_>, axis: &Vec3) -> Vec3 {
    let floor = tree.positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let low: Vec<&Vec3> = tree.positions.iter().filter(|p| p.y - floor < 0.1 * tree.height()).collect();
    let forward = axis.cross(&Vec3::y());
    let along: Vec<f64> = low.iter().map(|p| p.dot(&forward)).collect();
    let all =
        tree.positions.iter().map(|p| p.dot(&forward)).sum::<f64>() / tree.positions.len().max(1) as f64;
    forward * (along.iter().sum::<f64>() / along.len().max(1) as f64 - all)
}

/// The limb of each side: named ones by where they end, else by place.
fn sides(tree: &Tree<'_>, frame: &Frame, named: &[Limb], kind: Kind) -> [Option<Limb>; 2] {
    [1.0, -1.0].map(|sign| {
        let own = |l: &&Limb| sign * (tree.positions[l.end] - frame.middle).dot(&frame.left) > 0.0;
        let found = named.iter().find(own).copied();
        found.or_else(|| limbs::by_place(tree, frame, sign, kind))
    })
}

/// From the joint after the legs' fork to the arms' fork; from the joint below the arms' fork
/// where there are no legs.
fn spine(tree: &Tree<'_>, arms: &[Option<Arm>; 2], legs: &[Option<Leg>; 2]) -> Vec<usize> {
    let (Some(left), Some(right)) = (arms[0], arms[1]) else { return Vec::new() };
    let Some(chest) = tree.fork(left.upper, right.upper) else { return Vec::new() };
    let path = tree.path(chest);
    let hips = legs[0].zip(legs[1]).and_then(|(l, r)| tree.fork(l.thigh, r.thigh));
    let after = hips.and_then(|hips| path.iter().position(|&j| j == hips)).map_or(0, |i| i + 1);
    path[after.min(path.len())..].to_vec()
}

/// From the chest up to the joint named head; else to where the way up forks or ends.
fn neck(tree: &Tree<'_>, chest: usize, arms: &[Option<Arm>; 2]) -> Vec<usize> {
    let of_arm = |j: usize| arms.iter().flatten().any(|arm| tree.path(arm.upper).contains(&j));
    let below = (0..tree.joints.len()).filter(|&j| tree.path(j).contains(&chest));
    let free =
        below.filter(|&j| !tree.path(j).iter().skip_while(|&&p| p != chest).skip(1).any(|&p| of_arm(p)));
    let Some(top) = free.max_by(|&a, &b| tree.positions[a].y.total_cmp(&tree.positions[b].y)) else {
        return Vec::new();
    };
    let path = tree.path(top);
    let way = path.into_iter().skip_while(|&j| j != chest).skip(1);
    let mut neck = Vec::new();
    for j in way {
        neck.push(j);
        if tree.part(j) == Some(Part::Head) || tree.children(j) != 1 {
            break;
        }
    }
    neck
}
