//! Some panels of a garment as a garment of their own.

use crate::model::{AuthoredSeam, Garment, SeamGroups};

/// A part of a garment. Panels, points and triangles keep their order; `panels`, `source_points`
/// and `point_of_vertex` are those of the whole, so that indices into them stay.
#[derive(Clone, Debug)]
pub struct Part {
    /// The part.
    pub garment: Garment,
    /// Vertex of the whole that each vertex of the part is.
    pub vertices: Vec<u32>,
}

impl Part {
    /// The panels of `whole` that `take` names.
    ///
    /// What was tied stays tied: where the anchor of a seam group is left out, the first of the
    /// group that stays takes its place.
    pub fn new(whole: &Garment, take: &[bool]) -> Part {
        let vertices: Vec<u32> = (0..whole.points.len() as u32)
            .filter(|&v| take[whole.panel_of_vertex[v as usize] as usize])
            .collect();
        let mut part_of = vec![u32::MAX; whole.points.len()];
        for (i, &v) in vertices.iter().enumerate() {
            part_of[v as usize] = i as u32;
        }
        let taken: Vec<usize> =
            (0..whole.triangles.len()).filter(|&t| take[whole.panel_of_triangle[t] as usize]).collect();
        let mut has_point = vec![false; whole.point_count];
        vertices.iter().for_each(|&v| has_point[whole.point_of_vertex[v as usize] as usize] = true);
        let seams = whole.seams.iter().map(|seam| AuthoredSeam {
            pairs: seam.pairs.iter().copied().filter(|p| p.iter().all(|&p| has_point[p as usize])).collect(),
            ..seam.clone()
        });
        let garment = Garment {
            name: whole.name.clone(),
            path: whole.path.clone(),
            layer: whole.layer,
            body: whole.body,
            points: pick(&whole.points, &vertices),
            pattern: pick(&whole.pattern, &vertices),
            triangles: taken.iter().map(|&t| whole.triangles[t].map(|v| part_of[v as usize])).collect(),
            panel_of_triangle: taken.iter().map(|&t| whole.panel_of_triangle[t]).collect(),
            panel_of_vertex: pick(&whole.panel_of_vertex, &vertices),
            panels: whole.panels.clone(),
            seams: seams.filter(|seam| !seam.pairs.is_empty()).collect(),
            groups: groups(&whole.groups, &vertices, &part_of),
            point_of_vertex: pick(&whole.point_of_vertex, &vertices),
            point_count: whole.point_count,
            source_points: whole.source_points.clone(),
            joints: whole.joints.clone(),
        };
        Part { garment, vertices }
    }
}

/// The elements of `all` that belong to `vertices`.
pub fn pick<T: Copy>(all: &[T], vertices: &[u32]) -> Vec<T> {
    vertices.iter().map(|&v| all[v as usize]).collect()
}

/// Groups of the vertices that stay.
fn groups(whole: &SeamGroups, vertices: &[u32], part_of: &[u32]) -> SeamGroups {
    let mut first_of_weld = vec![u32::MAX; whole.weld_count];
    let mut ties = Vec::new();
    for (i, &v) in vertices.iter().enumerate() {
        let first = &mut first_of_weld[whole.weld_of_vertex[v as usize] as usize];
        if *first == u32::MAX {
            *first = i as u32;
        } else {
            ties.push([*first, i as u32]);
        }
    }
    let mut base_of_node: Vec<u32> = whole.anchor_of_node.iter().map(|&a| part_of[a as usize]).collect();
    let mut offset_ties = Vec::new();
    for (i, &v) in vertices.iter().enumerate() {
        let base = &mut base_of_node[whole.node_of_vertex[v as usize] as usize];
        if *base == u32::MAX {
            *base = i as u32;
        }
        let weld_of_base = whole.weld_of_vertex[vertices[*base as usize] as usize];
        if weld_of_base != whole.weld_of_vertex[v as usize] {
            offset_ties.push([i as u32, *base]);
        }
    }
    SeamGroups::new(vertices.len(), &ties, &offset_ties)
}
