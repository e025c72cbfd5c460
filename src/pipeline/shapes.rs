//! The body's blend shapes on every garment, details included.

use super::Settings;
use super::layers::Draped;
use crate::geometry::OuterSkin;
use crate::model::{BlendShape, Character, Garment, Vec3};
use crate::proxy::Proxy;
use crate::rig::blend_shapes;

/// The shapes that move a garment, over the points of its source mesh; none unless they are asked for.
pub(super) fn run(
    character: &Character,
    body: &OuterSkin,
    proxy: &Proxy<'_>,
    garment: &Garment,
    draped: &Draped,
    settings: &Settings,
) -> Vec<BlendShape> {
    let params = &settings.blend_shapes;
    if !params.enabled || character.blend_shapes.is_empty() {
        return Vec::new();
    }
    let points = proxy.gather(&draped.points);
    let of_shell = blend_shapes::carry(character, body, proxy.garment(), &points, params);
    let before = proxy.lift(&points);
    let mut carried = Vec::new();
    for (shape, offsets) in character.blend_shapes.iter().zip(of_shell) {
        let Some(offsets) = offsets else { continue };
        let moved: Vec<Vec3> = points.iter().zip(offsets).map(|(p, x)| p + x).collect();
        let after = proxy.lift(&moved);
        let of_vertex: Vec<Vec3> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
        let shape = sparse(&shape.name, garment, &of_vertex, params.smallest);
        if !shape.points.is_empty() {
            carried.push(shape);
        }
    }
    carried
}

/// Offsets of vertices as a shape of the source mesh's points, those longer than `smallest` [m].
fn sparse(name: &str, garment: &Garment, of_vertex: &[Vec3], smallest: f64) -> BlendShape {
    let mut of_point = vec![Vec3::zeros(); garment.point_count];
    for (v, &p) in garment.point_of_vertex.iter().enumerate().rev() {
        of_point[p as usize] = of_vertex[v];
    }
    let kept = (0..garment.point_count as u32).filter(|&p| of_point[p as usize].norm() > smallest);
    let points: Vec<u32> = kept.collect();
    let offsets = points.iter().map(|&p| of_point[p as usize]).collect();
    BlendShape { name: name.to_owned(), points, offsets }
}
