//! Winding numbers and closest points for many queries at once, on a device.
//!
//! Each invocation walks the flattened hierarchy for one query: from node `i` to `i + 1` to
//! descend, or to the node's `skip` link to leave its subtree out, so no stack is needed.
//! The device sees `f32` relative to the middle of the surface's box; what is decided there
//! is which triangle is closest, and the point on it is then computed in `f64`.
//!
//! A walk of many turns is cut: after [`TURNS`] the cursor is stored, and the next run of the
//! kernel goes on from it. Some drivers end long loops without a word.

mod closest;
mod winding;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::bvh::Node;
use super::surface::{Closest, Surface};
use super::{Moments, triangle};
use crate::device::{Buffer, Device, DeviceError, Kernel};
use crate::model::Vec3;

/// Most nodes that a kernel visits in one run.
const TURNS: u32 = 50_000;
/// Queries that a CPU task takes.
const GRAIN: usize = 64;

/// All kernels of this module, for the tests that validate WGSL.
pub const KERNELS: &[&Kernel] = &[&closest::CLOSEST, &winding::WINDING];

/// `struct Walk` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Walk {
    /// Number of queries.
    queries: u32,
    /// Number of nodes.
    nodes: u32,
    /// Most nodes to visit in this run.
    turns: u32,
    /// 1 to start at the root, 0 to go on.
    start: u32,
}

type Point = nalgebra::Vector3<f32>;

fn point(values: &[f32]) -> Point {
    Point::new(values[0], values[1], values[2])
}

/// A node's links; `struct Link` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Link {
    skip: u32,
    triangle: u32,
}

/// A surface's hierarchy on a device.
#[derive(Debug)]
pub struct SurfaceOnDevice<'a> {
    surface: &'a Surface,
    /// What the device's coordinates are relative to [m].
    origin: Vec3,
    nodes: u32,
    turns: u32,
    links: Buffer<Link>,
    /// Lower and upper corner of each node's box [m].
    boxes: Buffer<[f32; 6]>,
    /// What the far field needs of each node, see [`winding::pack`].
    moments: Buffer<[f32; winding::MOMENTS]>,
    /// Corners of each triangle [m].
    corners: Buffer<[f32; 9]>,
}

impl<'a> SurfaceOnDevice<'a> {
    /// Uploads the hierarchy.
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn new(device: &Device, surface: &'a Surface) -> Result<SurfaceOnDevice<'a>, DeviceError> {
        let (mesh, nodes) = (surface.mesh(), surface.nodes());
        let origin =
            nodes.first().map_or_else(Vec3::zeros, |root| (Vec3::from(root.lo) + Vec3::from(root.hi)) / 2.0);
        let links: Vec<Link> = nodes.iter().map(|n| Link { skip: n.skip, triangle: n.triangle }).collect();
        let boxes: Vec<[f32; 6]> = nodes.iter().map(|node| local_box(node, &origin)).collect();
        let moments: Vec<_> = surface.moments().iter().map(|m: &Moments| winding::pack(m, &origin)).collect();
        let corners: Vec<[f32; 9]> = (0..mesh.triangles.len())
            .map(|t| {
                let corners = mesh.corners(t).map(|corner| local(&corner, &origin));
                std::array::from_fn(|i| corners[i / 3][i % 3])
            })
            .collect();
        Ok(SurfaceOnDevice {
            surface,
            origin,
            nodes: nodes.len() as u32,
            turns: TURNS,
            links: device.upload("surface links", &links)?,
            boxes: device.upload("surface boxes", &boxes)?,
            moments: device.upload("surface moments", &moments)?,
            corners: device.upload("surface corners", &corners)?,
        })
    }

    /// The surface.
    pub fn surface(&self) -> &'a Surface {
        self.surface
    }

    /// The winding number around each point, as [`Surface::winding_number`] to within `f32`.
    ///
    /// # Errors
    /// A device's failure.
    pub fn winding_numbers(&self, device: &Device, points: &[Vec3]) -> Result<Vec<f32>, DeviceError> {
        let queries = self.queries(device, points)?;
        let cursors = device.zeros::<u32>("winding cursors", points.len())?;
        let sums = device.zeros::<f32>("winding sums", points.len())?;
        self.walk(points.len(), |walk| {
            let buffers: [&dyn crate::device::AnyBuffer; 6] =
                [&self.links, &self.moments, &self.corners, &queries, &cursors, &sums];
            device.run(&winding::WINDING, points.len(), walk, &buffers)
        })?;
        device.read(&sums)
    }

    /// The closest point to each point. The triangle is one whose distance is the least to
    /// within `f32` of the surface's size; the point on it is exact.
    ///
    /// # Errors
    /// A device's failure.
    pub fn closest(&self, device: &Device, points: &[Vec3]) -> Result<Vec<Closest>, DeviceError> {
        let queries = self.queries(device, points)?;
        let found = device.zeros::<[u32; 2]>("closest triangles", points.len())?;
        let squares = device.zeros::<f32>("closest distances", points.len())?;
        self.walk(points.len(), |walk| {
            let buffers: [&dyn crate::device::AnyBuffer; 6] =
                [&self.links, &self.boxes, &self.corners, &queries, &found, &squares];
            device.run(&closest::CLOSEST, points.len(), walk, &buffers)
        })?;
        let found = device.read(&found)?;
        Ok(points.par_iter().zip(&found).map(|(p, &[_, t])| self.on_triangle(p, t)).collect())
    }

    /// Cuts walks after `turns` nodes, which is not zero, for the test of their continuation.
    #[doc(hidden)]
    pub fn cut_after(mut self, turns: u32) -> Self {
        self.turns = turns;
        self
    }

    fn queries(&self, device: &Device, points: &[Vec3]) -> Result<Buffer<[f32; 3]>, DeviceError> {
        let points: Vec<[f32; 3]> = points.iter().map(|p| local(p, &self.origin)).collect();
        device.upload("surface queries", &points)
    }

    /// Runs a kernel as often as the longest possible walk needs.
    fn walk(
        &self,
        queries: usize,
        run: impl Fn(&Walk) -> Result<(), DeviceError>,
    ) -> Result<(), DeviceError> {
        for part in 0..self.nodes.div_ceil(self.turns).max(1) {
            let start = u32::from(part == 0);
            run(&Walk { queries: queries as u32, nodes: self.nodes, turns: self.turns, start })?;
        }
        Ok(())
    }

    fn on_triangle(&self, p: &Vec3, t: u32) -> Closest {
        if t == super::bvh::INNER {
            return Closest { point: *p, triangle: t, barycentric: [0.0; 3], distance: f64::INFINITY };
        }
        let corners = self.surface.mesh().corners(t as usize);
        let barycentric = triangle::closest(p, &corners);
        let point = triangle::at(&corners, &barycentric);
        Closest { point, triangle: t, barycentric, distance: (point - p).norm() }
    }
}

fn local(p: &Vec3, origin: &Vec3) -> [f32; 3] {
    let p = p - origin;
    [p.x as f32, p.y as f32, p.z as f32]
}

/// A box that holds the node's, rounded outward.
fn local_box(node: &Node, origin: &Vec3) -> [f32; 6] {
    let (lo, hi) = (local(&node.lo.into(), origin), local(&node.hi.into(), origin));
    std::array::from_fn(|i| if i < 3 { lo[i].next_down() } else { hi[i - 3].next_up() })
}
