//! The joints that landmarks need, in any skeleton.
//!
//! First by name: the last part of a joint's path, without namespace, split into words at
//! digits, separators and capitals (`mixamorig:LeftUpLeg`, `upperleg01_L`, `L_Hip`,
//! `lThighBend`). What names do not tell comes from hierarchy and position: the two lowest ends
//! that meet high up are the feet and meet in the pelvis, the two ends farthest apart sideways
//! are the hands and meet in the chest, the highest other end is the head.

use crate::model::{Skeleton, Vec3};

/// From a hip or shoulder joint this far aside of the middle, over the skeleton's height.
const ASIDE: f64 = 0.02;
/// Shoulder to wrist over the skeleton's height [Drillis, Contini 1966].
const ARM: f64 = 0.33;

/// Positions of a limb's joints from its root to its end [m].
#[derive(Clone, Debug, PartialEq)]
pub struct Limb {
    /// Hip or shoulder first, ankle or wrist last.
    pub points: Vec<Vec3>,
    /// The joint at its root.
    pub root: usize,
}

/// What was found; limbs are left and right.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Joints {
    /// Hip to ankle.
    pub legs: Option<[Limb; 2]>,
    /// Shoulder to wrist.
    pub arms: Option<[Limb; 2]>,
    /// Base of the neck and of the head [m].
    pub neck: Option<[Vec3; 2]>,
}

/// A skeleton with what is asked of it again and again.
struct Tree<'a> {
    skeleton: &'a Skeleton,
    position: Vec<Vec3>,
    children: Vec<Vec<usize>>,
    words: Vec<(Option<usize>, String)>,
    height: f64,
}

impl Joints {
    /// Finds the joints of `skeleton`.
    pub fn find(skeleton: &Skeleton) -> Joints {
        let Some(tree) = Tree::new(skeleton) else { return Joints::default() };
        let named = |roots: &[&str], ends: &[&str]| tree.limbs_by_name(roots, ends);
        const LEGS: [&str; 6] = ["thigh", "upperleg", "upleg", "thighbend", "femur", "hip"];
        const ARMS: [&str; 7] = ["upperarm", "uparm", "arm", "shldrbend", "shldr", "humerus", "shoulder"];
        let below = |legs: &[Limb; 2]| legs.iter().all(|l| l.points[0].y > l.points[l.points.len() - 1].y);
        let legs = named(&LEGS, &["foot", "ankle"]).filter(below).or_else(|| tree.legs_by_shape());
        let arms = named(&ARMS, &["hand", "wrist"]).or_else(|| tree.arms_by_shape());
        let neck = tree.neck_by_name().or_else(|| tree.neck_by_shape());
        Joints { legs, arms, neck }
    }
}

/// Side (0 left, 1 right) and the other words of a joint's name, run together.
fn words(path: &str) -> (Option<usize>, String) {
    let name = path.rsplit('/').next().unwrap_or(path);
    let name = name.rsplit(':').next().unwrap_or(name);
    let mut parts: Vec<String> = Vec::new();
    let mut last = ' ';
    for c in name.chars() {
        let capital = c.is_uppercase() && last.is_lowercase();
        if c.is_alphabetic() {
            if capital || !last.is_alphabetic() {
                parts.push(String::new());
            }
            if let Some(part) = parts.last_mut() {
                part.extend(c.to_lowercase());
            }
        }
        last = c;
    }
    let side = |part: &str| match part {
        "l" | "left" => Some(0),
        "r" | "right" => Some(1),
        _ => None,
    };
    let found = parts.iter().find_map(|part| side(part));
    let skip = ["j", "bip", "b", "bone", "def", "jnt", "joint", "sk"];
    let rest = parts.iter().filter(|p| side(p).is_none() && !skip.contains(&p.as_str()));
    (found, rest.map(String::as_str).collect())
}

impl<'a> Tree<'a> {
    fn new(skeleton: &'a Skeleton) -> Option<Self> {
        let count = skeleton.joints.len();
        let tree = skeleton.parents.iter().enumerate().all(|(j, &p)| p < j as i32);
        if count < 2 || !tree || skeleton.world_from_joint.len() != count || skeleton.parents.len() != count {
            return None;
        }
        let at = |m: &[[f64; 4]; 4]| Vec3::new(m[0][3], m[1][3], m[2][3]);
        let position: Vec<Vec3> = skeleton.world_from_joint.iter().map(at).collect();
        let mut children = vec![Vec::new(); count];
        for (j, &p) in skeleton.parents.iter().enumerate().filter(|(_, p)| **p >= 0) {
            children[p as usize].push(j);
        }
        let heights = position.iter().map(|p| p.y);
        let height = heights.clone().fold(f64::MIN, f64::max) - heights.fold(f64::MAX, f64::min);
        let words = skeleton.joints.iter().map(|path| words(path)).collect();
        Some(Tree { skeleton, position, children, words, height })
    }

    /// From a joint up to its root.
    fn ancestry(&self, joint: usize) -> Vec<usize> {
        let mut chain = vec![joint];
        while let Ok(up) = usize::try_from(self.skeleton.parents[chain[chain.len() - 1]]) {
            chain.push(up);
        }
        chain
    }

    /// Joints from `top` down to `end`, both included; `None` if `end` is not below `top`.
    fn path(&self, top: usize, end: usize) -> Option<Vec<usize>> {
        let mut chain = self.ancestry(end);
        let at = chain.iter().position(|&j| j == top)?;
        chain.truncate(at + 1);
        chain.reverse();
        Some(chain)
    }

    fn meet(&self, a: usize, b: usize) -> Option<usize> {
        let of_a = self.ancestry(a);
        self.ancestry(b).into_iter().find(|j| of_a.contains(j))
    }

