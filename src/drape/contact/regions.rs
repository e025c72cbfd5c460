//! Which parts of a sheet lie on the wrong side of other parts: global intersection analysis
//! [Baraff et al. 2003].
//!
//! Contours cut a sheet into regions: contact points that are joined by edges which pass
//! through nothing. Of every connected piece the largest region is taken to be where it
//! belongs; the others are *inside*, and have to go back through what cut them off. Where a
//! contour ends on the sheet and does not cut it, there is no region, and the contour itself
//! has to shrink ([`super::contour`]).
//!
//! Which side is the right one needs no orientation: it is the side of the edge's other end,
//! outside of the region, where the region was cut off.

use std::collections::{BTreeMap, BTreeSet};

use super::sheet::Sheet;
use crate::model::Vec3;
use crate::model::seam::DisjointSets;

/// What cut a region off.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// Triangles that the region is to pass, each with the sign of the side where it belongs.
    pub triangles: BTreeMap<u32, f64>,
    /// Regions of those triangles' corners.
    pub regions: BTreeSet<u32>,
}

/// Regions of a sheet.
#[derive(Clone, Debug, Default)]
pub struct Regions {
    /// Region of each contact point; empty where nothing crosses.
    pub of_point: Vec<u32>,
    /// For each region that is inside, what cut it off.
    pub cuts: BTreeMap<u32, Cut>,
}

impl Regions {
    /// The regions that `crossings` (edge and triangle) cut.
    pub fn new(sheet: &Sheet, crossings: &[[u32; 2]], x: &[Vec3]) -> Regions {
        if crossings.is_empty() {
            return Regions::default();
        }
        let mut regions = Regions { of_point: flood(sheet, crossings), cuts: BTreeMap::new() };
        let inside = regions.inside(sheet);
        for &[e, t] in crossings {
            let ends = sheet.edges.ends[e as usize];
            let of = ends.map(|p| regions.of_point[p as usize]);
            if of[0] == of[1] {
                continue;
            }
            for k in 0..2 {
                if inside[of[k] as usize] {
                    regions.cut_off(sheet, of[k], ends[1 - k], t, x);
                }
            }
        }
        regions
    }

    /// Whether a contact point is inside.
    pub fn is_inside(&self, point: u32) -> bool {
        self.cut(point).is_some()
    }

    /// What cut the region of a contact point off.
    pub fn cut(&self, point: u32) -> Option<&Cut> {
        self.of_point.get(point as usize).and_then(|region| self.cuts.get(region))
    }

    /// Whether some of the points `a` have to go through some of the points `b`, or these
    /// through those.
    pub fn must_pass(&self, a: &[u32], b: &[u32]) -> bool {
        if self.cuts.is_empty() {
            return false;
        }
        let through = |a: &[u32], b: &[u32]| {
            a.iter()
                .filter_map(|&p| self.cut(p))
                .any(|cut| b.iter().any(|&q| cut.regions.contains(&self.of_point[q as usize])))
        };
        through(a, b) || through(b, a)
    }

    /// For each region, whether it is not the largest of its piece.
    fn inside(&self, sheet: &Sheet) -> Vec<bool> {
        let count = self.of_point.iter().max().map_or(0, |&r| r as usize + 1);
        let mut area = vec![0.0; count];
        for tri in &sheet.triangles {
            let [a, b, c] = tri.map(|p| sheet.source[p as usize]);
            let third = (b - a).cross(&(c - a)).norm() / 6.0;
            tri.iter().for_each(|&p| area[self.of_point[p as usize] as usize] += third);
        }
        let pieces = pieces(sheet);
        let mut largest: BTreeMap<u32, u32> = BTreeMap::new();
        for (point, &region) in self.of_point.iter().enumerate() {
            let best = largest.entry(pieces[point]).or_insert(region);
            if area[region as usize] > area[*best as usize] {
                *best = region;
            }
        }
        let kept: BTreeSet<u32> = largest.into_values().collect();
        (0..count as u32).map(|r| !kept.contains(&r)).collect()
    }

