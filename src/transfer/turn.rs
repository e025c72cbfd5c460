//! One outer iteration: which cells, which penalty, and the solves.

use super::activity::{self, Active, Band, narrow_band};
use super::boundary::Boundary;
use super::domain::{Domain, Lattice};
use super::field::{Field, InnerInfo, Problem};
use super::refine::{Overlay, rim};
use super::{Error, Params};
use crate::device::Device;
use crate::geometry::Surface;
use crate::model::Vec3;

/// Where the lattice starts in each outer iteration, in cells along the diagonal: what one
/// lattice cannot represent the next one may (p99 gap of a heavy man 1.5 mm without, 1.1 with).
const SHIFTS: [f64; 4] = [0.0, 0.5, 0.25, 0.75];

/// What an outer iteration does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Work {
    /// Solves the flow in the whole band.
    Band,
    /// Closes what is left near the skin with the band's cells.
    TryClosing,
    /// Solves the last flow of the whole band once more, with finer cells near the skin.
    Refine,
    /// Closes what is left near the skin with the finer cells.
    Close,
}

impl Work {
    /// Whether it only closes what other iterations left.
    pub fn closes(self) -> bool {
        matches!(self, Work::TryClosing | Work::Close)
    }
}

/// What one outer iteration is solved with.
pub(super) struct Turn<'a> {
    device: &'a Device,
    params: &'a Params,
    /// From 1.
    number: usize,
    pub work: Work,
    cell: f64,
    beta: f64,
}

impl<'a> Turn<'a> {
    /// Outer iteration `number`, from 1; `first` if the body is still where it was. Finer cells
    /// keep `beta h^2 / nu`.
    pub fn new(device: &'a Device, params: &'a Params, number: usize, work: Work, first: bool) -> Turn<'a> {
        let finer = matches!(work, Work::Refine | Work::Close);
        let refinement = if finer { params.refinement as f64 } else { 1.0 };
        let stiffening = if first { 1.0 } else { params.stiffening };
        Turn {
            device,
            params,
            number,
            work,
            cell: params.cell / refinement,
            beta: params.beta * stiffening * refinement * refinement,
        }
    }

    /// The flow that moves the points of `surface` by `displacement` [m].
    pub fn solve(&self, surface: &Surface, displacement: &[Vec3]) -> Result<(Field, InnerInfo), Error> {
        let (domain, active) = self.band(surface)?;
        let fixed = if self.work.closes() { rim(&domain, &active) } else { Vec::new() };
        let boundary = self.boundary(&domain, surface, displacement, &active);
        let mut u = vec![Vec3::zeros(); domain.nodes.len()];
        let mut problem = Problem::new(self.device, self.params, &domain, boundary, &fixed, &u)?;
        let mut info = problem.solve(&mut u)?;
        if self.work == Work::Band {
            info.then(problem.solve_augmented(&mut u)?);
        }
        drop(problem);
        self.check(&u)?;
        Ok((Field { domain, displacement: u }, info))
    }

    /// The flow of `coarse` on finer cells near the surface; further out `coarse` is brought
    /// into line with it. Arguments as for [`Turn::solve`].
    pub fn refine(
        &self,
        surface: &Surface,
        displacement: &[Vec3],
        coarse: &mut Field,
    ) -> Result<(Field, InnerInfo), Error> {
        let params = self.params;
        let fine = Overlay::new(&coarse.domain, surface, params.refinement as i32, params.refined_band)?;
        let boundary = self.boundary(&fine.domain, surface, displacement, &fine.active);
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

    fn boundary(
        &self,
        domain: &Domain,
        surface: &Surface,
        displacement: &[Vec3],
        active: &[Active],
    ) -> Boundary {
        Boundary::new(domain, surface, displacement, active, self.beta, self.params.quadrature)
    }

    /// The narrow band around `surface`.
    fn band(&self, surface: &Surface) -> Result<(Domain, Vec<Active>), Error> {
        let (width, fade) = match self.work.closes() {
            true => (self.params.closing_band, 0.0),
            false => (self.params.band, self.params.fade),
        };
        let (lo, hi) = surface.mesh().bounds().ok_or(Error::Empty)?;
        let origin = lo.add_scalar(-self.cell * SHIFTS[self.number % SHIFTS.len()]);
        let lattice = Lattice { origin, cell: self.cell };
        Domain::check_size((hi - lo).add_scalar(2.0 * width) / self.cell)?;
        let active = narrow_band(surface, lattice, Band { width, fade }, &lo, &hi);
        Ok((activity::domain(lattice, &active)?, active))
    }
}
