//! Analysis of an episode, from which failures and judgements are computed.

use std::sync::Arc;

use super::counterfactuals::Counterfactuals;
use super::trace::EpisodeTrace;
use super::verdicts;
use super::visibility::DebrisVisibility;
use crate::bracket::EpisodeOutcome;
use crate::critique::ActionVerdict;
use crate::episode_rng::SeededRng;
use crate::error::ReplayError;
use crate::kessler::planner::ephemeris::DebrisEphemeris;
use crate::kessler::reward::Objective;
use crate::kessler::setup::KesslerSetup;
use crate::log::ActionLog;
use crate::task::Scenario;

/// Replayed episode with its counterfactuals and verdicts.
pub(super) struct EpisodeAnalysis<'a> {
    pub objective: Objective,
    pub setup: &'a KesslerSetup,
    pub trace: &'a EpisodeTrace,
    pub counterfactuals: &'a Counterfactuals<'a>,
    pub visibility: &'a DebrisVisibility<'a>,
    pub verdicts: &'a [ActionVerdict],
}

/// Cost and gain of several burns, summed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BurnTotals {
    /// Fuel that the burns took.
    pub cost: f64,
    /// Score with the burns minus score without each.
    pub gain: f64,
}

impl EpisodeAnalysis<'_> {
    /// Outcome of the episode.
    pub(super) const fn outcome(&self) -> &EpisodeOutcome {
        &self.trace.outcome
    }

    /// Sums the burns whose verdict is selected.
    pub(super) fn total_burns(&self, is_selected: impl Fn(&ActionVerdict) -> bool) -> BurnTotals {
        let selected = self.verdicts.iter().filter(|v| is_selected(v));
        selected.fold(BurnTotals::default(), |totals, v| BurnTotals {
            cost: totals.cost + v.cost,
            gain: totals.gain + v.gain,
        })
    }
}

/// Replays an episode and passes its analysis to `evaluate`.
///
/// # Errors
/// Returns [`ReplayError`] if the log cannot be replayed on the scenario.
pub(super) fn analyze<T>(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
    evaluate: impl FnOnce(&EpisodeAnalysis<'_>) -> T,
) -> Result<T, ReplayError> {
    let seed = scenario.seed();
    let setup = Arc::new(KesslerSetup::from_recipe(scenario.recipe())?);
    let start = setup.draw_initial_state(&mut SeededRng::new(seed))?;
    let trace = EpisodeTrace::replay(objective, &setup, &start, seed, log)?;
    let ephemeris = DebrisEphemeris::from_initial_state(&setup, &start);
    let counterfactuals = Counterfactuals::new(objective, &setup, &start, seed, &ephemeris, log);
    let verdicts = verdicts::judge_burns(&counterfactuals, &trace);
    let visibility = DebrisVisibility::new(&setup, &start, &ephemeris, &trace);
    Ok(evaluate(&EpisodeAnalysis {
        objective,
        setup: &setup,
        trace: &trace,
        counterfactuals: &counterfactuals,
        visibility: &visibility,
        verdicts: &verdicts,
    }))
}
