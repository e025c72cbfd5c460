//! Fabrics in real units.

use serde::{Deserialize, Serialize};

/// Mechanical properties of a cloth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fabric {
    /// Name for the report.
    pub name: String,
    /// Area density [kg/m^2].
    pub density: f64,
    /// Membrane stiffness along the warp [N/m].
    pub stretch_warp: f64,
    /// Membrane stiffness along the weft [N/m].
    pub stretch_weft: f64,
    /// Membrane stiffness against shear [N/m].
    pub shear: f64,
    /// Bending stiffness about the weft, for curvature along the warp [N m].
    pub bending_warp: f64,
    /// Bending stiffness for curvature along the weft [N m].
    pub bending_weft: f64,
    /// Bending stiffness for twist [N m].
    pub bending_shear: f64,
    /// Coulomb friction coefficient against skin and cloth.
    pub friction: f64,
    /// Thickness [m].
    pub thickness: f64,
}

/// Presets by name. Weights are typical of the kind. Bending stiffness is chosen, within what is
/// measured on fabrics of that weight, so that a disc hangs as the kind is known to in Cusick's drape
/// test (`benches/cusick.rs`; jersey, which is not in that list, is not). Membrane stiffness is that of
/// small strains, where cloth that hangs is (denim's warp and shear as [Wang 2011] measured them), and
/// not the several times higher one under the loads of tensile tests. docs/drape.md has the sources.
const PRESETS: &[(&str, [f64; 9])] = &[
    // density, warp, weft, shear, bend warp, bend weft, bend shear, friction, thickness
    ("cotton", [0.15, 1200.0, 900.0, 60.0, 1.2e-5, 9.5e-6, 6.8e-6, 0.4, 0.5e-3]),
    ("silk", [0.07, 290.0, 225.0, 10.0, 1.9e-6, 1.5e-6, 1.0e-6, 0.25, 0.2e-3]),
    ("wool", [0.25, 700.0, 500.0, 40.0, 1.2e-5, 1.0e-5, 6.0e-6, 0.45, 0.9e-3]),
    ("denim", [0.40, 1050.0, 700.0, 75.0, 6.6e-5, 4.4e-5, 3.3e-5, 0.5, 0.9e-3]),
    ("leather", [0.60, 4000.0, 4000.0, 600.0, 2.9e-5, 2.9e-5, 2.3e-5, 0.6, 1.0e-3]),
    ("jersey", [0.18, 250.0, 180.0, 40.0, 3.0e-6, 2.5e-6, 1.5e-6, 0.4, 0.6e-3]),
];

impl Fabric {
    /// The preset of that name (case-insensitive), if there is one.
    pub fn preset(name: &str) -> Option<Fabric> {
        let key = name.to_ascii_lowercase();
        PRESETS.iter().find(|(preset, _)| *preset == key).map(|(preset, v)| Fabric {
            name: (*preset).to_owned(),
            density: v[0],
            stretch_warp: v[1],
            stretch_weft: v[2],
            shear: v[3],
            bending_warp: v[4],
            bending_weft: v[5],
            bending_shear: v[6],
            friction: v[7],
            thickness: v[8],
        })
    }
}

impl Default for Fabric {
    /// Cotton.
    fn default() -> Self {
        Fabric::preset("cotton").expect("cotton is a preset")
    }
}
