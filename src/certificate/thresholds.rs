//! Which figures are too large, in words.

use serde::{Deserialize, Serialize};

use super::Certificate;

/// Limits; one that is broken makes a result not pass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Thresholds {
    /// Triangle pairs of garment and body beyond what the source outfit had.
    pub body_intersections_added: usize,
    /// Triangle pairs between garments beyond what the source outfit had.
    pub layer_intersections_added: usize,
    /// Triangle pairs within a garment beyond what the source outfit had.
    pub self_intersections_added: usize,
    /// Depth of a vertex inside the body [m].
    pub body_penetration_max_m: f64,
    /// Transfer gap at 99 percent of the area [m].
    pub gap_p99_m: f64,
    /// Flipped triangles in the refitted pattern.
    pub flipped_triangles: usize,
    /// Relative difference in length of sewn chains.
    pub seam_mismatch_max: f64,
    /// Deviation of a sewn vertex from where it is sewn [m].
    pub seam_gap_max_m: f64,
    /// Deviation of a vertex's weights from a sum of 1.
    pub weight_sum_error_max: f64,
    /// Difference of a weight across a seam.
    pub seam_weight_error_max: f64,
    /// Vertices of details on the wrong side of the proxy that they are bound to.
    pub details_inside: usize,
    /// Change of the distance between a detail's vertex and the proxy, relative to itself.
    pub detail_offset_change: f64,
    /// Whether the transfer must have converged.
    pub transfer_converged: bool,
    /// Whether every step of the drape must have converged.
    pub drape_converged: bool,
}

impl Default for Thresholds {
    fn default() -> Self {
        Thresholds {
            body_intersections_added: 0,
            layer_intersections_added: 0,
            self_intersections_added: 0,
            body_penetration_max_m: 2e-3,
            gap_p99_m: 2e-3,
            flipped_triangles: 0,
            seam_mismatch_max: 5e-3,
            seam_gap_max_m: 1e-4,
            weight_sum_error_max: 1e-5,
            seam_weight_error_max: 1e-6,
            details_inside: 0,
            detail_offset_change: 0.1,
            transfer_converged: true,
            drape_converged: true,
        }
    }
}

/// What the stages say of themselves; `None` where a stage did not run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageFigures {
    /// Transfer gap at 99 percent of the area [m].
    pub gap_p99_m: Option<f64>,
    /// Vertices of details on the wrong side of their proxy.
    pub details_inside: Option<usize>,
    /// Change of a detail's distance from its proxy, relative to itself.
    pub detail_offset_change: Option<f64>,
    /// Whether the transfer converged.
    pub transfer_converged: Option<bool>,
    /// Flipped triangles in the refitted pattern.
    pub flipped_triangles: Option<usize>,
    /// Relative difference in length of sewn chains.
    pub seam_mismatch_max: Option<f64>,
    /// Whether every step of the drape converged.
    pub drape_converged: Option<bool>,
}

impl Thresholds {
    /// What of `garment` is beyond the limits, a sentence each; empty if all is well.
    pub fn broken(&self, garment: &str, certificate: &Certificate, stages: &StageFigures) -> Vec<String> {
        let mut said = Vec::new();
        self.intersections(certificate, &mut said);
        self.lengths(certificate, stages, &mut said);
        self.ratios(certificate, stages, &mut said);
        self.details(stages, &mut said);
        if self.transfer_converged && stages.transfer_converged == Some(false) {
            said.push("the transfer did not converge".to_owned());
        }
        if self.drape_converged && stages.drape_converged == Some(false) {
            said.push("a step of the drape did not converge".to_owned());
        }
        said.into_iter().map(|sentence| format!("{garment}: {sentence}")).collect()
    }

    fn intersections(&self, c: &Certificate, said: &mut Vec<String>) {
        let counts = [
            (
                "meet the body",
                c.body_intersections,
                c.source_body_intersections,
                self.body_intersections_added,
            ),
            (
                "meet other garments",
                c.layer_intersections,
                c.source_layer_intersections,
                self.layer_intersections_added,
            ),
            (
                "meet within the garment",
                c.self_intersections,
                c.source_self_intersections,
                self.self_intersections_added,
            ),
        ];
        for (what, found, source, added) in counts {
            let limit = source.saturating_add(added);
            if found > limit {
                said.push(format!(
                    "{found} triangle pairs {what}; the limit is {limit} (the source outfit has {source})"
                ));
            }
        }
    }

    fn lengths(&self, c: &Certificate, stages: &StageFigures, said: &mut Vec<String>) {
        let lengths = [
            (
                "the deepest vertex is inside the body by",
                Some(c.body_penetration_max_m),
                self.body_penetration_max_m,
            ),
            (
                "the transfer's gap to the target body at 99 % of the area is",
                stages.gap_p99_m,
                self.gap_p99_m,
            ),
            ("the largest seam gap is", Some(c.seam_gap_max_m), self.seam_gap_max_m),
        ];
        for (what, found, limit) in lengths {
            if let Some(found) = found.filter(|&x| exceeds(x, limit)) {
                said.push(format!("{what} {:.3} mm; the limit is {} mm", found * 1e3, limit * 1e3));
            }
        }
    }

