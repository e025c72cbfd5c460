//! Skin weights of the details: those of the spot of the proxy that they are bound to.
//!
//! What is sewn edge to edge has one set of weights, the proxy's vertex's where there is one. All
//! else has the proxy's weights where it is bound, blended over the triangle's corners, also what
//! is sewn on with an offset. Where that is more joints than a vertex may have, the rig says which of them
//! stay. (With the weights of the nearest *vertex* that it is tied to, a
//! pocket's edge strayed up to 9 mm from the front in raised arms; now it stays within 1 mm.)

use super::{Proxy, Split};
use crate::model::{Garment, Skin, Vec3};

/// From a point [m], its weights and how many it may have to those that it keeps, the largest first.
pub type Cap<'a> = &'a dyn Fn(&Vec3, &[(u32, f64)], usize) -> Vec<(u32, f64)>;

impl Proxy<'_> {
    /// Weights of the whole garment's vertices, which are at `points` [m], from those of the proxy's.
    pub fn skin(&self, of_proxy: &Skin, points: &[Vec3], cap: Cap<'_>) -> Skin {
        let Some(split) = &self.split else { return of_proxy.clone() };
        let k = of_proxy.influences;
        let groups = &self.whole.groups;
        let mut of_weld: Vec<Option<Vec<(u32, f64)>>> = vec![None; groups.weld_count];
        let weld = |v: u32| groups.weld_of_vertex[v as usize] as usize;
        for (i, &v) in split.shell.vertices.iter().enumerate() {
            of_weld[weld(v)].get_or_insert_with(|| influences(of_proxy, i));
        }
        for (i, &v) in split.details.vertices.iter().enumerate() {
            of_weld[weld(v)].get_or_insert_with(|| cap(&points[v as usize], &split.blend(of_proxy, i), k));
        }
        let mut skin = Skin { influences: k, ..Skin::default() };
        for v in 0..self.whole.points.len() as u32 {
            let own = of_weld[weld(v)].as_ref().expect("every vertex is in a part");
            skin.joint_indices.extend((0..k).map(|i| own.get(i).map_or(0, |w| w.0)));
            skin.joint_weights.extend((0..k).map(|i| own.get(i).map_or(0.0, |w| w.1)));
        }
        skin
    }
}

impl Split {
    /// The proxy's weights where vertex `detail` is bound.
    fn blend(&self, of_proxy: &Skin, detail: usize) -> Vec<(u32, f64)> {
        let bond = self.bond(detail);
        let shell: &Garment = &self.shell.garment;
        let mut sum = std::collections::BTreeMap::new();
        for (&corner, share) in shell.triangles[bond.triangle as usize].iter().zip(bond.barycentric) {
            for (joint, weight) in influences(of_proxy, corner as usize) {
                *sum.entry(joint).or_insert(0.0) += share * weight;
            }
        }
        let total: f64 = sum.values().sum();
        sum.into_iter().filter(|w| w.1 > 0.0).map(|(joint, weight)| (joint, weight / total)).collect()
    }
}

fn influences(skin: &Skin, v: usize) -> Vec<(u32, f64)> {
    (v * skin.influences..(v + 1) * skin.influences)
        .map(|i| (skin.joint_indices[i], skin.joint_weights[i]))
        .filter(|w| w.1 > 0.0)
        .collect()
}
