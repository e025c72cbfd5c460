//! Joints that a garment ignores: fingers, toes, the face.
//!
//! A cuff beside the hand must not move with a finger. A joint that a pattern names gives its
//! weight to the nearest ancestor that none names. Everything else is kept, helper and twist
//! joints too: the body's own weights say where they count.
//!
//! A garment may say itself which joints move it, in any order ([`own`]); then no pattern counts.

use super::table::Sparse;
use crate::model::Skeleton;
use crate::proxy::names_part;

/// A garment of which ignored joints hold more than this share is made for them (gloves, socks,
/// masks): then none is ignored.
const MADE_FOR_THEM: f64 = 0.25;

/// For each joint the one that takes its weight: itself, or its nearest kept ancestor.
///
/// A pattern is matched against whole words of a joint's own name, `NAME/*` is every joint below
/// one that `NAME` matches. A joint without a kept ancestor is kept.
pub(super) fn targets(skeleton: &Skeleton, patterns: &[String]) -> Vec<u32> {
    let count = skeleton.joints.len();
    let own_name = |j: usize| last(&skeleton.joints[j]);
    let (below, own): (Vec<&str>, Vec<&str>) = patterns
        .iter()
        .map(|p| p.strip_suffix("/*").map_or((None, Some(p.as_str())), |p| (Some(p), None)))
        .fold((Vec::new(), Vec::new()), |(mut below, mut own), (b, o)| {
            below.extend(b);
            own.extend(o);
            (below, own)
        });
    let named = |patterns: &[&str]| -> Vec<bool> {
        (0..count).map(|j| patterns.iter().any(|p| names_part(p, own_name(j)))).collect()
    };
    let (tops, named) = (named(&below), named(&own));
    let kept: Vec<bool> = (0..count).map(|j| !named[j] && !above(skeleton, j).any(|a| tops[a])).collect();
    to_kept(skeleton, &kept)
}

/// For each joint the one of a garment's own joints that takes its weight, and how many of these the
/// skeleton has. They are found by path or, where paths differ, by a name that only one joint has. With
/// none found all joints keep their weight; so does a joint that has none of them above it.
pub(super) fn own(skeleton: &Skeleton, names: &[String]) -> (Vec<u32>, usize) {
    let mut kept = vec![false; skeleton.joints.len()];
    let mut found = 0;
    for name in names {
        let by_path = skeleton.joints.iter().position(|joint| joint == name);
        let mut same = (0..kept.len()).filter(|&j| last(&skeleton.joints[j]) == last(name));
        let by_name = same.next().filter(|_| same.next().is_none());
        if let Some(j) = by_path.or(by_name) {
            kept[j] = true;
            found += 1;
        }
    }
    if found == 0 {
        kept.fill(true);
    }
    (to_kept(skeleton, &kept), found)
}

/// Each joint itself, or its nearest kept ancestor; itself too where it has none.
fn to_kept(skeleton: &Skeleton, kept: &[bool]) -> Vec<u32> {
    let target = |j: usize| if kept[j] { j } else { above(skeleton, j).find(|&a| kept[a]).unwrap_or(j) };
    (0..kept.len()).map(|j| target(j) as u32).collect()
}

/// The joints above one, the nearest first. Parents that go in circles are someone else's error.
fn above(skeleton: &Skeleton, joint: usize) -> impl Iterator<Item = usize> {
    let count = skeleton.joints.len();
    std::iter::successors(skeleton.parent(joint), |&p| skeleton.parent(p)).take(count)
}

/// A joint's name without its path.
fn last(joint: &str) -> &str {
    joint.rsplit('/').next().unwrap_or_default()
}

/// Gives all weight to the targets.
pub(super) fn hand_on(targets: &[u32], rows: &mut [Option<Sparse>]) {
    rows.iter_mut().flatten().flatten().for_each(|w| w.0 = targets[w.0 as usize]);
}

