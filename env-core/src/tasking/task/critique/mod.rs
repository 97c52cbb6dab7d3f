//! The critique of an episode: why score was lost, what each action was worth, and the judge's verdict.
//!
//! Start reading at [`critique`]. `trace` replays the episode and samples every tick; each failure mode has a file that looks for it
//! in the trace. `fork` runs other courses of the episode in lanes: episodes without an action (`counterfactual`), attempts to keep a
//! satellite alive (`death`), and images of other targets (`low_value`).

mod counterfactual;
mod death;
mod duplicate;
mod finding;
mod fork;
mod full;
mod idle;
mod judge;
mod low_value;
mod momentum;
mod orbit_angle;
mod pass_missed;
mod power;
mod sample;
mod settling;
mod storage;
mod tasked_action;
#[cfg(test)]
mod tests;
mod trace;
mod wheels;
mod window_missed;

use self::counterfactual::{BUDGET, judged_actions, verdicts};
pub(super) use self::death::death_reason;
use self::death::{Rescue, other_death};
use self::finding::{Finding, keep_largest};
use self::fork::{ForkResult, run_forks};
use self::low_value::Alternative;
pub(super) use self::orbit_angle::{ORBIT_ANGLE, orbit_angle_deg};
use self::trace::TaskingTrace;
use super::bracket;
use crate::critique::{Critique, FailureModeSpec};
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::rollout::replay;
use crate::task::Scenario;

const fn mode(name: &'static str, description: &'static str) -> FailureModeSpec {
    FailureModeSpec { name, description }
}

/// The failure modes: first those of all tasks, then those of tasks with targets, then that of several satellites.
static MODES: [FailureModeSpec; 9] = [
    mode("power", "the battery of a satellite was empty"),
    mode("wheels", "a wheel of a satellite was too fast"),
    mode("full", "data were recorded while the storage was full"),
    mode("pass_missed", "stored data were not sent in a pass, and the storage was full later"),
    mode(
        "idle",
        "an action gained nothing: desaturation of slow wheels, or charging in eclipse or with a full battery",
    ),
    mode("other", "a satellite died for another reason"),
    mode("window_missed", "the window of a tasked target closed without an image"),
    mode("low_value", "a target was imaged while one of higher priority was reachable instead"),
    mode("duplicate", "a satellite imaged a target that another one had imaged"),
];
/// Number of modes of scanning, and of imaging with one satellite.
const SCANNING_MODES: usize = 6;
const IMAGING_MODES: usize = 8;

/// The failure modes of a task.
pub(super) fn failure_modes(task: &str) -> &'static [FailureModeSpec] {
    match task {
        "tasking/scanning" => &MODES[..SCANNING_MODES],
        "tasking/imaging" => &MODES[..IMAGING_MODES],
        _ => &MODES,
    }
}

/// Analyses an episode.
///
/// # Errors
/// Returns an error if the scenario cannot start or the log is not one of this scenario.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
    critique_within(scenario, log, BUDGET)
}

/// Analyses an episode with a limit of the cost of its counterfactuals.
fn critique_within(scenario: &Scenario, log: &ActionLog, budget: f64) -> Result<Critique, ReplayError> {
    // A log that ends too early, as that of an episode that goes on, is refused before the longer work.
    replay(scenario, log)?;
    let trace = TaskingTrace::replay(scenario, log)?;
    let rescues = Rescue::plan(&trace);
    let alternatives = low_value::alternatives(&trace);
    let actions = judged_actions(&trace, budget);
    let rescue_requests = rescues.iter().flat_map(|rescue| &rescue.requests).copied();
    let requests: Vec<_> = rescue_requests
        .chain(alternatives.iter().map(|alternative| alternative.request))
        .chain(actions.iter().filter_map(counterfactual::JudgedAction::request))
        .collect();
    let results = run_forks(scenario, log, &trace, &requests)?;
    let saved = rescues.iter().map(|rescue| rescue.requests.len()).sum();
    let (rescued, others) = results.split_at(saved);
    let (imaged, without) = others.split_at(alternatives.len());
    let findings = find_all(&trace, &rescues, rescued, &alternatives, imaged);
    let mut failures: Vec<_> = findings.into_iter().map(|finding| finding.into_failure(&trace)).collect();
    failures.sort_by_key(|failure| (failure.step, failure.agent));
    let reference = bracket::bracket(scenario)?.reference.score;
    Ok(Critique {
        failures,
        actions: verdicts(&trace.outcome, &actions, without),
        assessment: judge::judge(&trace.outcome, trace.satellites.len(), reference),
    })
}

/// Findings of all modes and satellites.
fn find_all(
    trace: &TaskingTrace,
    rescues: &[Rescue],
    mut rescued: &[ForkResult],
    alternatives: &[Alternative],
    imaged: &[ForkResult],
) -> Vec<Finding> {
    let mut last_chances = vec![None; trace.satellites.len()];
    for rescue in rescues {
        let (own, rest) = rescued.split_at(rescue.requests.len());
        last_chances[rescue.agent] = rescue.last_chance(own);
        rescued = rest;
    }
    let mut findings = Vec::new();
    for (agent, satellite) in trace.satellites.iter().enumerate() {
        if let Some(death) = &satellite.death {
            findings.push(match death_reason(&death.checks).0 {
                "power" => power::find(trace, agent, death, last_chances[agent]),
                "wheels" => wheels::find(trace, agent, death, last_chances[agent]),
                _ => other_death(trace, agent, death),
            });
        }
        let modes = [full::find, pass_missed::find, idle::find, window_missed::find];
        modes.iter().for_each(|find| findings.extend(keep_largest(find(trace, agent))));
    }
    for shared in [duplicate::find(trace), low_value::find(trace, alternatives, imaged)] {
        for agent in 0..trace.satellites.len() {
            let own = shared.iter().filter(|finding| finding.agent == agent).cloned();
            findings.extend(keep_largest(own.collect()));
        }
    }
    findings
}
