//! Flying whole episodes: by a policy, or by a log.

use serde_json::Value;

use crate::bracket::Flown;
use crate::error::{LogError, ScenarioError, StepError};
use crate::log::{ActionLog, JointAction, MAX_STEPS, Precision, Stopped};
use crate::policy::Policy;
use crate::scenario::Scenario;
use crate::task::StepReport;

/// A log that was flown on a scenario where it cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReplayError {
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The log is not one of this scenario.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Flies a scenario by a policy to its end: how it went, and the log.
///
/// # Errors
/// A scenario whose start is not fair, or a policy whose action the environment refuses.
pub fn fly(scenario: &Scenario, policy: &mut dyn Policy) -> Result<(Flown, ActionLog), ReplayError> {
    let task = scenario.task();
    let mut episode = task.start(scenario)?;
    let mut log = ActionLog::new(task.action_space().columns.len(), Precision::F64);
    let mut report = StepReport::default();
    while !episode.done() {
        policy.act(episode.observation(), &mut log);
        let step = log.len();
        let action = log.step(step.saturating_sub(1));
        episode
            .step(action, &mut report)
            .map_err(|source| refused(step.saturating_sub(1), action, source))?;
    }
    Ok((episode.flown(), log))
}

/// Flies a scenario by a log: what was earned by these actions, whoever claims them.
///
/// # Errors
/// A log that is too long, too short without a word why, or refused by the environment.
pub fn replay(scenario: &Scenario, log: &ActionLog) -> Result<Flown, ReplayError> {
    let mut episode = scenario.task().start(scenario)?;
    let mut report = StepReport::default();
    follow(log, |action| episode.step(action, &mut report).map(|()| report.done))?;
    Ok(episode.flown())
}

/// Steps by a log, and by hold where it stopped early, until `step` says that the episode is over.
///
/// # Errors
/// A log that is too long, too short without a word why, or refused by the environment.
pub(crate) fn follow(
    log: &ActionLog,
    mut step: impl FnMut(JointAction<'_>) -> Result<bool, StepError>,
) -> Result<(), LogError> {
    let (mut steps, mut done) = (0, false);
    let mut advance = |action: JointAction<'_>, steps: &mut u32| {
        *steps += 1;
        step(action).map_err(|source| refused(*steps as usize - 1, action, source))
    };
    for action in log.steps() {
        if done {
            return Err(LogError::TooLong { steps: log.len(), ended: steps });
        }
        done = advance(action, &mut steps)?;
    }
    if !done && log.stopped.is_none() {
        return Err(LogError::TooShort { steps: log.len() });
    }
    while !done {
        done = advance(JointAction::HOLD, &mut steps)?;
    }
    Ok(())
}

/// A refused step by its place in the log, and the entry at fault where one is.
fn refused(step: usize, action: JointAction<'_>, source: StepError) -> LogError {
    let entry = match source {
        StepError::UnknownAgent { agent, .. } | StepError::NotFinite { agent } => {
            action.agents.iter().position(|&a| a == agent)
        }
        _ => None,
    };
    let field = entry.map_or_else(|| format!("steps.{step}"), |entry| format!("steps.{step}.{entry}"));
    LogError::Step { field, source }
}

/// Reads a log in the wire form: a list of steps in the task's own form, `"f32"` or `"f64"`, and why it stopped.
///
/// # Errors
/// What is malformed, by field.
pub fn read_log(
    scenario: &Scenario,
    steps: &[Value],
    precision: Precision,
    stopped: Option<Stopped>,
) -> Result<ActionLog, LogError> {
    let task = scenario.task();
    let horizon = task.horizon(scenario.recipe()) as usize;
    if steps.len() > horizon.min(MAX_STEPS) {
        return Err(LogError::TooLong {
            steps: steps.len(),
            ended: u32::try_from(horizon).unwrap_or(u32::MAX),
        });
    }
    let mut log = ActionLog::new(task.action_space().columns.len(), precision);
    log.stopped = stopped;
    for (index, step) in steps.iter().enumerate() {
        task.read_step(step, &mut log).map_err(|error| match error {
            LogError::Malformed { field, reason } => {
                LogError::Malformed { field: format!("steps.{index}{field}"), reason }
            }
            other => other,
        })?;
        log.end_step();
    }
    Ok(log)
}
