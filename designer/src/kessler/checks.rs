//! Checks of built layouts: threats must be visible in time, and decoys must be safe to ignore and tempting.

use env_core::admission::{SuccessRule, is_success};
use env_core::bracket::Bracket;
use env_core::critique::Verdict;
use env_core::kessler::constants::FAIR_STEPS;
use env_core::log::Precision;
use env_core::rollout::roll_out;
use env_core::{ActionLog, Scenario, StopReason};

use super::agents::{Weakness, agent};
use crate::field_error::FieldError;

/// Fuel that the nervous agent must waste on decoys for the layout to be tempting.
const MIN_WASTED_FUEL: f64 = 1.0;

/// Checks that debris that hits a holding satellite hits no earlier than step 3, and is visible while a burn can still avoid
/// it. Fragments of an earlier collision are ignored.
///
/// # Errors
/// Returns an error with the satellite that is hit, the step, and a way to fix the layout.
pub(super) fn check_visibility(scenario: &Scenario) -> Result<(), FieldError> {
    let mut hold = ActionLog::new(scenario.task().action_space().dim(), Precision::F64);
    hold.stopped = Some(StopReason::TooLate);
    // The admission check reports an unfair start in its own words.
    let Ok(critique) = scenario.task().critique(scenario, &hold) else { return Ok(()) };
    let hits = critique.failures.iter().filter(|failure| matches!(failure.mode, "collision" | "rogue"));
    for failure in hits {
        let Some(encounter) = &failure.encounter else { continue };
        let (satellite, step) = (failure.agent, failure.step);
        let message = match (encounter.first_visible_step, encounter.avoidable) {
            _ if step <= FAIR_STEPS => {
                format!(
                    "satellite {satellite} is hit at step {step}, before the agent could act; choose a later step"
                )
            }
            (None, _) => format!(
                "satellite {satellite} is hit at step {step} by debris that was never visible; choose a slower pass, or a \
                 rogue that becomes visible before"
            ),
            (Some(first), Some(false)) => format!(
                "satellite {satellite} is hit at step {step} by debris that is visible from step {first}, too late for any \
                 burn to avoid it; choose a slower pass"
            ),
            _ => continue,
        };
        return Err(FieldError::new("encounters", message));
    }
    Ok(())
}

/// Checks that holding succeeds and loses no satellite, and that a nervous agent wastes fuel.
///
/// # Errors
/// Returns the condition that is not met, or the field of the scenario that keeps an agent from running it.
pub(super) fn check_decoy(scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError> {
    let hold = &bracket.panel[0];
    if hold.lost > 0 || !is_success(scenario, SuccessRule::Task, bracket, hold) {
        let message = format!(
            "a decoy must not hit, but holding loses {} of the satellites; choose larger miss distances",
            hold.lost
        );
        return Err(FieldError::new("encounters", message));
    }
    let wasted = fuel_wasted_by_nervous_agent(scenario)?;
    if wasted < MIN_WASTED_FUEL {
        let message = format!(
            "a nervous agent must waste at least {MIN_WASTED_FUEL} fuel, but wastes {wasted:.1}; choose smaller miss \
             distances of the decoys"
        );
        return Err(FieldError::new("encounters", message));
    }
    Ok(())
}

/// Returns the fuel of all burns of the nervous agent that were not needed.
fn fuel_wasted_by_nervous_agent(scenario: &Scenario) -> Result<f64, FieldError> {
    let mut nervous = agent(Weakness::Nervous, scenario).map_err(cannot_run)?;
    let log = roll_out(scenario, &mut *nervous).map_err(cannot_run)?.log;
    let critique = scenario.task().critique(scenario, &log).map_err(cannot_run)?;
    let wasted = critique.actions.iter().filter(|action| action.verdict != Verdict::Needed);
    // The sum of no burns is −0.
    Ok(wasted.map(|action| action.cost).sum::<f64>() + 0.0)
}

#[expect(clippy::needless_pass_by_value, reason = "the signature that map_err takes")]
fn cannot_run(error: impl ToString) -> FieldError {
    FieldError::new("layout", error.to_string())
}
