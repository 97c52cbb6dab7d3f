//! What an episode of kessler shows: why score was lost, with the geometry of it; what each burn was worth, by the same
//! episode without it; and the deterministic judge's word. `docs/critique.md` has the definitions and the numbers.
//!
//! `trace` replays the episode by the engine and keeps what the others ask of it; `plans` flies single satellites again
//! under changed burns; `sky` knows where everything is and since when it is visible.

mod formation;
mod goal;
mod judge;
mod loss;
mod meeting;
mod mode;
mod plans;
mod remedy;
mod sky;
mod starvation;
mod step;
mod trace;
mod verdict;
mod waste;

use std::sync::Arc;

pub(super) use self::mode::{SPEED_BANDS, modes};

use self::plans::Plans;
use self::sky::Sky;
use self::trace::Trace;
use super::planner::table::Table;
use super::reward::Objective;
use super::setup::Setup;
use crate::bracket::Flown;
use crate::chance::Seeded;
use crate::critique::{ActionVerdict, Critique, Judged};
use crate::log::{ActionLog, Stopped};
use crate::rollout::ReplayError;
use crate::scenario::Scenario;

/// Score that counts: a smaller difference is no difference. The world's ε.
const COUNTS: f64 = super::constants::EPSILON;

/// What everything below is asked of.
struct Case<'a> {
    objective: Objective,
    setup: &'a Setup,
    trace: &'a Trace,
    plans: &'a Plans<'a>,
    sky: &'a Sky<'a>,
    verdicts: &'a [ActionVerdict],
}

impl Case<'_> {
    /// How the episode went.
    const fn flown(&self) -> &Flown {
        &self.trace.flown
    }

    /// The cost of the burns whose verdict is wanted, and what they gained, summed.
    fn spent(&self, wanted: impl Fn(&ActionVerdict) -> bool) -> (f64, f64) {
        let chosen = self.verdicts.iter().filter(|v| wanted(v));
        chosen.fold((0.0, 0.0), |(cost, gain), v| (cost + v.cost, gain + v.gain))
    }
}

/// What an episode shows.
pub(super) fn critique(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
) -> Result<Critique, ReplayError> {
    looked_at(objective, scenario, log, |case| {
        let losses = loss::all(case);
        let mut failures: Vec<_> = starvation::all(case, &losses);
        let starved: Vec<u32> = failures.iter().map(|failure| failure.agent).collect();
        let judged = judge::judge(case, &losses, &starved);
        failures.extend(losses.into_iter().map(|loss| loss.failure));
        failures.extend(goal::missed(case));
        failures.extend(formation::broken(case));
        failures.extend(waste::all(case));
        failures.sort_by_key(|failure| (failure.step, failure.agent));
        Critique { failures, actions: case.verdicts.to_vec(), judged }
    })
}

/// The judge's word on the last step of a log, as if nobody burnt after it.
pub(super) fn judge_step(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
) -> Result<Judged, ReplayError> {
    let mut held = log.clone();
    held.stopped = Some(Stopped::TooLate);
    looked_at(objective, scenario, &held, |case| step::judge(case, &loss::all(case), log.len() as u32))
}

/// Flies an episode again for somebody who looks at it.
fn looked_at<T>(
    objective: Objective,
    scenario: &Scenario,
    log: &ActionLog,
    look: impl FnOnce(&Case<'_>) -> T,
) -> Result<T, ReplayError> {
    let setup = Arc::new(Setup::read(scenario.recipe())?);
    let start = setup.start(&mut Seeded::new(scenario.seed()))?;
    let trace = Trace::of(objective, &setup, &start, scenario.seed(), log)?;
    let table = Table::of(&setup, &start);
    let plans = Plans::of(objective, &setup, &start, scenario.seed(), &table, log);
    let verdicts = verdict::all(&plans, &trace);
    let sky = Sky::of(&setup, &start, &table, &trace);
    Ok(look(&Case { objective, setup: &setup, trace: &trace, plans: &plans, sky: &sky, verdicts: &verdicts }))
}