    fn limb(&self, path: &[usize]) -> Limb {
        Limb { points: path.iter().map(|&j| self.position[j]).collect(), root: path[0] }
    }

    fn limbs_by_name(&self, roots: &[&str], ends: &[&str]) -> Option<[Limb; 2]> {
        let joints = || 0..self.words.len();
        let find = |side: usize| {
            let named = |j: usize, name: &str| self.words[j].0 == Some(side) && self.words[j].1 == name;
            let candidates = roots.iter().flat_map(|name| joints().filter(move |&j| named(j, name)));
            candidates.into_iter().find_map(|root| {
                let mut below = joints().filter(|&j| ends.iter().any(|name| named(j, name)));
                below.find_map(|end| self.path(root, end).filter(|path| path.len() > 1))
            })
        };
        Some([self.limb(&find(0)?), self.limb(&find(1)?)])
    }

    fn leaves(&self) -> Vec<usize> {
        (0..self.children.len()).filter(|&j| self.children[j].is_empty()).collect()
    }

    fn floor(&self) -> f64 {
        self.position.iter().map(|p| p.y).fold(f64::MAX, f64::min)
    }

    /// Whether two ends meet in the upper half of the skeleton.
    fn meet_high(&self, a: usize, b: usize) -> Option<usize> {
        self.meet(a, b).filter(|&j| self.position[j].y - self.floor() > 0.4 * self.height)
    }

    fn feet(&self) -> Option<[usize; 2]> {
        let mut leaves = self.leaves();
        leaves.sort_by(|&a, &b| self.position[a].y.total_cmp(&self.position[b].y));
        let first = *leaves.first()?;
        let low = |j: usize| self.position[j].y - self.floor() < 0.2 * self.height;
        let second = leaves.iter().copied().find(|&j| low(j) && self.meet_high(first, j).is_some())?;
        Some([first, second])
    }

    fn hands(&self) -> Option<[usize; 2]> {
        let leaves = self.leaves();
        let flat = |a: usize, b: usize| (self.position[a] - self.position[b]).xz().norm();
        let pairs = leaves.iter().flat_map(|&a| leaves.iter().map(move |&b| [a, b]));
        pairs
            .filter(|&[a, b]| a < b && self.meet_high(a, b).is_some())
            .max_by(|p, q| flat(p[0], p[1]).total_cmp(&flat(q[0], q[1])))
    }

    /// Left first: toes point forwards, and left is up cross forward.
    fn sorted(&self, limbs: [Limb; 2]) -> [Limb; 2] {
        let forward = self.feet().map_or(Vec3::z(), |feet| {
            feet.iter()
                .map(|&toe| self.position[toe] - self.position[self.skeleton.parents[toe].max(0) as usize])
                .sum()
        });
        let left = Vec3::y().cross(&forward);
        let [a, b] = limbs;
        if a.points[0].dot(&left) >= b.points[0].dot(&left) { [a, b] } else { [b, a] }
    }

    fn legs_by_shape(&self) -> Option<[Limb; 2]> {
        let feet = self.feet()?;
        let pelvis = self.meet_high(feet[0], feet[1])?;
        let leg = |foot: usize| {
            let path = self.path(pelvis, foot)?;
            let aside =
                |j: usize| (self.position[j] - self.position[pelvis]).xz().norm() > ASIDE * self.height;
            let hip = path.iter().position(|&j| aside(j))?;
            let low = |j: usize| self.position[j].y - self.floor() < 0.1 * self.height;
            let ankle = path.iter().position(|&j| low(j)).unwrap_or(path.len() - 1);
            (ankle > hip).then(|| self.limb(&path[hip..=ankle]))
        };
        Some(self.sorted([leg(feet[0])?, leg(feet[1])?]))
    }

    fn arms_by_shape(&self) -> Option<[Limb; 2]> {
        let hands = self.hands()?;
        let chest = self.meet_high(hands[0], hands[1])?;
        let arm = |hand: usize| {
            let path = self.path(chest, hand)?;
            // Fingers branch at the wrist; without fingers the chain's end is it.
            let branch = (1..path.len()).rev().find(|&k| self.children[path[k]].len() > 1);
            let wrist = branch.unwrap_or(path.len() - 1);
            let reach = |k: usize| -> f64 {
                (k..wrist).map(|i| (self.position[path[i + 1]] - self.position[path[i]]).norm()).sum()
            };
            let miss = |k: usize| (reach(k) - ARM * self.height).abs();
            let shoulder = (1..wrist).min_by(|&a, &b| miss(a).total_cmp(&miss(b)))?;
            Some(self.limb(&path[shoulder..=wrist]))
        };
        Some(self.sorted([arm(hands[0])?, arm(hands[1])?]))
    }

    fn neck_by_name(&self) -> Option<[Vec3; 2]> {
        let first = |name: &str| (0..self.words.len()).find(|&j| self.words[j].1 == name);
        let (neck, head) = (self.position[first("neck")?], self.position[first("head")?]);
        (head.y > neck.y).then_some([neck, head])
    }

    fn neck_by_shape(&self) -> Option<[Vec3; 2]> {
        let hands = self.hands()?;
        let chest = self.meet_high(hands[0], hands[1])?;
        let highest = |&a: &usize, &b: &usize| self.position[a].y.total_cmp(&self.position[b].y);
        let crown = self.leaves().into_iter().filter(|l| !hands.contains(l)).max_by(highest)?;
        let path = self.path(chest, crown)?;
        let neck = *path.get(1)?;
        let branch = path[2..].iter().copied().find(|&j| self.children[j].len() > 1);
        let head = branch.or(path.last().copied()).filter(|&j| j != neck)?;
        (self.position[head].y > self.position[neck].y).then(|| [self.position[neck], self.position[head]])
    }
}
