//! The joints that landmarks need: those of the figure that [`crate::pose`] finds in any skeleton.

use crate::model::{Skeleton, Vec3};
use crate::pose::Figure;

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

impl Joints {
    /// Finds the joints of `skeleton`; none in what is no skeleton.
    pub fn find(skeleton: &Skeleton) -> Joints {
        let Ok(figure) = Figure::find(skeleton) else { return Joints::default() };
        let limb = |root: usize, end: usize| {
            let up = std::iter::successors(Some(end), |&j| skeleton.parent(j).filter(|_| j != root));
            let mut points: Vec<Vec3> = up.map(|j| figure.positions[j]).collect();
            points.reverse();
            Limb { points, root }
        };
        let legs = figure.legs.map(|leg| leg.map(|l| limb(l.thigh, l.foot)));
        let arms = figure.arms.map(|arm| arm.map(|a| limb(a.upper, a.hand)));
        let both = |[left, right]: [Option<Limb>; 2]| Some([left?, right?]);
        let neck = figure.neck.first().zip(figure.neck.last());
        let neck = neck.map(|(&base, &head)| [figure.positions[base], figure.positions[head]]);
        Joints { legs: both(legs), arms: both(arms), neck: neck.filter(|[base, head]| head.y > base.y) }
    }
}