/// Share of all weight that is on ignored joints, if the garment is not made for them; gives
/// that weight to their targets.
pub(super) fn apply(targets: &[u32], rows: &mut [Option<Sparse>]) -> f64 {
    let (mut moved, mut all) = (0.0, 0.0);
    for &(joint, weight) in rows.iter().flatten().flatten() {
        all += weight;
        moved += if targets[joint as usize] == joint { 0.0 } else { weight };
    }
    if moved > MADE_FOR_THEM * all || moved == 0.0 {
        return 0.0;
    }
    hand_on(targets, rows);
    moved / all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skeleton(joints: &[&str]) -> Skeleton {
        let parent = |j: &&str| {
            let above = j.rsplit_once('/').map(|cut| cut.0);
            above.and_then(|above| joints.iter().position(|other| *other == above)).map_or(-1, |p| p as i32)
        };
        Skeleton {
            joints: joints.iter().map(|j| (*j).to_owned()).collect(),
            parents: joints.iter().map(parent).collect(),
            ..Skeleton::default()
        }
    }

    const ARM: [&str; 8] = [
        "Hips",
        "Hips/LeftForeArm",
        "Hips/LeftForeArm/LeftForeArmTwist",
        "Hips/LeftForeArm/LeftHand",
        "Hips/LeftForeArm/LeftHand/LeftHandIndex1",
        "Hips/LeftForeArm/LeftHand/LeftHandIndex1/LeftHandIndex2",
        "Hips/Head",
        "Hips/Head/Jaw",
    ];

    #[test]
    fn fingers_and_face_hand_their_weight_up_and_helpers_keep_theirs() {
        let patterns = crate::rig::Params::default().ignore;
        assert_eq!(targets(&skeleton(&ARM), &patterns), [0, 1, 2, 3, 3, 3, 6, 6]);
        assert_eq!(targets(&skeleton(&ARM), &["*twist".to_owned()]), [0, 1, 1, 3, 4, 5, 6, 7]);
        assert_eq!(targets(&skeleton(&ARM), &[]), [0, 1, 2, 3, 4, 5, 6, 7]);
        // Without an ancestor to take its weight a joint keeps it.
        assert_eq!(targets(&skeleton(&["finger1", "arm"]), &patterns), [0, 1]);
    }

    #[test]
    fn a_garment_may_say_which_joints_move_it() {
        let names = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        let arm = skeleton(&ARM);
        // In any order, by path or by name.
        let subset = names(&["Body/LeftHand", "Hips/LeftForeArm", "Hips", "Tail"]);
        assert_eq!(own(&arm, &subset), (vec![0, 1, 1, 3, 3, 3, 0, 0], 3));
        // A name that two joints have names none of them; what is above all of them keeps its weight.
        let twins = skeleton(&["A", "A/Twin", "B", "B/Twin", "B/C"]);
        assert_eq!(own(&twins, &names(&["Twin", "C"])), (vec![0, 1, 2, 3, 4], 1));
        assert_eq!(own(&twins, &names(&["B/Twin", "A"])), (vec![0, 0, 2, 3, 4], 2));
        assert_eq!(own(&twins, &names(&["X"])), (vec![0, 1, 2, 3, 4], 0));
    }

    #[test]
    fn a_glove_keeps_its_fingers() {
        let targets = targets(&skeleton(&ARM), &crate::rig::Params::default().ignore);
        let mut cuff = vec![Some(vec![(1, 1.0)]), Some(vec![(3, 0.8), (4, 0.2)]), None];
        assert!((apply(&targets, &mut cuff) - 0.1).abs() < 1e-12);
        assert_eq!(cuff[1], Some(vec![(3, 0.8), (3, 0.2)]));
        let mut glove = vec![Some(vec![(4, 1.0)]), Some(vec![(3, 1.0)])];
        assert_eq!(apply(&targets, &mut glove), 0.0);
        assert_eq!(glove[0], Some(vec![(4, 1.0)]));
    }
}
