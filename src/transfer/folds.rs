//! Where the target's skin folds: creases that are narrower than the grid can follow.

use serde::Serialize;

use crate::geometry::Surface;
use crate::model::Vec3;

/// Share of the way out along the normal that is free over smooth skin; over a crease the
/// other flank is nearer.
const FREE: f64 = 0.75;

/// A connected piece of skin.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fold {
    /// Its middle on the target body [m].
    pub center_m: [f64; 3],
    /// Its area on the source body [m^2].
    pub area_m2: f64,
    /// Largest gap in it [m].
    pub gap_max_m: f64,
}

/// The creases among the skin points whose gap is above `accepted` [m], largest area first: a
/// point lies in one if the body comes back within half a cell of it.
pub fn find(target: &Surface, gaps: &[f64], areas: &[f64], accepted: f64, cell: f64) -> Vec<Fold> {
    let mesh = target.mesh();
    let reach = 0.5 * cell;
    let creased = |i: usize| {
        let out = mesh.points[i] + target.point_normals()[i] * reach;
        target.closest_within(&out, FREE * reach).is_some()
    };
    let folded: Vec<bool> = (0..gaps.len()).map(|i| gaps[i] > accepted && creased(i)).collect();
    let mut piece: Vec<usize> = (0..gaps.len()).collect();
    for triangle in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (triangle[k] as usize, triangle[(k + 1) % 3] as usize);
            if folded[a] && folded[b] {
                let (a, b) = (root(&mut piece, a), root(&mut piece, b));
                piece[a.max(b)] = a.min(b);
            }
        }
    }
    let mut found = std::collections::BTreeMap::<usize, (Vec3, f64, f64)>::new();
    for i in (0..gaps.len()).filter(|&i| folded[i]) {
        let (sum, area, gap) = found.entry(root(&mut piece, i)).or_default();
        *sum += mesh.points[i] * areas[i];
        *area += areas[i];
        *gap = gap.max(gaps[i]);
    }
    let fold = |(sum, area, gap): (Vec3, f64, f64)| Fold {
        center_m: (sum / area).into(),
        area_m2: area,
        gap_max_m: gap,
    };
    let mut folds: Vec<Fold> = found.into_values().map(fold).collect();
    folds.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    folds
}

/// The first member of `i`'s piece.
fn root(piece: &mut [usize], mut i: usize) -> usize {
    while piece[i] != i {
        piece[i] = piece[piece[i]];
        i = piece[i];
    }
    i
}
