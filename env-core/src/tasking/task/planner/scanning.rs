//! Candidates for the reference of a scanning satellite: rules and plans by the coarse model, of which the best are flown.

use std::rc::Rc;

use super::coarse::CoarseState;
use super::flight::Pilot;
use super::scan_pilot::ScanPilot;
use super::scan_plan::ScanPlan;
use super::scan_search::{ScanCandidate, search, sort};
use super::slots::SlotTable;
use super::threshold_rules;
use crate::tasking::task::run::TaskRun;

/// Plans and rules that are flown at full fidelity: as many as a block has lanes.
pub(super) const FLOWN: usize = 8;
/// Candidates whose thresholds are chosen for each orbit.
const TUNED: usize = 1;
/// Rounds in which modes are swapped.
const SWAP_ROUNDS: usize = 2;

/// The pilots that are flown.
pub(super) fn pilots(start: &TaskRun) -> Vec<Box<dyn Pilot>> {
    let table = Rc::new(SlotTable::new(start));
    let state = CoarseState::of(start.sim.satellite(0));
    let ScanPlans { mut candidates, swapped } = plan(&table, &state);
    let rule = threshold_rules::best(&table, &state);
    candidates.truncate(FLOWN - 2);
    let mut pilots: Vec<Box<dyn Pilot>> = vec![Box::new(rule)];
    let plans = std::iter::once(swapped).chain(candidates.into_iter().map(|candidate| candidate.plan));
    for plan in plans {
        pilots.push(Box::new(ScanPilot { table: Rc::clone(&table), plan }));
    }
    pilots
}

/// Plans that a search found.
#[derive(Debug)]
pub(super) struct ScanPlans {
    /// Rules with their plans, best first.
    pub(super) candidates: Vec<ScanCandidate>,
    /// The best plan with swapped modes.
    pub(super) swapped: ScanPlan,
}

/// Searches plans from a state on.
pub(super) fn plan(table: &SlotTable, start: &CoarseState) -> ScanPlans {
    let mut candidates = search(table, start);
    for candidate in candidates.iter_mut().take(TUNED) {
        candidate.tune_orbits(table, start);
    }
    sort(&mut candidates);
    candidates.dedup_by(|a, b| a.plan.modes == b.plan.modes);
    let mut swapped = candidates[0].plan.clone();
    for _ in 0..SWAP_ROUNDS {
        swapped.swap_modes(table, start);
    }
    ScanPlans { candidates, swapped }
}
