//! The pattern of the details.
//!
//! A detail's panel is refitted to the detail's bound shape on the transferred proxy, by the same
//! energy as the proxy's panels: on its own body it stays what it was, on a front that is scaled
//! it is scaled likewise. The proxy's panels do not depend on what lies on them. Only where a
//! detail's edge is sewn to an edge of the proxy (a pocket caught in a side seam) must the two
//! lengths agree, and the garment is refitted as a whole.

use super::Proxy;
use crate::model::{Vec2, Vec3};
use crate::pattern::{self, Error, Holding, Info};

impl Proxy<'_> {
    /// Refits the pattern of the proxy carried to `points` [m], shape `[vertices of the proxy, 3]`.
    ///
    /// A girth in `holding` keeps its ease.
    ///
    /// Returns the panel coordinates of the whole garment [m], shape `[vertices, 2]`.
    ///
    /// # Errors
    /// See [`pattern::Error`].
    pub fn refit(
        &self,
        points: &[Vec3],
        params: &pattern::Params,
        holding: Option<&Holding<'_>>,
    ) -> Result<(Vec<Vec2>, Info), Error> {
        let whole = self.whole;
        let Some(split) = &self.split else { return pattern::run_holding(whole, points, params, holding) };
        let lifted = self.lift(points);
        if whole.chains().iter().any(|c| self.is_detail(c.panel_a) != self.is_detail(c.panel_b)) {
            return pattern::run_holding(whole, &lifted, params, holding);
        }
        let (shell, mut info) = pattern::run_holding(&split.shell.garment, points, params, holding)?;
        let target = super::part::pick(&lifted, &split.details.vertices);
        let (details, more) = pattern::run(&split.details.garment, &target, params)?;
        let mut pattern = vec![Vec2::zeros(); whole.points.len()];
        for (part, own) in [(&split.shell, &shell), (&split.details, &details)] {
            part.vertices.iter().zip(own).for_each(|(&v, p)| pattern[v as usize] = *p);
        }
        let change = pattern::frame::strain_change(whole, &pattern, &lifted, [0.5, 0.99])?;
        info.strain_change_p50 = change[0];
        info.strain_change_p99 = change[1];
        info.iterations += more.iterations;
        info.residual = info.residual.max(more.residual);
        info.converged &= more.converged;
        info.length_residual = info.length_residual.max(more.length_residual);
        info.shape_residual = info.shape_residual.max(more.shape_residual);
        info.step_residual_m = info.step_residual_m.max(more.step_residual_m);
        info.bounds_held += more.bounds_held;
        info.shape = info.shape.worst(&more.shape);
        info.seam_mismatch_max = info.seam_mismatch_max.max(more.seam_mismatch_max);
        info.chains += more.chains;
        info.flipped_triangles += more.flipped_triangles;
        info.crumpled_triangles += more.crumpled_triangles;
        info.repaired = info.repaired.max(more.repaired);
        info.area_ratio =
            pattern::pattern_area(whole, &pattern) / pattern::pattern_area(whole, &whole.pattern);
        Ok((pattern, info))
    }

    fn is_detail(&self, panel: u32) -> bool {
        let details = self.split.as_ref().map(|split| &split.details.garment.panel_of_triangle);
        details.is_some_and(|panels| panels.contains(&panel))
    }

    /// The proxy's part of figures of the whole's vertices.
    pub fn gather<T: Copy>(&self, of_whole: &[T]) -> Vec<T> {
        match &self.split {
            Some(split) => super::part::pick(of_whole, &split.shell.vertices),
            None => of_whole.to_vec(),
        }
    }
}
