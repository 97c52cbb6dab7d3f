//! Critique of an episode: why it lost score, with the geometry of each loss; what each burn was worth, by
//! the same episode without it; and a deterministic judgement. `docs/reference/critique.md` has the definitions and the
//! numbers.
//!
//! Start reading at [`critique`]. `analysis` holds all that the critique is computed from: `trace` replays
//! the episode on the engine, `counterfactuals` flies single satellites again under changed burns,
//! `visibility` knows where debris is and since when it is visible. The other modules find failures, verdicts
//! and judgements.

mod analysis;
mod counterfactuals;
mod encounter;
mod episode_judgement;
mod failure_mode;
mod formation_goal;
mod fuel_starvation;
mod losses;
mod remedy;
mod rendezvous_goal;
mod step_judgement;
mod trace;
mod verdicts;
mod visibility;
mod wasted_fuel;

use self::analysis::analyze;
pub(super) use self::failure_mode::{KESSLER_SPEED_BANDS, failure_modes};
use super::reward::Objective;
use crate::critique::{Critique, Judgement};
use crate::error::ReplayError;
use crate::log::{ActionLog, StopReason};
use crate::task::Scenario;

/// Computes the critique of an episode.
///
/// # Errors
/// Returns [`ReplayError`] if the log cannot be replayed on the scenario.
pub(super) fn critique(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
) -> Result<Critique, ReplayError> {
    analyze(objective, scenario, log, |analysis| {
        let losses = losses::find(analysis);
        let mut failures: Vec<_> = fuel_starvation::find(analysis, &losses);
        let starved: Vec<u32> = failures.iter().map(|failure| failure.agent).collect();
        let assessment = episode_judgement::judge(analysis, &losses, &starved);
        failures.extend(losses.into_iter().map(|loss| loss.failure));
        failures.extend(rendezvous_goal::find(analysis));
        failures.extend(formation_goal::find(analysis));
        failures.extend(wasted_fuel::find(analysis));
        failures.sort_by_key(|failure| (failure.step, failure.agent));
        Critique { failures, actions: analysis.verdicts.to_vec(), assessment }
    })
}

/// Judges the last step of a log, as if no satellite burnt after it.
///
/// # Errors
/// Returns [`ReplayError`] if the log cannot be replayed on the scenario.
pub(super) fn judge_step(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
) -> Result<Judgement, ReplayError> {
    let mut held = log.clone();
    held.stopped = Some(StopReason::TooLate);
    analyze(objective, scenario, &held, |analysis| {
        step_judgement::judge(analysis, &losses::find(analysis), log.len() as u32)
    })
}
