//! Policies that control episodes: a language model or a built-in policy.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use env_core::log::{ActionLog, Precision};
use env_core::policy::{PLANNER_POLICY, Policy};
use llm::{LlmClient, LlmError};
use serde_json::Value;

use super::openenv_task::OpenEnvTask;
use llm_policy::{ActionCodec, ChatPolicy, ChatSettings, ChatTurn, TaskPrompt, TimeStep};

/// Source of the policies of all episodes.
#[derive(Debug)]
pub(super) enum PolicySource {
    /// A language model behind a chat API.
    Model {
        /// Client of the model's endpoint.
        llm: LlmClient,
        /// Settings of the chat requests.
        settings: ChatSettings,
        /// Format of observations in the prompt.
        telemetry: llm_policy::ObservationFormat,
        /// True once the model has returned a valid action.
        answered: Arc<AtomicBool>,
    },
    /// A built-in policy by its name, with the seed of its random draws.
    BuiltIn { name: String, seed: u64 },
}

/// Policy of one episode.
pub(super) enum EpisodePolicy {
    Model { policy: Box<ChatPolicy>, answered: Arc<AtomicBool> },
    BuiltIn { policy: Box<dyn Policy>, task: OpenEnvTask, actions: ActionCodec },
}

/// Action of one step and how it was chosen.
pub(super) struct StepDecision {
    pub(super) action: Value,
    /// Reason of a forced hold; `None` if the policy chose the action itself.
    pub(super) error: Option<String>,
    /// Chat turn that led to the action; `None` for built-in policies.
    pub(super) turn: Option<ChatTurn>,
}

/// Reason why a policy cannot choose an action.
#[derive(Debug, thiserror::Error)]
pub(super) enum DecisionError {
    /// The request to the model's endpoint failed.
    #[error(transparent)]
    Model(#[from] LlmError),
    /// The observation does not belong to the task's world.
    #[error("{0}")]
    World(String),
}

impl PolicySource {
    /// Returns the policy's name, as printed in the output lines.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Model { llm, .. } => llm::sanitize_line(&llm.config().model),
            Self::BuiltIn { name, .. } => name.clone(),
        }
    }

    /// Checks that the policy supports a task.
    ///
    /// # Errors
    /// Returns an error if the task does not have the policy, or the policy needs the scenario itself.
    pub(super) fn check(&self, task: &OpenEnvTask) -> anyhow::Result<()> {
        let Self::BuiltIn { name, .. } = self else { return Ok(()) };
        if name == PLANNER_POLICY {
            bail!(
                "--policy {name}: it needs the scenario itself, which a server does not send; use it in `sparring eval`"
            );
        }
        built_in(name, task, 0).map(|_| ())
    }

    /// Creates the policy for one episode.
    ///
    /// # Errors
    /// Returns an error if the task does not have the policy.
    pub(super) fn episode_policy(
        &self,
        task: &OpenEnvTask,
        actions: &ActionCodec,
        episode: u64,
    ) -> anyhow::Result<EpisodePolicy> {
        match self {
            Self::Model { llm, settings, telemetry, answered } => {
                let prompt = TaskPrompt::new(actions.clone(), *telemetry);
                let policy = ChatPolicy::new(llm.clone(), prompt, settings.clone());
                Ok(EpisodePolicy::Model { policy: Box::new(policy), answered: Arc::clone(answered) })
            }
            Self::BuiltIn { name, seed } => {
                let policy = built_in(name, task, seed.wrapping_add(episode))?;
                Ok(EpisodePolicy::BuiltIn { policy, task: task.clone(), actions: actions.clone() })
            }
        }
    }
}

/// Pauses of an open circuit breaker that one step waits for, if the endpoint has responded before: 30 s, then 60 s.
const MAX_CIRCUIT_WAITS: u32 = 2;

/// Requests an action. If the circuit breaker is open, which failures of other episodes can cause, waits until it closes.
async fn act_with_patience(
    policy: &mut ChatPolicy,
    seen: &TimeStep,
    answered: &AtomicBool,
) -> Result<ChatTurn, LlmError> {
    let mut left = if answered.load(Ordering::Relaxed) { MAX_CIRCUIT_WAITS } else { 0 };
    loop {
        match policy.act(seen).await {
            Err(LlmError::CircuitOpen { retry_in, .. }) if left > 0 => {
                left -= 1;
                tokio::time::sleep(retry_in).await;
            }
            result => return result,
        }
    }
}

/// Creates a built-in policy. All policies but [`PLANNER_POLICY`] ignore the scenario.
fn built_in(name: &str, task: &OpenEnvTask, seed: u64) -> anyhow::Result<Box<dyn Policy>> {
    let policy = task.spec.policy(name, &task.example()?, seed);
    policy.with_context(|| format!("{}: --policy", task.spec.id()))
}

impl EpisodePolicy {
    /// Returns the version of the model's prompt; `None` for built-in policies.
    pub(super) fn prompt_version(&self) -> Option<String> {
        match self {
            Self::Model { policy, .. } => Some(policy.prompt().version()),
            Self::BuiltIn { .. } => None,
        }
    }

    /// Chooses the next action.
    ///
    /// # Errors
    /// Returns [`DecisionError::Model`] if the model cannot be reached and [`DecisionError::World`] if the observation is invalid.
    pub(super) async fn decide(&mut self, seen: &TimeStep) -> Result<StepDecision, DecisionError> {
        match self {
            Self::Model { policy, answered } => {
                let turn = act_with_patience(policy, seen, answered).await?;
                answered.fetch_or(turn.error.is_none(), Ordering::Relaxed);
                Ok(StepDecision { action: turn.action.clone(), error: turn.error.clone(), turn: Some(turn) })
            }
            Self::BuiltIn { policy, task, actions } => {
                let observed = task.spec.read_observation(&seen.with_reward_and_done()).map_err(|error| {
                    DecisionError::World(format!("the observation is not one of {}: {error}", task.spec.id()))
                })?;
                let dim = task.spec.action_space().dim();
                let mut log = ActionLog::new(dim, Precision::F64);
                policy.act(&*observed, &mut log).map_err(|error| DecisionError::World(error.to_string()))?;
                Ok(StepDecision { action: actions.encode(log.step(0)), error: None, turn: None })
            }
        }
    }

    /// Returns the codec of the task's actions.
    pub(super) fn codec(&self) -> &ActionCodec {
        match self {
            Self::Model { policy, .. } => policy.prompt().codec(),
            Self::BuiltIn { actions, .. } => actions,
        }
    }
}
