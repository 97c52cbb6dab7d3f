//! Blind panel, floor and reference of a scenario. All plans are flown at full fidelity, side by side in lanes.

use super::blind::BlindAction::{self, Charge, Desaturate, Downlink, Work};
use super::blind::{BLIND_CYCLE, CyclePolicy};
use super::planner::flight::{FlightResult, HoldPilot, Pilot, best_index};
use super::planner::{PLANNER_VERSION, fly_candidates};
use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::error::ScenarioError;
use crate::task::Scenario;

/// The blind plans after the first one, which gives no action.
const CYCLES: [&[BlindAction]; 7] = [
    &[Charge],
    &[Work(0)],
    &[Work(0), Charge],
    BLIND_CYCLE,
    &[Work(0), Charge, Charge],
    &[Work(0), Work(0), Charge, Downlink],
    &[Work(0), Work(0), Charge, Charge, Downlink, Desaturate],
];

/// Computes the bracket.
///
/// The floor is the best score of the blind plans, at least 0: the mean of plans of which some die would be far below what a
/// survivor gets for nothing. The reference is the best candidate of the planner, or of the panel if that is better.
///
/// # Errors
/// Returns [`ScenarioError::Unfair`] if the scenario cannot start.
pub(super) fn bracket(scenario: &Scenario) -> Result<Bracket, ScenarioError> {
    let mut start = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
    start.sim.compute_station_windows();
    let mut flown = fly_candidates(&start, panel());
    let best = best_index(&flown);
    let panel: Vec<EpisodeOutcome> = flown[..=CYCLES.len()].iter().map(|flown| flown.outcome).collect();
    let floor = panel.iter().map(|outcome| outcome.score).fold(0.0, f64::max);
    let FlightResult { outcome: reference, log: reference_plan } = flown.swap_remove(best);
    Ok(Bracket { planner_version: PLANNER_VERSION, panel, floor, reference, reference_plan })
}

/// The pilots of the blind panel.
fn panel() -> Vec<Box<dyn Pilot>> {
    let mut pilots: Vec<Box<dyn Pilot>> = vec![Box::new(HoldPilot)];
    for cycle in CYCLES {
        pilots.push(Box::new(CyclePolicy::new(cycle)));
    }
    pilots
}
