//! Fuel starvation: burns that were rejected although they would have helped, or a threat that a full tank
//! would have avoided.

use super::analysis::EpisodeAnalysis;
use super::failure_mode::KesslerFailureMode;
use super::losses::SatelliteLoss;
use super::remedy::{LossToAvoid, find_remedy};
use crate::critique::{Failure, Measure};
use crate::kessler::constants::{FUEL_PER_SPEED, GOAL_THRESHOLD, MAX_BURN, SATELLITES};

/// Smallest improvement of the goal that counts as help.
const MIN_GOAL_GAIN: f64 = 0.05;

/// Finds at most one failure per satellite.
pub(super) fn find(analysis: &EpisodeAnalysis<'_>, losses: &[SatelliteLoss]) -> Vec<Failure> {
    (0..SATELLITES)
        .filter_map(|satellite| {
            let loss = losses.iter().find(|loss| loss.satellite == satellite);
            rejected_burns_failure(analysis, satellite).or_else(|| low_fuel_failure(analysis, loss?))
        })
        .collect()
}

/// Failure if the rejected burns of this satellite, had they been applied, would have saved a satellite or
/// improved the goal.
fn rejected_burns_failure(analysis: &EpisodeAnalysis<'_>, satellite: usize) -> Option<Failure> {
    let is_counted =
        |burn: &&super::trace::RejectedBurn| burn.satellite == satellite && burn.cost.is_finite();
    let mut rejected = analysis.trace.rejected.iter().filter(is_counted);
    let first = rejected.next()?;
    let count = 1 + rejected.count();
    let outcome = analysis.outcome();
    let missed_goal = outcome.goal.is_some_and(|goal| goal < GOAL_THRESHOLD);
    if outcome.lost == 0 && !missed_goal {
        return None;
    }
    let counterfactuals = analysis.counterfactuals;
    let unlimited =
        counterfactuals.outcome_with(satellite, &counterfactuals.with_unlimited_fuel(satellite)).outcome;
    let goal_gain = unlimited.goal.unwrap_or(0.0) - outcome.goal.unwrap_or(0.0);
    let saved = outcome.lost.saturating_sub(unlimited.lost);
    if unlimited.lost > outcome.lost || (saved == 0 && goal_gain < MIN_GOAL_GAIN) {
        return None;
    }
    let effect =
        if saved > 0 { "a satellite would have been saved" } else { "the goal would have been held better" };
    Some(Failure {
        mode: KesslerFailureMode::FuelStarvation.name(),
        agent: satellite as u32,
        step: first.step,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![
            Measure::new("refused_burns", count as f64, ""),
            Measure::new("cost", first.cost, "fuel"),
            Measure::new("fuel_left", first.fuel, "fuel"),
        ],
        explanation: format!(
            "Satellite {satellite} was short of fuel from step {} on ({:.2} requested, {:.2} left): with all requested \
             burns {effect}.",
            first.step, first.cost, first.fuel
        ),
    })
}

/// Failure if the fuel left could not avoid what a full tank could have.
fn low_fuel_failure(analysis: &EpisodeAnalysis<'_>, loss: &SatelliteLoss) -> Option<Failure> {
    let encounter = loss.failure.encounter.as_ref()?;
    let visible = encounter.first_visible_step.filter(|_| encounter.avoidable == Some(false))?;
    let left = analysis.trace.satellite(loss.satellite, visible).fuel;
    let full = analysis.setup.fuel;
    if left >= full || left >= FUEL_PER_SPEED * MAX_BURN {
        return None; // More fuel would have allowed no other burn.
    }
    let to_avoid = LossToAvoid {
        satellite: loss.satellite,
        from: visible + 1,
        step: loss.event.step,
        debris: loss.event.debris.map(|debris| debris.identity),
        fuel: Some(full),
    };
    let remedy = find_remedy(analysis.counterfactuals, analysis.visibility, analysis.trace, to_avoid)?;
    Some(Failure {
        mode: KesslerFailureMode::FuelStarvation.name(),
        agent: loss.satellite as u32,
        step: visible + 1,
        encounter: None,
        orbit_angle_deg: None,
        measures: vec![Measure::new("cost", remedy.cost, "fuel"), Measure::new("fuel_left", left, "fuel")],
        explanation: format!(
            "Satellite {} had {left:.2} fuel left when the debris that hit it became visible; a burn of {:.2} fuel at step \
             {} would have avoided it.",
            loss.satellite, remedy.cost, remedy.step
        ),
    })
}
