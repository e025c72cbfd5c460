//! Where the tape lies on a body, and what it reads.
//!
//! With the hips' height `h`, the shoulders' `s` and the floor's `f`, levels are searched
//! between fractions of `s - h` (bust, waist, hip) and below the crotch (thigh). The crotch is the highest level at which a contour goes round one leg alone.

use super::joints::{Joints, Limb};
use super::section::{Piece, Plane, cut, hull_length};
use super::{Girth, Side};
use crate::model::{Character, TriMesh, Vec3};

/// Levels of the bust between hips (0) and shoulders (1). The lower end keeps a belly out.
const BUST: [f64; 2] = [0.66, 0.74];
/// Levels of the waist: between the iliac crest and the lowest ribs.
const WAIST: [f64; 2] = [0.28, 0.52];
/// Levels of the hip girth: about the seat, below a belly and above the fullest of the thighs.
const HIP: [f64; 2] = [-0.15, -0.05];
/// The thigh's level: this part of the crotch's height below it.
const THIGH: f64 = 0.25;
/// The upper arm's place from shoulder (0) to wrist (1).
const UPPER_ARM: f64 = 0.25;
/// Levels tried in a search.
const STEPS: usize = 25;
/// A contour that turns more often than this about a point goes round it.
pub const ROUND: f64 = 0.9;

/// A girth of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Which.
    pub girth: Girth,
    /// Of which limb; `None` for the trunk.
    pub side: Option<Side>,
    /// Where the tape lies.
    pub plane: Plane,
    /// What it goes round [m].
    pub centre: Vec3,
    /// What it does not go round: arms, the other leg, the trunk [m].
    pub beside: Vec<Vec3>,
    /// The body's girth: the convex hull of its section [m].
    pub body_m: f64,
}

/// The girths of a body that could be found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Landmarks {
    /// In the order of [`Girth::ALL`], left before right.
    pub found: Vec<Landmark>,
    /// Girths that could not be found, and why.
    pub missing: Vec<(Girth, &'static str)>,
}

/// A body with its limbs.
struct Body<'a> {
    mesh: &'a TriMesh,
    arms: Option<[Limb; 2]>,
    legs: Option<[Limb; 2]>,
    neck: Option<[Vec3; 2]>,
    /// Whether a triangle belongs to an arm.
    of_arm: Vec<bool>,
}

impl Landmarks {
    /// Finds and measures the girths of a character in its bind pose.
    pub fn find(character: &Character) -> Landmarks {
        let Joints { legs, arms, neck } = Joints::find(&character.skeleton);
        let of_arm = arm_triangles(character, arms.as_ref());
        let body = Body { mesh: &character.body, arms, legs, neck, of_arm };
        let mut landmarks = Landmarks::default();
        for girth in Girth::ALL {
            match body.landmarks(girth) {
                Ok(found) => landmarks.found.extend(found),
                Err(why) => landmarks.missing.push((girth, why)),
            }
        }
        landmarks
    }

    /// The landmark of a girth.
    pub fn get(&self, girth: Girth, side: Option<Side>) -> Option<&Landmark> {
        self.found.iter().find(|l| l.girth == girth && l.side == side)
    }
}

/// Triangles most of whose corners hang mostly on an arm.
fn arm_triangles(character: &Character, arms: Option<&[Limb; 2]>) -> Vec<bool> {
    if arms.is_none() {
        return vec![false; character.body.triangles.len()];
    }
    let parents = &character.skeleton.parents;
    let mut of_arm = vec![false; parents.len()];
    for j in 0..parents.len() {
        let below = usize::try_from(parents[j]).is_ok_and(|p| of_arm[p]);
        of_arm[j] = below || arms.is_some_and(|arms| arms.iter().any(|arm| arm.root == j));
    }
    let skin = &character.skin;
    let point = |v: u32| {
        let influences = v as usize * skin.influences..(v as usize + 1) * skin.influences;
        let on_arm = influences.filter(|&i| of_arm[skin.joint_indices[i] as usize]);
        on_arm.map(|i| skin.joint_weights[i]).sum::<f64>() > 0.5
    };
    let triangle = |tri: &[u32; 3]| tri.iter().filter(|&&v| point(v)).count() > 1;
    character.body.triangles.iter().map(triangle).collect()
}

