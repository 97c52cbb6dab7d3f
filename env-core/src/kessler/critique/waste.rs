//! Fuel spent for nothing where fuel is score.

use super::Case;
use super::mode::Mode;
use crate::critique::{Failure, Measure, Verdict};
use crate::kessler::constants::SATELLITES;
use crate::kessler::reward::Objective;

/// At most one a satellite: its wasteful burns together, at the step of the first.
pub(super) fn all(case: &Case<'_>) -> Vec<Failure> {
    if case.objective != Objective::EcoStation {
        return Vec::new();
    }
    (0..SATELLITES as u32)
        .filter_map(|agent| {
            let wasteful = |v: &crate::critique::ActionVerdict| {
                v.agent == agent && v.verdict == Verdict::Wasteful
            };
            let first = case.verdicts.iter().find(|v| wasteful(v))?;
            let burns = case.verdicts.iter().filter(|v| wasteful(v)).count();
            let (cost, gain) = case.spent(wasteful);
            Some(Failure {
                mode: Mode::WastedFuel.name(),
                agent,
                step: first.step,
                encounter: None,
                measures: vec![
                    Measure { name: "fuel", value: cost, unit: "fuel" },
                    Measure { name: "burns", value: burns as f64, unit: "" },
                    Measure { name: "score", value: -gain, unit: "" },
                ],
                words: format!(
                    "Satellite {agent} spent {cost:.2} fuel in {} that gained nothing and cost {:.3} of the score.",
                    if burns == 1 { "one burn".to_owned() } else { format!("{burns} burns") },
                    -gain
                ),
            })
        })
        .collect()
}