    fn details(&self, stages: &StageFigures, said: &mut Vec<String>) {
        if let Some(inside) = stages.details_inside.filter(|&n| n > self.details_inside) {
            let limit = self.details_inside;
            said.push(format!(
                "{inside} vertices of details are inside what they lie on; the limit is {limit}"
            ));
        }
        let change = stages.detail_offset_change.filter(|&x| exceeds(x, self.detail_offset_change));
        if let Some(found) = change {
            let (found, limit) = (found * 100.0, self.detail_offset_change * 100.0);
            said.push(format!(
                "the distance of a detail has changed by {found:.1} %; the limit is {limit} %"
            ));
        }
    }

    fn ratios(&self, c: &Certificate, stages: &StageFigures, said: &mut Vec<String>) {
        if let Some(flipped) = stages.flipped_triangles.filter(|&n| n > self.flipped_triangles) {
            let limit = self.flipped_triangles;
            said.push(format!("{flipped} triangles of the pattern are flipped; the limit is {limit}"));
        }
        let mismatch = stages.seam_mismatch_max.filter(|&x| exceeds(x, self.seam_mismatch_max));
        if let Some(found) = mismatch {
            let limit = self.seam_mismatch_max * 100.0;
            said.push(format!(
                "sewn edges differ in length by {:.3} %; the limit is {limit} %",
                found * 100.0
            ));
        }
        let weights = [
            ("the weights of a vertex miss a sum of 1 by", c.weight_sum_error_max, self.weight_sum_error_max),
            ("weights differ across a seam by", c.seam_weight_error_max, self.seam_weight_error_max),
        ];
        for (what, found, limit) in weights {
            if let Some(found) = found.filter(|&x| exceeds(x, limit)) {
                said.push(format!("{what} {found:.2e}; the limit is {limit:.0e}"));
            }
        }
    }
}

/// Whether a figure is beyond its limit; one that is not a number is.
fn exceeds(x: f64, limit: f64) -> bool {
    x.is_nan() || x > limit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clean_result_passes_and_limits_are_inclusive() {
        let limits = Thresholds::default();
        let at_limit = Certificate {
            body_intersections: 3,
            source_body_intersections: 3,
            body_penetration_max_m: limits.body_penetration_max_m,
            seam_gap_max_m: limits.seam_gap_max_m,
            weight_sum_error_max: Some(limits.weight_sum_error_max),
            ..Certificate::default()
        };
        assert!(limits.broken("Shirt", &at_limit, &StageFigures::default()).is_empty());
    }

    #[test]
    fn every_limit_that_is_broken_is_said_with_figure_and_limit() {
        let certificate = Certificate {
            body_intersections: 5,
            source_body_intersections: 2,
            layer_intersections: 1,
            self_intersections: 7,
            body_penetration_max_m: 0.00412,
            seam_gap_max_m: f64::NAN,
            weight_sum_error_max: Some(2e-5),
            seam_weight_error_max: Some(1e-3),
            ..Certificate::default()
        };
        let stages = StageFigures {
            gap_p99_m: Some(0.003),
            transfer_converged: Some(false),
            flipped_triangles: Some(1),
            seam_mismatch_max: Some(0.02),
            details_inside: Some(2),
            detail_offset_change: Some(0.25),
            drape_converged: Some(false),
        };
        let said = Thresholds::default().broken("Shirt", &certificate, &stages);
        let expected = [
            "Shirt: 5 triangle pairs meet the body; the limit is 2 (the source outfit has 2)",
            "Shirt: 1 triangle pairs meet other garments; the limit is 0 (the source outfit has 0)",
            "Shirt: 7 triangle pairs meet within the garment; the limit is 0 (the source outfit has 0)",
            "Shirt: the deepest vertex is inside the body by 4.120 mm; the limit is 2 mm",
            "Shirt: the transfer's gap to the target body at 99 % of the area is 3.000 mm; the limit is 2 mm",
            "Shirt: the largest seam gap is NaN mm; the limit is 0.1 mm",
            "Shirt: 1 triangles of the pattern are flipped; the limit is 0",
            "Shirt: sewn edges differ in length by 2.000 %; the limit is 0.5 %",
            "Shirt: the weights of a vertex miss a sum of 1 by 2.00e-5; the limit is 1e-5",
            "Shirt: weights differ across a seam by 1.00e-3; the limit is 1e-6",
            "Shirt: 2 vertices of details are inside what they lie on; the limit is 0",
            "Shirt: the distance of a detail has changed by 25.0 %; the limit is 10 %",
            "Shirt: the transfer did not converge",
            "Shirt: a step of the drape did not converge",
        ];
        assert_eq!(said, expected);
    }

    #[test]
    fn settings_read_with_defaults_and_refuse_unknown_keys() {
        let read: Thresholds = serde_json::from_str(r#"{"gap_p99_m": 0.005}"#).expect("known key");
        assert_eq!(read, Thresholds { gap_p99_m: 0.005, ..Thresholds::default() });
        assert!(serde_json::from_str::<Thresholds>(r#"{"gap_p98_m": 0.005}"#).is_err());
    }
}