    /// Notes that triangle `t` separates `region` from the point `outside`.
    fn cut_off(&mut self, sheet: &Sheet, region: u32, outside: u32, t: u32, x: &[Vec3]) {
        let [a, b, c] = sheet.triangles[t as usize].map(|p| x[p as usize]);
        let side = (b - a).cross(&(c - a)).dot(&(x[outside as usize] - a)).signum();
        let of = sheet.triangles[t as usize].map(|p| self.of_point[p as usize]);
        let cut = self.cuts.entry(region).or_default();
        cut.triangles.insert(t, side);
        cut.regions.extend(of);
    }
}

/// Joins points along edges that pass through an even number of triangles.
fn flood(sheet: &Sheet, crossings: &[[u32; 2]]) -> Vec<u32> {
    let mut odd = vec![false; sheet.edges.ends.len()];
    crossings.iter().for_each(|&[e, _]| odd[e as usize] ^= true);
    let mut sets = DisjointSets::new(sheet.node.len());
    for (ends, _) in sheet.edges.ends.iter().zip(&odd).filter(|(_, odd)| !**odd) {
        sets.union(ends[0], ends[1]);
    }
    sets.labels().0
}

/// Connected pieces of the sheet.
fn pieces(sheet: &Sheet) -> Vec<u32> {
    let mut sets = DisjointSets::new(sheet.node.len());
    sheet.edges.ends.iter().for_each(|ends| sets.union(ends[0], ends[1]));
    sets.labels().0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drape::contact::crossing::with_itself;

    /// Squares of `n` by `n` cells, placed by functions.
    fn sheets(n: usize, places: &[&dyn Fn(f64, f64) -> Vec3]) -> (Sheet, Vec<Vec3>) {
        let (mut x, mut triangles) = (Vec::new(), Vec::new());
        for place in places {
            let first = x.len() as u32;
            for i in 0..=n {
                x.extend((0..=n).map(|j| place(i as f64 / n as f64, j as f64 / n as f64)));
            }
            let at = |i: usize, j: usize| first + (i * (n + 1) + j) as u32;
            for i in 0..n {
                for j in 0..n {
                    triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                    triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
        let node: Vec<u32> = (0..x.len() as u32).collect();
        (Sheet::of(node.clone(), node, triangles, x.clone()), x)
    }

    fn regions(sheet: &Sheet, x: &[Vec3]) -> Regions {
        Regions::new(sheet, &with_itself(sheet, x), x)
    }

    #[test]
    fn a_bump_through_a_sheet_is_inside_and_so_is_what_it_covers() {
        let bump = |u: f64, v: f64| {
            let r2 = (u - 0.51).powi(2) + (v - 0.48).powi(2);
            Vec3::new(u, 0.3 * (-20.0 * r2).exp() - 0.1, v)
        };
        let flat = |u: f64, v: f64| Vec3::new(u + 0.003, 0.0, v + 0.007);
        let (sheet, x) = sheets(12, &[&bump, &flat]);
        let found = regions(&sheet, &x);
        assert_eq!(found.cuts.len(), 2);
        let half = x.len() / 2;
        for p in 0..half {
            assert_eq!(found.is_inside(p as u32), x[p].y > 0.0, "{p}");
        }
        assert!((half..x.len()).any(|p| found.is_inside(p as u32)));
        // The bump belongs below the sheet, whichever way that is oriented.
        let cut = found.cut(half as u32 / 2).expect("the bump's top");
        for (&t, &sign) in &cut.triangles {
            let [a, b, c] = sheet.triangles[t as usize].map(|p| x[p as usize]);
            assert!(sign * (b - a).cross(&(c - a)).y < 0.0);
        }
    }

    #[test]
    fn a_slit_that_ends_in_both_sheets_cuts_nothing() {
        let up = |u: f64, v: f64| Vec3::new(u - 0.513, v - 0.507, 0.011);
        let (sheet, x) = sheets(6, &[&|u, v| Vec3::new(u, 0.0, v - 0.491), &up]);
        assert!(!with_itself(&sheet, &x).is_empty());
        let found = regions(&sheet, &x);
        assert!(found.cuts.is_empty(), "{:?}", found.cuts);
        let (sheet, x) = sheets(6, &[&|u, v| Vec3::new(u, 0.0, v), &|u, v| Vec3::new(u, 1.0, v)]);
        assert!(regions(&sheet, &x).of_point.is_empty());
    }
}
