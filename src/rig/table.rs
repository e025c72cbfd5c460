//! Weights of all nodes over the joints that occur.

use crate::geometry::OuterSkin;
use crate::model::Skin;

/// Dense rows over the joints that any node may have.
pub(super) struct Table {
    /// Joints, ascending: the columns.
    pub joints: Vec<u32>,
    /// Shape `[nodes, joints]`.
    pub values: Vec<f64>,
}

/// One node's weights as they come: (joint, weight), joints may repeat.
pub(super) type Sparse = Vec<(u32, f64)>;

impl Table {
    /// Rows from sparse weights; those that are `None` are zero.
    pub fn new(rows: &[Option<Sparse>], joint_count: usize) -> Table {
        let mut used = vec![false; joint_count];
        rows.iter().flatten().flatten().filter(|w| w.1 > 0.0).for_each(|w| used[w.0 as usize] = true);
        let joints: Vec<u32> = (0..joint_count as u32).filter(|&j| used[j as usize]).collect();
        let mut column = vec![0; joint_count];
        joints.iter().enumerate().for_each(|(c, &j)| column[j as usize] = c);
        let width = joints.len();
        let mut values = vec![0.0; rows.len() * width];
        for (row, out) in rows.iter().zip(values.chunks_mut(width.max(1))) {
            for &(joint, weight) in row.iter().flatten().filter(|w| w.1 > 0.0) {
                out[column[joint as usize]] += weight;
            }
        }
        Table { joints, values }
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.joints.len()
    }

    pub fn row(&self, node: usize) -> &[f64] {
        &self.values[node * self.width()..(node + 1) * self.width()]
    }

    pub fn row_mut(&mut self, node: usize) -> &mut [f64] {
        let width = self.width();
        &mut self.values[node * width..(node + 1) * width]
    }

    /// Takes rows from the columns of a solve (column after column, `nodes.len()` each), none
    /// negative and each with a sum of 1.
    pub fn take_columns(&mut self, nodes: &[u32], columns: &[f64]) {
        let size = nodes.len();
        for (u, &node) in nodes.iter().enumerate() {
            let row = self.row_mut(node as usize);
            row.iter_mut().enumerate().for_each(|(c, w)| *w = columns[c * size + u].max(0.0));
            normalise(row);
        }
    }
}

/// Divides a row by its sum.
pub(super) fn normalise(row: &mut [f64]) {
    let sum: f64 = row.iter().sum();
    row.iter_mut().for_each(|w| *w /= sum);
}

/// The body's weights at a point of its outer skin.
pub(super) fn body_weights(body: &OuterSkin, skin: &Skin, triangle: u32, barycentric: &[f64; 3]) -> Sparse {
    let k = skin.influences;
    let corners = body.surface.mesh().triangles[triangle as usize];
    let mut weights = Sparse::with_capacity(3 * k);
    for (corner, share) in corners.iter().zip(barycentric) {
        let first = body.point_of[*corner as usize] as usize * k;
        for i in (first..first + k).filter(|&i| share * skin.joint_weights[i] > 0.0) {
            weights.push((skin.joint_indices[i], share * skin.joint_weights[i]));
        }
    }
    weights
}
