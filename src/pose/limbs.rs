//! Arms and legs: three joints that end two segments, found by name or by place.

use super::figure::{Frame, Tree};
use super::names::{self, Part};
use crate::model::Vec3;

/// Lengths as shares of the height between the lowest and the highest joint: how far aside a
/// shoulder and a hip joint are at least, how long a hand is, how high an ankle is.
const SHOULDER: f64 = 0.07;
const HIP: f64 = 0.03;
const HAND: f64 = 0.13;
const ANKLE: f64 = 0.08;

/// Which limb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Arm,
    Leg,
}

/// The joints that a limb's two segments start at, the one that ends them, and what lies above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limb {
    pub upper: usize,
    pub lower: usize,
    pub end: usize,
    /// A joint between the trunk and the limb that raises it.
    pub clavicle: Option<usize>,
}

/// Limbs that names tell, in the order of their ends.
pub fn by_name(tree: &Tree<'_>, kind: Kind) -> Vec<Limb> {
    let end = if kind == Kind::Arm { Part::Hand } else { Part::Foot };
    let is_end = |j: usize| tree.part(j) == Some(end);
    (0..tree.joints.len())
        .filter(|&j| is_end(j))
        .map(|j| tree.path(j))
        .filter(|path| !path[..path.len() - 1].iter().any(|&j| is_end(j)))
        .filter_map(|path| resolve(tree, &path, kind))
        .collect()
}

/// The limb along a path from a root down to its end.
fn resolve(tree: &Tree<'_>, path: &[usize], kind: Kind) -> Option<Limb> {
    let end = *path.last()?;
    let above = &path[..path.len() - 1];
    let first = |wanted: &[Part], from: usize| {
        (from..above.len()).find(|&i| tree.part(above[i]).is_some_and(|p| wanted.contains(&p)))
    };
    let (upper, lower, vague) = match kind {
        Kind::Arm => (Part::UpperArm, Part::Forearm, Part::Arm),
        Kind::Leg => (Part::Thigh, Part::Shin, Part::Leg),
    };
    let sided_hip = || above.iter().position(|&j| tree.part(j) == Some(Part::Hip) && tree.side(j) != 0);
    let last_shoulder = || above.iter().rposition(|&j| tree.part(j) == Some(Part::Shoulder));
    let start = first(&[upper], 0)
        .or_else(|| if kind == Kind::Leg { sided_hip() } else { None })
        .or_else(|| first(&[vague], 0))
        .or_else(|| if kind == Kind::Arm { last_shoulder() } else { None })?;
    let middle = first(&[lower], start + 1).or_else(|| first(&[vague], start + 1))?;
    let clavicle = (0..start)
        .rev()
        .find(|&i| tree.part(above[i]) == Some(Part::Clavicle))
        .or_else(|| (0..start).find(|&i| tree.part(above[i]) == Some(Part::Shoulder)));
    Some(Limb { upper: above[start], lower: above[middle], end, clavicle: clavicle.map(|i| above[i]) })
}

/// The limb of one side (`sign` 1 left, -1 right) by where joints are, for rigs without telling
/// names: out to the joint farthest aside (arm) or lowest (leg), with segments of like length.
pub fn by_place(tree: &Tree<'_>, frame: &Frame, sign: f64, kind: Kind) -> Option<Limb> {
    let height = tree.height();
    let aside = |j: usize| sign * (tree.positions[j] - frame.middle).dot(&frame.left);
    let level = |j: usize| tree.positions[j].dot(&frame.up);
    let floor = (0..tree.joints.len()).map(level).fold(f64::INFINITY, f64::min);
    let rank = |j: usize| if kind == Kind::Arm { aside(j) } else { -level(j) };
    let tip = (0..tree.joints.len())
        .filter(|&j| aside(j) > HIP * height && (kind == Kind::Leg || level(j) > floor + 0.3 * height))
        .max_by(|&a, &b| rank(a).total_cmp(&rank(b)))?;
    let path = tree.path(tip);
    let (start, end) = match kind {
        Kind::Arm => {
            let left = |i: usize| length(tree, &path[i..]);
            let start = path.iter().position(|&j| aside(j) > SHOULDER * height)?;
            (start, (start..path.len()).find(|&i| left(i) <= HAND * height)?)
        }
        Kind::Leg => {
            let start = path.iter().position(|&j| aside(j) > HIP * height)?;
            (start, (start..path.len()).find(|&i| level(path[i]) - floor <= ANKLE * height)?)
        }
    };
    let apart = |i: usize, k: usize| (tree.positions[path[i]] - tree.positions[path[k]]).norm();
    let uneven = |i: &usize| (apart(start, *i) - apart(*i, end)).abs();
    let middle = (start + 1..end).min_by(|a, b| uneven(a).total_cmp(&uneven(b)))?;
    let balanced = uneven(&middle) < 0.3 * apart(start, end);
    let clavicle = (kind == Kind::Arm && start > 0).then(|| path[start - 1]);
    let clavicle = clavicle.filter(|&j| tree.children(j) == 1);
    balanced.then_some(Limb { upper: path[start], lower: path[middle], end: path[end], clavicle })
}

/// Length of the way along joints.
fn length(tree: &Tree<'_>, path: &[usize]) -> f64 {
    path.windows(2).map(|w| (tree.positions[w[1]] - tree.positions[w[0]]).norm()).sum()
}

/// Where the feet of some legs point, horizontally; zero if they have no toes.
pub fn toes(tree: &Tree<'_>, legs: &[Limb], up: &Vec3) -> Vec3 {
    let mut sum = Vec3::zeros();
    for leg in legs {
        let below = (0..tree.joints.len()).filter(|&j| tree.path(j).contains(&leg.end));
        let offsets = below.map(|j| tree.positions[j] - tree.positions[leg.end]).map(|d| d - up * up.dot(&d));
        sum += offsets.max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_else(Vec3::zeros);
    }
    sum
}

/// The side that the names of a limb's joints say: 1 left, -1 right, 0 none.
pub fn side(tree: &Tree<'_>, limb: &Limb) -> i32 {
    [limb.upper, limb.lower, limb.end]
        .into_iter()
        .map(|j| names::side(&tree.joints[j]))
        .find(|&s| s != 0)
        .unwrap_or(0)
}
