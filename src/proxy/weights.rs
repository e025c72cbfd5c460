//! Skin weights of the details: those of the spot of the proxy that they are bound to.
//!
//! A seam group has one set of weights. Where it holds a vertex of the proxy the weights are that
//! vertex's; a group of details alone has those of the proxy at its anchor's bond, blended over the
//! triangle's corners.

use super::{Proxy, Split};
use crate::model::{Garment, Skin};

impl Proxy<'_> {
    /// Weights of the whole garment's vertices from those of the proxy's vertices.
    pub fn skin(&self, of_proxy: &Skin) -> Skin {
        let Some(split) = &self.split else { return of_proxy.clone() };
        let k = of_proxy.influences;
        let mut of_node: Vec<Option<Vec<(u32, f64)>>> = vec![None; self.whole.groups.node_count];
        let node = |v: u32| self.whole.groups.node_of_vertex[v as usize] as usize;
        for (i, &v) in split.shell.vertices.iter().enumerate() {
            of_node[node(v)].get_or_insert_with(|| influences(of_proxy, i));
        }
        for (i, &v) in split.details.vertices.iter().enumerate() {
            if self.whole.groups.anchor_of_node[node(v)] == v {
                of_node[node(v)].get_or_insert_with(|| split.blend(of_proxy, i));
            }
        }
        let mut skin = Skin { influences: k, ..Skin::default() };
        for v in 0..self.whole.points.len() as u32 {
            let own = of_node[node(v)].as_ref().expect("the anchor of every node is in a part");
            skin.joint_indices.extend((0..k).map(|i| own.get(i).map_or(0, |w| w.0)));
            skin.joint_weights.extend((0..k).map(|i| own.get(i).map_or(0.0, |w| w.1)));
        }
        skin
    }
}

impl Split {
    /// The proxy's weights where vertex `detail` is bound, the largest first.
    fn blend(&self, of_proxy: &Skin, detail: usize) -> Vec<(u32, f64)> {
        let bond = self.bond(detail);
        let shell: &Garment = &self.shell.garment;
        let mut sum = std::collections::BTreeMap::new();
        for (&corner, share) in shell.triangles[bond.triangle as usize].iter().zip(bond.barycentric) {
            for (joint, weight) in influences(of_proxy, corner as usize) {
                *sum.entry(joint).or_insert(0.0) += share * weight;
            }
        }
        let mut blend: Vec<(u32, f64)> = sum.into_iter().filter(|w| w.1 > 0.0).collect();
        blend.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        blend.truncate(of_proxy.influences);
        let total: f64 = blend.iter().map(|w| w.1).sum();
        blend.iter_mut().for_each(|w| w.1 /= total);
        blend
    }
}

fn influences(skin: &Skin, v: usize) -> Vec<(u32, f64)> {
    (v * skin.influences..(v + 1) * skin.influences)
        .map(|i| (skin.joint_indices[i], skin.joint_weights[i]))
        .filter(|w| w.1 > 0.0)
        .collect()
}
