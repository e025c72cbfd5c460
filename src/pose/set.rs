//! The poses: which way the parts of a figure point.

/// Which way limbs point and how far the trunk bends; what is `None` or zero stays as it is in the
/// bind pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stance {
    /// Name in the report.
    pub name: &'static str,
    /// Upper arm and forearm, left and right: [outward, up, forward] as seen from the chest.
    pub arms: Option<[[[f64; 3]; 2]; 2]>,
    /// How far the clavicles are raised [degrees].
    pub raise: f64,
    /// Thigh and shin, left and right: [outward, up, forward] as seen from the hips.
    pub legs: Option<[[[f64; 3]; 2]; 2]>,
    /// Bend forward, lean to the left, turn to the left, over the spine [degrees].
    pub trunk: [f64; 3],
    /// The same over the neck and head [degrees].
    pub head: [f64; 3],
}

/// As the bind pose.
const STILL: Stance =
    Stance { name: "", arms: None, raise: 0.0, legs: None, trunk: [0.0; 3], head: [0.0; 3] };

/// The same on both sides.
const fn both(segments: [[f64; 3]; 2]) -> Option<[[[f64; 3]; 2]; 2]> {
    Some([segments, segments])
}

const UP: [[f64; 3]; 2] = [[0.3, 1.0, 0.0], [0.1, 1.0, 0.1]];
const DOWN: [[f64; 3]; 2] = [[0.4, -1.0, 0.0], [0.25, -1.0, 0.15]];
const FORWARD: [[f64; 3]; 2] = [[0.1, 0.0, 1.0], [0.0, 0.0, 1.0]];
const BACKWARD: [[f64; 3]; 2] = [[0.25, -1.0, -0.5], [0.15, -1.0, -0.1]];

/// All poses: what a body does in ordinary scenes, each part at a wide angle at least once.
pub fn stances() -> &'static [Stance] {
    const SET: &[Stance] = &[
        Stance { name: "t", arms: both([[1.0, 0.0, 0.0]; 2]), ..STILL },
        Stance { name: "a", arms: both([[0.7, -0.7, 0.0]; 2]), ..STILL },
        Stance { name: "arms_down", arms: both(DOWN), ..STILL },
        Stance { name: "arms_up", arms: both(UP), raise: 25.0, ..STILL },
        Stance { name: "arms_forward", arms: both(FORWARD), ..STILL },
        Stance { name: "arms_crossed", arms: both([[0.35, -0.85, 0.5], [-0.85, 0.15, 0.5]]), ..STILL },
        Stance { name: "hands_on_hips", arms: both([[0.75, -0.65, -0.15], [-0.7, -0.6, 0.35]]), ..STILL },
        Stance { name: "reach", arms: Some([UP, DOWN]), raise: 12.0, trunk: [0.0, -12.0, 0.0], ..STILL },
        Stance {
            name: "step",
            arms: Some([BACKWARD, [[0.25, -1.0, 0.5], [0.1, -0.7, 0.7]]]),
            legs: Some([
                [[0.05, -1.0, 0.55], [0.05, -1.0, -0.05]],
                [[0.05, -1.0, -0.35], [0.05, -1.0, -0.7]],
            ]),
            ..STILL
        },
        Stance {
            name: "sit",
            arms: both([[0.25, -1.0, 0.3], [-0.05, -0.3, 1.0]]),
            legs: both([[0.2, -0.1, 1.0], [0.05, -1.0, 0.0]]),
            ..STILL
        },
        Stance {
            name: "squat",
            arms: both(FORWARD),
            legs: both([[0.4, 0.1, 1.0], [0.1, -1.0, -0.4]]),
            trunk: [25.0, 0.0, 0.0],
            ..STILL
        },
        Stance {
            name: "legs_apart",
            arms: both([[0.7, -0.7, 0.0]; 2]),
            legs: both([[0.6, -1.0, 0.0]; 2]),
            ..STILL
        },
        Stance { name: "bend", arms: both(DOWN), trunk: [70.0, 0.0, 0.0], head: [10.0, 0.0, 0.0], ..STILL },
        Stance { name: "lean", arms: both(DOWN), trunk: [0.0, 30.0, 0.0], ..STILL },
        Stance { name: "twist", arms: both([[0.7, -0.7, 0.0]; 2]), trunk: [0.0, 0.0, 45.0], ..STILL },
        Stance { name: "look", arms: both(DOWN), head: [-15.0, 0.0, 60.0], ..STILL },
    ];
    SET
}
