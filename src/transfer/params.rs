//! Settings of the transfer.

use serde::{Deserialize, Serialize};

use super::Error;

/// Settings of the transfer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Params {
    /// Side of a grid cell [m].
    pub cell: f64,
    /// Width of the narrow band outside of the body [m]; at least two cells.
    pub band: f64,
    /// The band's stiffness fades out within this of its outer end [m]; not wider than the band.
    pub fade: f64,
    /// Viscosity; its unit is that of `1 / gamma`.
    pub nu: f64,
    /// Compliance of the volume term.
    pub gamma: f64,
    /// Penalty of the boundary condition, over `nu`'s unit [1/m^2].
    pub beta: f64,
    /// Boundary quadrature points along each axis of a cut cell.
    pub quadrature: usize,
    /// Most iterations of the inner loop.
    pub inner_iterations: usize,
    /// The inner loop ends when no node moves farther than this [m].
    pub inner_tolerance: f64,
    /// Most conjugate gradient iterations for each increment of the inner loop. One is best:
    /// the inner loop combines increments as well as the conjugate gradients would.
    pub cg_iterations: usize,
    /// Their tolerance, relative to the increment's own right-hand side.
    pub cg_tolerance: f64,
    /// Solve every inner loop until its residual, judged in double precision on the host, is
    /// below 1e-8 of that of no displacement: a reference for tests, at several times the cost.
    pub exact: bool,
    /// Outer iterations with the whole band. The next one solves the last of them once more with
    /// cells `refinement` times smaller in `refined_band`; those after it close what is left at the skin.
    pub coarse_iterations: usize,
    /// Width outside of the body of the band of finer cells [m]; at least two of their size. With 3 cm
    /// cloth beyond is twice as far from the field of fine cells.
    pub refined_band: f64,
    /// How many times smaller the cells near the skin are; 1 leaves refinement out.
    pub refinement: usize,
    /// Most iterations of the outer loop.
    pub outer_iterations: usize,
    /// The outer loop ends when the 99th percentile of the outer skin's gap is below [m].
    pub gap_p99: f64,
    /// The 99th percentile of the gap near garments up to which the transfer counts as
    /// converged [m].
    pub gap_accepted: f64,
    /// Skin within this distance of a garment counts for the garment's gap [m].
    pub near: f64,
    /// A target whose limbs are turned against the source's by more than this is taken to the
    /// source's pose first, and its garments are brought back [degrees]; 180 never does so.
    pub unpose: f64,
}

impl Default for Params {
    fn default() -> Self {
        Params {
            cell: 0.02,
            band: 0.16,
            fade: 0.10,
            nu: 100.0,
            gamma: 0.01,
            beta: 1e6,
            quadrature: 2,
            inner_iterations: 30,
            inner_tolerance: 1e-4,
            cg_iterations: 1,
            cg_tolerance: 1e-1,
            exact: false,
            coarse_iterations: 1,
            refined_band: 0.05,
            refinement: 4,
            outer_iterations: 10,
            gap_p99: 4e-4,
            gap_accepted: 2e-3,
            near: 0.08,
            unpose: 15.0,
        }
    }
}

impl Params {
    pub(super) fn validate(&self) -> Result<(), Error> {
        let positive = [
            ("cell", self.cell),
            ("nu", self.nu),
            ("gamma", self.gamma),
            ("beta", self.beta),
            ("inner_tolerance", self.inner_tolerance),
            ("cg_tolerance", self.cg_tolerance),
            ("gap_p99", self.gap_p99),
            ("gap_accepted", self.gap_accepted),
            ("near", self.near),
            ("quadrature", self.quadrature as f64),
            ("inner_iterations", self.inner_iterations as f64),
            ("cg_iterations", self.cg_iterations as f64),
            ("outer_iterations", self.outer_iterations as f64),
            ("coarse_iterations", self.coarse_iterations as f64),
            ("refinement", self.refinement as f64),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::Setting { name, value, expected: "must be positive" });
            }
        }
        if !(0.0..=180.0).contains(&self.unpose) {
            let value = self.unpose;
            return Err(Error::Setting { name: "unpose", value, expected: "between 0 and 180" });
        }
        if !(self.band >= 2.0 * self.cell && self.band.is_finite()) {
            return Err(Error::Setting { name: "band", value: self.band, expected: "at least two cells" });
        }
        if !(0.0..=self.band).contains(&self.fade) {
            let value = self.fade;
            return Err(Error::Setting { name: "fade", value, expected: "between 0 and the band's width" });
        }
        if !(self.refined_band >= 2.0 * self.cell / self.refinement as f64 && self.refined_band.is_finite()) {
            let (name, value) = ("refined_band", self.refined_band);
            return Err(Error::Setting { name, value, expected: "at least two of the finer cells" });
        }
        if self.refinement > 8 {
            let value = self.refinement as f64;
            return Err(Error::Setting { name: "refinement", value, expected: "at most 8" });
        }
        if self.quadrature > 8 {
            let value = self.quadrature as f64;
            return Err(Error::Setting { name: "quadrature", value, expected: "at most 8" });
        }
        Ok(())
    }
}
