//! The flow of one outer iteration: which cells, which penalty, and the solves.

use super::activity::{self, Active, Band, narrow_band};
use super::boundary::Boundary;
use super::domain::{Domain, Lattice};
use super::field::{Field, InnerInfo, Problem};
use super::refine::Overlay;
use super::{Error, Params};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::Vec3;

/// Where the lattice starts in each outer iteration, in cells along the diagonal: what one
/// lattice cannot represent the next one may (p99 gap of a heavy man 1.5 mm without, 1.1 with).
const SHIFTS: [f64; 4] = [0.0, 0.5, 0.25, 0.75];

/// What a flow is solved with.
pub(super) struct Turn<'a> {
    pub device: &'a Device,
    pub params: &'a Params,
    /// Of the outer iteration, from 1.
    pub number: usize,
}

impl Turn<'_> {
    /// The flow that moves the points of `surface` by `displacement` [m], in the whole band.
    pub fn solve(&self, surface: &Surface, displacement: &[Vec3]) -> Result<(Field, InnerInfo), Error> {
        let params = self.params;
        let (domain, active) = self.band(surface)?;
        let boundary = Boundary::new(&domain, surface, displacement, &active, params.beta, params.quadrature);
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let mut problem = Problem::new(self.device, params, &domain, boundary, &[], &u)?;
        let mut info = problem.solve(&mut u)?;
        info.then(problem.solve_augmented(&mut u)?);
        drop(problem);
        self.check(&u)?;
        Ok((Field { domain, displacement: u }, info))
    }

    /// The flow of `coarse` on finer cells near the surface; further out `coarse` is brought
    /// into line with it. Arguments as for [`Turn::solve`]; finer cells keep `beta h^2 / nu`.
    pub fn refine(
        &self,
        surface: &Surface,
        displacement: &[Vec3],
        coarse: &mut Field,
    ) -> Result<(Field, InnerInfo), Error> {
        let params = self.params;
        let fine = Overlay::new(&coarse.domain, surface, params.refinement as i32, params.refined_band)?;
        let beta = params.beta * (params.refinement as f64).powi(2);
        let boundary =
            Boundary::new(&fine.domain, surface, displacement, &fine.active, beta, params.quadrature);
        let mut u = fine.interpolate(coarse);
        let mut problem = Problem::new(self.device, params, &fine.domain, boundary, &fine.rim, &u)?;
        let mut info = problem.solve(&mut u)?;
        info.then(problem.solve_augmented(&mut u)?);
        info.then(self.solve_outside(coarse, &fine, &u)?);
        let outside = fine.interpolate(coarse);
        u.iter_mut().zip(outside).zip(&fine.rim).filter(|(_, rim)| **rim).for_each(|((u, at), _)| *u = at);
        info.then(problem.solve_augmented(&mut u)?);
        drop(problem);
        self.check(&u)?;
        Ok((Field { domain: fine.domain, displacement: u }, info))
    }

    /// Solves the coarse field where the fine one `u` does not reach.
    fn solve_outside(&self, coarse: &mut Field, fine: &Overlay, u: &[Vec3]) -> Result<InnerInfo, Error> {
        let held = fine.hold(&coarse.domain, u, &mut coarse.displacement);
        let (domain, start, none) = (&coarse.domain, &coarse.displacement, Boundary::default());
        let problem = Problem::new(self.device, self.params, domain, none, &held, start)?;
        let info = problem.solve(&mut coarse.displacement)?;
        Ok(info)
    }

    fn check(&self, u: &[Vec3]) -> Result<(), Error> {
        let finite = u.iter().all(|u| u.iter().all(|c| c.is_finite()));
        if finite { Ok(()) } else { Err(Error::Diverged { outer: self.number }) }
    }

    /// The narrow band around `surface`.
    fn band(&self, surface: &Surface) -> Result<(Domain, Vec<Active>), Error> {
        let Params { cell, band: width, fade, .. } = *self.params;
        let (lo, hi) = surface.mesh().bounds().ok_or(Error::Empty)?;
        let origin = lo.add_scalar(-cell * SHIFTS[self.number % SHIFTS.len()]);
        let lattice = Lattice { origin, cell };
        Domain::check_size((hi - lo).add_scalar(2.0 * width) / cell)?;
        let active = narrow_band(surface, lattice, Band { width, fade }, &lo, &hi);
        Ok((activity::domain(lattice, &active)?, active))
    }
}
