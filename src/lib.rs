//! dressform fits outfits to characters.
//!
//! An outfit is authored once, on a source body: 3D garments with their 2D sewing-pattern
//! panels and seams. This crate **transfers** each garment to a target body, **refits** its
//! pattern, **drapes** the layers one after the other, **rigs** them, and **certifies** what
//! was achieved. It knows no Python and no USD: SI arrays go in and come out.
//!
//! # Units and frames
//! Metres, kilograms, seconds, newtons. Right-handed, Y up, gravity along -Y. Panel
//! coordinates are metres with x along the warp and y along the weft. Positions are `f64`
//! on the host; on a device they are `f32` displacements from an `f64` reference.
//!
//! # The data's way
//! `model -> device -> geometry, solve -> pose -> certificate -> transfer -> pattern -> proxy ->
//! drape -> rig -> pipeline`: a module imports only from its left.

pub mod certificate;
pub mod device;
pub mod drape;
pub mod geometry;
pub mod measure;
pub mod model;
pub mod pattern;
pub mod pipeline;
pub mod pose;
pub mod proxy;
pub mod rig;
pub mod solve;
pub mod transfer;

/// Every kernel of the crate, for the tests that validate shaders and compare twins.
pub fn kernels() -> Vec<&'static device::Kernel> {
    [
        geometry::bulk::KERNELS,
        solve::vector::KERNELS,
        solve::cg::KERNELS,
        solve::bsr::KERNELS,
        solve::dense::KERNELS,
        transfer::KERNELS,
        drape::elastic::KERNELS,
        drape::contact::KERNELS,
    ]
    .concat()
}
