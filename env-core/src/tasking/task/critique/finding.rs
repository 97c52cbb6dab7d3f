//! Findings of the modes, from which failures are made.

use super::trace::TaskingTrace;
use crate::critique::{Failure, Measure};

/// Findings of a mode that are kept of each satellite: those with the largest losses.
pub(super) const MAX_FINDINGS: usize = 16;

/// A failure before its step and its orbit angle are looked up.
#[derive(Debug, Clone)]
pub(super) struct Finding {
    /// Name of the failure mode.
    pub mode: &'static str,
    /// Number of the satellite.
    pub agent: usize,
    /// Tick of the loss.
    pub tick: u64,
    /// Orbit angle of the loss, degrees; `None` for that of the satellite at the tick.
    pub orbit_angle_deg: Option<f64>,
    /// Size of the loss, comparable within the mode.
    pub loss: f64,
    /// Values with their units.
    pub measures: Vec<Measure>,
    /// Description of what was lost and what would have helped.
    pub explanation: String,
}

impl Finding {
    /// The failure that this finding describes.
    pub(super) fn into_failure(self, trace: &TaskingTrace) -> Failure {
        let angle = || trace.satellites[self.agent].orbit_angle_deg(self.tick);
        Failure {
            mode: self.mode,
            agent: self.agent as u32,
            step: trace.step_at(self.tick),
            encounter: None,
            orbit_angle_deg: Some(self.orbit_angle_deg.unwrap_or_else(angle)),
            measures: self.measures,
            explanation: self.explanation,
        }
    }
}

/// Keeps the findings of one mode and satellite with the largest losses, in their order.
pub(super) fn keep_largest(findings: Vec<Finding>) -> Vec<Finding> {
    let mut losses: Vec<f64> = findings.iter().map(|finding| finding.loss).collect();
    losses.sort_by(|a, b| b.total_cmp(a));
    let least = losses.get(MAX_FINDINGS - 1).copied().unwrap_or(f64::NEG_INFINITY);
    findings.into_iter().filter(|finding| finding.loss >= least).take(MAX_FINDINGS).collect()
}