impl Body<'_> {
    fn landmarks(&self, girth: Girth) -> Result<Vec<Landmark>, &'static str> {
        match girth {
            Girth::Bust => self.trunk(girth, BUST, f64::max),
            Girth::Waist => self.trunk(girth, WAIST, f64::min),
            Girth::Hip => self.trunk(girth, HIP, f64::max),
            Girth::Thigh => self.thighs(),
            Girth::UpperArm => self.upper_arms(),
            Girth::Neck => self.neck(),
        }
    }

    fn section(&self, plane: &Plane, skip: &dyn Fn(usize) -> bool) -> Vec<Piece> {
        cut(&self.mesh.points, &self.mesh.triangles, &|v| v, skip, plane)
    }

    /// Heights of hips and shoulders [m].
    fn trunk_heights(&self) -> Result<[f64; 2], &'static str> {
        let mean = |limbs: &[Limb; 2]| 0.5 * (limbs[0].points[0].y + limbs[1].points[0].y);
        let hips = mean(self.legs.as_ref().ok_or("no hip joints were found")?);
        let shoulders = mean(self.arms.as_ref().ok_or("no shoulder joints were found")?);
        if shoulders > hips { Ok([hips, shoulders]) } else { Err("the shoulders are not above the hips") }
    }

    /// The tape about the trunk at a level; arms are left out, legs are within.
    fn trunk_girth(&self, plane: &Plane) -> f64 {
        let pieces = self.section(plane, &|t| self.of_arm[t]);
        hull_length(pieces.iter().flat_map(|piece| piece.lines.iter().flatten().copied()).collect())
    }

    fn trunk(
        &self,
        girth: Girth,
        [low, high]: [f64; 2],
        better: fn(f64, f64) -> f64,
    ) -> Result<Vec<Landmark>, &'static str> {
        let [h, s] = self.trunk_heights()?;
        let level = |k: usize| h + (s - h) * (low + (high - low) * k as f64 / (STEPS - 1) as f64);
        let read = |k: usize| (level(k), self.trunk_girth(&Plane::level(level(k))));
        let tried = (0..STEPS).map(read).filter(|(_, girth)| *girth > 0.0);
        let best = tried.reduce(|a, b| if better(a.1, b.1) == a.1 { a } else { b });
        let (height, body_m) = best.ok_or("the trunk is not there")?;
        let plane = Plane::level(height);
        let hips = self.legs.as_ref().map_or_else(Vec3::zeros, |l| 0.5 * (l[0].points[0] + l[1].points[0]));
        let arms = self.arms.iter().flatten().filter_map(|arm| plane.crossing(&arm.points));
        let centre = Vec3::new(hips.x, height, hips.z);
        Ok(vec![Landmark { girth, side: None, plane, centre, beside: arms.collect(), body_m }])
    }

    /// The piece that goes round `centre` and not round any of `beside`; the outermost of several.
    fn around(&self, plane: &Plane, centre: &Vec3, beside: &[Vec3]) -> Option<f64> {
        let pieces = self.section(plane, &|_| false);
        let round = |piece: &&Piece, p: &Vec3| piece.turns_around(&plane.flat(p)) > ROUND;
        let fits = pieces.iter().filter(|p| round(p, centre) && !beside.iter().any(|b| round(p, b)));
        fits.map(Piece::hull_length).reduce(f64::max)
    }

    fn floor(&self) -> f64 {
        self.mesh.points.iter().map(|p| p.y).fold(f64::MAX, f64::min)
    }

    /// Height of the crotch [m].
    fn crotch(&self) -> Result<f64, &'static str> {
        let legs = self.legs.as_ref().ok_or("no hip joints were found")?;
        let (floor, [h, _]) = (self.floor(), self.trunk_heights()?);
        let (low, high) = (floor + 0.5 * (h - floor), h);
        let steps = 4 * STEPS;
        let apart = |height: f64| {
            let plane = Plane::level(height);
            let [a, b] = [plane.crossing(&legs[0].points)?, plane.crossing(&legs[1].points)?];
            self.around(&plane, &a, &[b])?;
            self.around(&plane, &b, &[a])
        };
        let level = |k: usize| low + (high - low) * k as f64 / steps as f64;
        let highest = (0..steps).map(level).take_while(|&y| apart(y).is_some()).last();
        highest.ok_or("no level was found at which the legs are apart")
    }

    fn thighs(&self) -> Result<Vec<Landmark>, &'static str> {
        let crotch = self.crotch()?;
        let plane = Plane::level(crotch - THIGH * (crotch - self.floor()));
        let legs = self.legs.as_ref().ok_or("no hip joints were found")?;
        let cross = |k: usize| plane.crossing(&legs[k].points).ok_or("a leg's bones miss the thigh");
        let centres = [cross(0)?, cross(1)?];
        self.pair(Girth::Thigh, |k| (plane, centres[k], vec![centres[1 - k]]))
    }

    fn upper_arms(&self) -> Result<Vec<Landmark>, &'static str> {
        let arms = self.arms.as_ref().ok_or("no shoulder joints were found")?;
        let middle: Vec<Vec3> = self.neck.into_iter().flatten().chain(self.hips()).collect();
        self.pair(Girth::UpperArm, |k| {
            let (centre, direction) = along(&arms[k].points, UPPER_ARM);
            let plane = Plane::new(centre, direction);
            (plane, centre, plane.crossing(&middle).into_iter().collect())
        })
    }

    fn hips(&self) -> Option<Vec3> {
        self.legs.as_ref().map(|legs| 0.5 * (legs[0].points[0] + legs[1].points[0]))
    }

    fn pair(
        &self,
        girth: Girth,
        place: impl Fn(usize) -> (Plane, Vec3, Vec<Vec3>),
    ) -> Result<Vec<Landmark>, &'static str> {
        let side = |(k, side)| {
            let (plane, centre, beside) = place(k);
            let body_m =
                self.around(&plane, &centre, &beside).ok_or("no contour goes round the limb alone")?;
            Ok(Landmark { girth, side: Some(side), plane, centre, beside, body_m })
        };
        [(0, Side::Left), (1, Side::Right)].into_iter().map(side).collect()
    }

    fn neck(&self) -> Result<Vec<Landmark>, &'static str> {
        let [base, head] = self.neck.ok_or("no joints of neck and head were found")?;
        let place = |k: usize| base + (head - base) * (k as f64 / STEPS as f64);
        let read = |k: usize| {
            let plane = Plane::new(place(k), head - base);
            Some((plane, place(k), self.around(&plane, &place(k), &[])?))
        };
        let narrowest = (0..=STEPS).filter_map(read).min_by(|a, b| a.2.total_cmp(&b.2));
        let (plane, centre, body_m) = narrowest.ok_or("no contour goes round the neck")?;
        let beside = Vec::new();
        Ok(vec![Landmark { girth: Girth::Neck, side: None, plane, centre, beside, body_m }])
    }
}

/// The point at a part of a polyline's length, and the direction there.
fn along(line: &[Vec3], part: f64) -> (Vec3, Vec3) {
    let length: f64 = line.windows(2).map(|e| (e[1] - e[0]).norm()).sum();
    let mut left = part * length;
    for e in line.windows(2) {
        let edge = e[1] - e[0];
        if left <= edge.norm() {
            return (e[0] + edge * (left / edge.norm()), edge);
        }
        left -= edge.norm();
    }
    let n = line.len();
    (line[n - 1], line[n - 1] - line[n - 2])
}
