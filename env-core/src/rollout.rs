//! Runs whole episodes: by a policy or by a log.

use serde_json::Value;

use crate::bracket::EpisodeOutcome;
use crate::error::{LogError, ReplayError, StepError};
use crate::log::{ActionLog, JointAction, MAX_LOG_STEPS, Precision, StopReason};
use crate::policy::Policy;
use crate::task::{Scenario, StepReport};

/// Outcome and actions of a finished episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// Outcome of the episode.
    pub outcome: EpisodeOutcome,
    /// Actions of the policy.
    pub log: ActionLog,
}

/// Rolls out a policy on a scenario to the end of the episode.
///
/// # Errors
/// Returns [`ReplayError::Scenario`] if the start is not fair, [`ReplayError::Log`] if the environment rejects an action of
/// the policy, and [`ReplayError::Policy`] if the policy has none.
pub fn roll_out(scenario: &Scenario, policy: &mut dyn Policy) -> Result<Rollout, ReplayError> {
    let task = scenario.task();
    let mut episode = task.start(scenario)?;
    let mut log = ActionLog::new(task.action_space().dim(), Precision::F64);
    let mut report = StepReport::default();
    while !episode.done() {
        policy.act(episode.observation(), &mut log)?;
        let step = log.len();
        let action = log.step(step.saturating_sub(1));
        episode
            .step(action, &mut report)
            .map_err(|source| step_error(step.saturating_sub(1), action, source))?;
    }
    Ok(Rollout { outcome: episode.outcome(), log })
}

/// Replays a log on a scenario. The outcome depends on the actions alone, so it verifies a reported score.
///
/// # Errors
/// Returns [`ReplayError::Scenario`] if the start is not fair, and [`ReplayError::Log`] if the log is too long, too short
/// without a stop reason, or contains an action that the environment rejects.
pub fn replay(scenario: &Scenario, log: &ActionLog) -> Result<EpisodeOutcome, ReplayError> {
    let mut episode = scenario.task().start(scenario)?;
    let mut report = StepReport::default();
    step_through(log, |action| episode.step(action, &mut report).map(|()| report.done))?;
    Ok(episode.outcome())
}

/// An episode to be replayed.
#[derive(Debug, Clone, Copy)]
pub struct ReplayItem<'a> {
    /// Scenario of the episode.
    pub scenario: &'a Scenario,
    /// Actions of the episode.
    pub log: &'a ActionLog,
}

/// Replays several logs with the same outcomes as [`replay`], each by itself. Those of one task that follow each other are replayed
/// together, which is faster in worlds that step episodes side by side.
#[must_use]
pub fn replay_all(items: &[ReplayItem<'_>]) -> Vec<Result<EpisodeOutcome, ReplayError>> {
    let runs = items.chunk_by(|a, b| a.scenario.task().id() == b.scenario.task().id());
    runs.flat_map(|run| run[0].scenario.task().replay_all(run)).collect()
}

/// Calls `step` with each action of a log, then with hold if the log stopped early, until it returns that the episode is
/// over.
///
/// # Errors
/// Returns an error if the log is too long, too short without a stop reason, or contains an action that `step` rejects.
pub(crate) fn step_through(
    log: &ActionLog,
    mut step: impl FnMut(JointAction<'_>) -> Result<bool, StepError>,
) -> Result<(), LogError> {
    let (mut cursor, mut is_done) = (LogCursor::new(log), false);
    while let Some(action) = cursor.next(is_done)? {
        is_done = step(action).map_err(|source| cursor.error(action, source))?;
    }
    Ok(())
}

/// Reads a log step by step while its episode is replayed.
#[derive(Debug, Clone)]
pub(crate) struct LogCursor<'a> {
    log: &'a ActionLog,
    steps: usize,
}

impl<'a> LogCursor<'a> {
    /// Creates a cursor at the start of a log.
    pub(crate) const fn new(log: &'a ActionLog) -> Self {
        Self { log, steps: 0 }
    }

    /// The next action of an episode that is over or not: of the log, then hold if the log stopped early. `None` after the end.
    ///
    /// # Errors
    /// Returns an error if the log is too long, or too short without a stop reason.
    pub(crate) fn next(&mut self, is_done: bool) -> Result<Option<JointAction<'a>>, LogError> {
        let (log, steps) = (self.log, self.steps);
        let is_logged = steps < log.len();
        if is_done {
            return if is_logged {
                Err(LogError::TooLong { steps: log.len(), ended: steps as u32 })
            } else {
                Ok(None)
            };
        }
        if !is_logged && log.stopped.is_none() {
            return Err(LogError::TooShort { steps: log.len() });
        }
        self.steps += 1;
        Ok(Some(log.step(steps))) // hold beyond the end
    }

    /// The error of the last action, which the episode rejected.
    pub(crate) fn error(&self, action: JointAction<'_>, source: StepError) -> LogError {
        step_error(self.steps.saturating_sub(1), action, source)
    }
}

/// The error of a rejected step, located by its index and, if one is at fault, its entry.
fn step_error(step: usize, action: JointAction<'_>, source: StepError) -> LogError {
    let entry = match source {
        StepError::UnknownAgent { agent, .. }
        | StepError::NotFinite { agent }
        | StepError::UnknownAction { agent, .. } => action.agents.iter().position(|&a| a == agent),
        _ => None,
    };
    let field = entry.map_or_else(|| format!("steps.{step}"), |entry| format!("steps.{step}.{entry}"));
    LogError::Step { field, source }
}

/// Reads a log from JSON: a list of steps in the task's own form.
///
/// # Errors
/// Returns [`LogError::TooLong`] if there are more steps than the horizon, and [`LogError::Malformed`] with the field if a
/// step is invalid.
pub fn read_log(
    scenario: &Scenario,
    steps: &[Value],
    precision: Precision,
    stopped: Option<StopReason>,
) -> Result<ActionLog, LogError> {
    let task = scenario.task();
    let horizon = task.horizon(scenario.recipe()) as usize;
    if steps.len() > horizon.min(MAX_LOG_STEPS) {
        return Err(LogError::TooLong {
            steps: steps.len(),
            ended: u32::try_from(horizon).unwrap_or(u32::MAX),
        });
    }
    let mut log = ActionLog::new(task.action_space().dim(), precision);
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
