//! What joint names say.
//!
//! Rigs call the same joint `upperarm01_L`, `LeftArm`, `mixamorig:LeftArm`, `lShldrBend`,
//! `Bip01 L UpperArm`, `left_shoulder` or `upper_arm.L`. Only the letters of the last path
//! component count, without a namespace; longer words are looked for first, since `forearm`
//! holds `arm` and `upleg` holds `leg`.

/// What a joint moves, as far as its name says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Clavicle,
    UpperArm,
    Forearm,
    Hand,
    Thigh,
    Shin,
    Foot,
    Head,
    /// A joint that names no segment: `LeftArm` or `LeftLeg` may be the upper or the whole limb.
    Arm,
    Leg,
    /// `shoulder`: the clavicle in some rigs, the upper arm in others.
    Shoulder,
    /// `hip`: the thigh where it has a side, else the pelvis.
    Hip,
}

/// Words that make a joint a helper of another and not a segment.
const HELPERS: &[&str] = &[
    "twist",
    "roll",
    "helper",
    "pole",
    "target",
    "ctrl",
    "control",
    "effector",
    "jiggle",
    "corrective",
    "share",
    "socket",
    "metacarp",
    "carpal",
    "finger",
    "thumb",
    "index",
    "pinky",
    "toe",
    "weapon",
    "prop",
    "nub",
];

/// Words and the parts that they name, the telling ones first.
const WORDS: &[(&str, Part)] = &[
    ("clavicle", Part::Clavicle),
    ("collar", Part::Clavicle),
    ("forearm", Part::Forearm),
    ("lowerarm", Part::Forearm),
    ("elbow", Part::Forearm),
    ("upperarm", Part::UpperArm),
    ("uparm", Part::UpperArm),
    ("shldr", Part::UpperArm),
    ("humerus", Part::UpperArm),
    ("hand", Part::Hand),
    ("wrist", Part::Hand),
    ("thigh", Part::Thigh),
    ("upperleg", Part::Thigh),
    ("upleg", Part::Thigh),
    ("femur", Part::Thigh),
    ("shin", Part::Shin),
    ("calf", Part::Shin),
    ("lowerleg", Part::Shin),
    ("loleg", Part::Shin),
    ("knee", Part::Shin),
    ("tibia", Part::Shin),
    ("foot", Part::Foot),
    ("ankle", Part::Foot),
    ("head", Part::Head),
    ("shoulder", Part::Shoulder),
    ("hip", Part::Hip),
    ("arm", Part::Arm),
    ("leg", Part::Leg),
];

/// The part that a joint's name names.
pub fn part(joint: &str) -> Option<Part> {
    let letters: String =
        last(joint).chars().filter(|c| c.is_alphabetic()).flat_map(char::to_lowercase).collect();
    if HELPERS.iter().any(|word| letters.contains(word)) || words(joint).iter().any(|w| w == "ik") {
        return None;
    }
    // "armature" is no arm.
    let letters = letters.replace("armature", "");
    WORDS.iter().find(|(word, _)| letters.contains(word)).map(|&(_, part)| part)
}

/// The side that a joint's name says: 1 left, -1 right, 0 none.
pub fn side(joint: &str) -> i32 {
    for word in words(joint) {
        match word.as_str() {
            "l" | "left" | "lft" => return 1,
            "r" | "right" | "rgt" => return -1,
            _ => {}
        }
    }
    0
}

/// The last component of a joint's path, without namespaces.
fn last(joint: &str) -> &str {
    joint.rsplit(['/', ':', '|']).next().unwrap_or(joint)
}

/// The lower-case words of a name: cut at what is no letter, and before a capital after a small one.
fn words(joint: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    for c in last(joint).chars() {
        if !c.is_alphabetic() || (before.is_lowercase() && c.is_uppercase()) {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().expect("there is always one").extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|w| !w.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_rigs() {
        for (joint, expected) in [
            ("root/spine/upperarm01_L", Part::UpperArm),
            ("a/mixamorig:LeftForeArm", Part::Forearm),
            ("mixamorig:LeftArm", Part::Arm),
            ("lShldrBend", Part::UpperArm),
            ("Bip01 L UpperArm", Part::UpperArm),
            ("upper_arm.L", Part::UpperArm),
            ("CC_Base_L_Clavicle", Part::Clavicle),
            ("left_shoulder", Part::Shoulder),
            ("LeftUpLeg", Part::Thigh),
            ("LeftLeg", Part::Leg),
            ("thigh_l", Part::Thigh),
            ("J_Bip_R_LowerLeg", Part::Shin),
            ("r_wrist", Part::Hand),
        ] {
            assert_eq!(part(joint), Some(expected), "{joint}");
        }
        for joint in
            ["upperarm_twist_01_l", "finger1_1_L", "ik_hand_l", "LeftHandThumb1", "Armature", "joint12"]
        {
            assert_eq!(part(joint), None, "{joint}");
        }
    }

    #[test]
    fn sides() {
        for joint in ["upperarm01_L", "LeftArm", "mixamorig:LeftArm", "lShldrBend", "Bip01 L Thigh", "hand.l"]
        {
            assert_eq!(side(joint), 1, "{joint}");
        }
        assert_eq!(side("thigh_r"), -1);
        assert_eq!(side("spine/root"), 0);
    }
}
