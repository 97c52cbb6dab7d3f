//! Why an episode lost score: the deaths of satellites.

use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::critique::{Critique, Failure, FailureModeSpec, Judgement, Measure};
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::rollout::step_through;
use crate::task::Scenario;

/// The ways in which an episode loses score.
pub(super) static TASKING_FAILURE_MODES: [FailureModeSpec; 3] = [
    FailureModeSpec { name: "power", description: "the battery of a satellite was empty" },
    FailureModeSpec { name: "wheels", description: "a wheel of a satellite was too fast" },
    FailureModeSpec { name: "other", description: "a satellite died for another reason" },
];

/// Analyses an episode.
///
/// # Errors
/// Returns an error if the scenario cannot start or the log is not one of this scenario.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Result<Critique, ReplayError> {
    let mut run = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
    let mut failures = Vec::new();
    step_through(log, |action| {
        let actions = run.read_actions(action)?;
        run.step(&actions);
        failures.extend(run.last_step().deaths.iter().map(|(agent, checks)| death(&run, *agent, checks)));
        Ok(run.is_done())
    })?;
    let outcome = run.outcome();
    let deaths = match outcome.lost {
        1 => "1 satellite".to_owned(),
        lost => format!("{lost} satellites"),
    };
    let explanation = format!("The score is {:.3}, and {deaths} died.", outcome.score);
    let assessment = Judgement { value: outcome.score.clamp(-1.0, 1.0), case: "score", explanation };
    Ok(Critique { failures, actions: Vec::new(), assessment })
}

/// Mode and description of a death, from the names of the checks that failed.
pub(super) fn death_reason(checks: &str) -> (&'static str, &'static str) {
    let reasons = [
        ("battery_valid", "power", "its battery was empty"),
        ("rw_speeds_valid", "wheels", "a wheel was too fast"),
        ("data_storage_valid", "other", "its storage was full"),
    ];
    let found = reasons.iter().find(|(check, _, _)| checks.contains(check));
    found.map_or(("other", "its orbit was too low"), |(_, mode, reason)| (*mode, *reason))
}

/// The death of a satellite in the last step.
fn death(run: &TaskRun, agent: usize, checks: &str) -> Failure {
    let (mode, reason) = death_reason(checks);
    let time_s = run.sim.time_s();
    Failure {
        mode,
        agent: agent as u32,
        step: run.sim.steps(),
        encounter: None,
        measures: vec![Measure::new("time", time_s, "s")],
        explanation: format!("Satellite {agent} died {time_s:.0} s after the start: {reason}."),
    }
}
