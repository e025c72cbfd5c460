//! drape

pub mod cloth;
pub mod elastic;
