//! Wasted fuel, in the task whose score counts fuel.

use super::analysis::EpisodeAnalysis;
use super::failure_mode::KesslerFailureMode;
use crate::critique::{ActionVerdict, Failure, Measure, Verdict};
use crate::kessler::constants::SATELLITES;
use crate::kessler::reward::Objective;

/// Finds at most one failure per satellite: its wasteful burns together, at the step of the first.
pub(super) fn find(analysis: &EpisodeAnalysis<'_>) -> Vec<Failure> {
    if analysis.objective != Objective::EcoStation {
        return Vec::new();
    }
    (0..SATELLITES as u32)
        .filter_map(|agent| {
            let is_wasteful = |v: &ActionVerdict| v.agent == agent && v.verdict == Verdict::Wasteful;
            let first = analysis.verdicts.iter().find(|v| is_wasteful(v))?;
            let burns = analysis.verdicts.iter().filter(|v| is_wasteful(v)).count();
            let totals = analysis.total_burns(is_wasteful);
            Some(Failure {
                mode: KesslerFailureMode::WastedFuel.name(),
                agent,
                step: first.step,
                encounter: None,
                orbit_angle_deg: None,
                measures: vec![
                    Measure::new("fuel", totals.cost, "fuel"),
                    Measure::new("burns", burns as f64, ""),
                    Measure::new("score", -totals.gain, ""),
                ],
                explanation: format!(
                    "Satellite {agent} spent {:.2} fuel in {} that gained nothing and cost {:.3} of the score.",
                    totals.cost,
                    if burns == 1 { "one burn".to_owned() } else { format!("{burns} burns") },
                    -totals.gain
                ),
            })
        })
        .collect()
}
