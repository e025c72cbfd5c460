//! Meshes and helpers for the tests of elastic energies.

mod closed_forms;
mod derivatives;
mod softening;
mod twins;

use crate::drape::cloth::{Cloth, Options};
use crate::model::{Fabric, Garment, GarmentSource, Panel, TriMesh, Vec2, Vec3};

/// A small generator of numbers in [-1, 1], so that tests repeat (xorshift64*).
pub(crate) struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vec3(&mut self, size: f64) -> Vec3 {
        Vec3::from_fn(|_, _| size * self.next())
    }
}

/// How quads are split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Split {
    /// All along the same diagonal.
    Diagonal,
    /// In turn along either.
    Alternating,
    /// Rows shifted by half an edge: equilateral triangles.
    Equilateral,
    /// As `Diagonal`, inner vertices moved by a fifth of an edge.
    Irregular,
}

/// A flat panel of `nx` by `ny` quads with sides of about `h`, turned by `turn` in its panel.
pub(crate) fn panel(nx: usize, ny: usize, h: f64, split: Split, turn: f64) -> (Vec<Vec2>, Vec<[u32; 3]>) {
    let mut noise = Noise(7);
    let mut points = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let mut p = Vec2::new(i as f64, j as f64) * h;
            if split == Split::Equilateral {
                p = Vec2::new(p.x + 0.5 * h * (j % 2) as f64, p.y * 0.75f64.sqrt());
            }
            let inside = i > 0 && i < nx && j > 0 && j < ny;
            if split == Split::Irregular && inside {
                p += Vec2::new(noise.next(), noise.next()) * (0.2 * h);
            }
            points.push(nalgebra::Rotation2::new(turn) * p);
        }
    }
    let at = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let mut triangles = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let other = match split {
                Split::Diagonal | Split::Irregular => false,
                Split::Alternating => (i + j) % 2 == 1,
                Split::Equilateral => j % 2 == 0,
            };
            triangles.extend(if other { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] });
        }
    }
    (points, triangles)
}

/// A garment of one panel, its 3D points by `place`.
pub(crate) fn garment_of(
    (pattern, triangles): &(Vec<Vec2>, Vec<[u32; 3]>),
    fabric: &Fabric,
    place: impl Fn(&Vec2) -> Vec3,
) -> Garment {
    Garment::from_source(GarmentSource::sheet("sheet", pattern, triangles, fabric, place)).unwrap()
}

/// Its cloth, with its own pattern.
pub(crate) fn cloth_of(garment: &Garment) -> Cloth {
    Cloth::new(garment, &garment.pattern, &Options::default()).unwrap()
}

pub(crate) fn flat(p: &Vec2) -> Vec3 {
    Vec3::new(p.x, 0.0, p.y)
}

/// A sheet rolled to curvature `kappa` in the panel's direction `angle`.
pub(crate) fn rolled(kappa: f64, angle: f64) -> impl Fn(&Vec2) -> Vec3 {
    move |p| {
        let q = nalgebra::Rotation2::new(-angle) * p;
        Vec3::new((kappa * q.x).sin() / kappa, (1.0 - (kappa * q.x).cos()) / kappa, q.y)
    }
}

/// Fabric that resists bending alone, differently in all directions.
pub(crate) fn bending_only() -> Fabric {
    let (stretch_warp, stretch_weft, shear) = (0.0, 0.0, 0.0);
    let (bending_warp, bending_weft, bending_shear) = (3e-5, 2e-5, 1e-5);
    Fabric {
        stretch_warp,
        stretch_weft,
        shear,
        bending_warp,
        bending_weft,
        bending_shear,
        ..Fabric::default()
    }
}

/// Two panels sewn along an edge of `n` quads, folded by `fold` there.
pub(crate) fn sewn(n: usize, h: f64, fold: f64) -> Garment {
    let (mut points, mut corners, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..=n {
        let z = h * i as f64;
        let away = Vec3::new(h * fold.cos(), h * fold.sin(), 0.0);
        points.extend([Vec3::new(-h, 0.0, z), Vec3::new(0.0, 0.0, z), Vec3::new(0.0, 0.0, z) + away]);
    }
    let mut panels = Vec::new();
    for i in 0..n as u32 {
        for side in 0..2u32 {
            let [a, b] = [3 * i + side, 3 * i + side + 1];
            let [c, d] = [b + 3, a + 3];
            let uv = |point: u32| {
                let (column, row) = (point % 3 - side, point / 3);
                // The second panel lies turned in its own coordinates.
                let p = Vec2::new(h * f64::from(column), h * f64::from(row));
                if side == 1 { Vec2::new(1.0 - p.y, p.x) } else { p }
            };
            for tri in [[a, b, c], [a, c, d]] {
                triangles.push(tri);
                corners.push(tri.map(uv));
                panels.push(side);
            }
        }
    }
    let fabric = Panel { fabric: Fabric::default(), ..Panel::default() };
    let source = GarmentSource {
        name: "sewn".to_owned(),
        mesh: TriMesh { points, triangles },
        corner_pattern: corners,
        panel_of_triangle: panels,
        panels: vec![fabric.clone(), fabric],
        ..GarmentSource::default()
    };
    Garment::from_source(source).unwrap()
}
