//! Who flies: a language model, or a built-in policy.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use llm::{LlmClient, LlmError};
use env_core::log::{ActionLog, Precision};
use env_core::policy::Policy;
use serde_json::Value;

use super::tasks::Task;
use orchestrator::policy::{ActionCodec, TaskPrompt, ChatPolicy, ChatSettings, TimeStep, ChatTurn};

/// The policy that works on the scenario itself, which no server tells.
const WITH_HINDSIGHT: &str = "reference";

/// Who is to fly all episodes.
#[derive(Debug)]
pub(super) enum Wish {
    /// A model.
    Model {
        /// Where it is.
        llm: LlmClient,
        /// How it is asked.
        settings: ChatSettings,
        /// How observations are told.
        telemetry: orchestrator::policy::ObservationFormat,
        /// It has given an action at least once.
        answered: Arc<AtomicBool>,
    },
    /// A built-in policy, by name, and what it draws from.
    BuiltIn { name: String, seed: u64 },
}

/// Who flies one episode.
pub(super) enum Pilot {
    Model { policy: Box<ChatPolicy>, answered: Arc<AtomicBool> },
    BuiltIn { policy: Box<dyn Policy>, task: Task, actions: ActionCodec },
}

/// What was decided for a step.
pub(super) struct Decision {
    pub(super) action: Value,
    /// Why nothing is done, where that is not the pilot's own will.
    pub(super) error: Option<String>,
    /// How a model came to it.
    pub(super) turn: Option<ChatTurn>,
}

/// Why nobody can decide.
#[derive(Debug, thiserror::Error)]
pub(super) enum PilotError {
    /// The model's endpoint.
    #[error(transparent)]
    Model(#[from] LlmError),
    /// An observation that is none of the task's world.
    #[error("{0}")]
    World(String),
}

impl Wish {
    /// The name in the lines.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Model { llm, .. } => llm::sanitize_line(&llm.config().model),
            Self::BuiltIn { name, .. } => name.clone(),
        }
    }

    /// Refuses what cannot fly a task.
    pub(super) fn check(&self, task: &Task) -> anyhow::Result<()> {
        let Self::BuiltIn { name, .. } = self else { return Ok(()) };
        if name == WITH_HINDSIGHT {
            bail!(
                "--policy {name}: it plans on the scenario itself, which a server does not tell; it flies in `sparring eval`"
            );
        }
        built_in(name, task, 0).map(|_| ())
    }

    /// A pilot for one episode.
    pub(super) fn pilot(&self, task: &Task, actions: &ActionCodec, episode: u64) -> anyhow::Result<Pilot> {
        match self {
            Self::Model { llm, settings, telemetry, answered } => {
                let prompt = TaskPrompt::new(actions.clone(), *telemetry);
                let policy = ChatPolicy::new(llm.clone(), prompt, settings.clone());
                Ok(Pilot::Model { policy: Box::new(policy), answered: Arc::clone(answered) })
            }
            Self::BuiltIn { name, seed } => {
                let policy = built_in(name, task, seed.wrapping_add(episode))?;
                Ok(Pilot::BuiltIn { policy, task: task.clone(), actions: actions.clone() })
            }
        }
    }
}

/// Pauses that are waited for, of an endpoint that has answered before: 30 seconds, then twice that.
const PAUSES: u32 = 2;

/// Asks; where the endpoint is left alone for a while, which failures of other episodes may have led to, waits for that.
async fn patiently(policy: &mut ChatPolicy, seen: &TimeStep, answered: &AtomicBool) -> Result<ChatTurn, LlmError> {
    let mut left = if answered.load(Ordering::Relaxed) { PAUSES } else { 0 };
    loop {
        match policy.act(seen).await {
            Err(LlmError::CircuitOpen { retry_in, .. }) if left > 0 => {
                left -= 1;
                tokio::time::sleep(retry_in).await;
            }
            told => return told,
        }
    }
}

/// A built-in policy. All but the one with hindsight take nothing from the scenario.
fn built_in(name: &str, task: &Task, seed: u64) -> anyhow::Result<Box<dyn Policy>> {
    let policy = task.spec.policy(name, &task.example()?, seed);
    policy.with_context(|| format!("{}: --policy", task.spec.id()))
}

impl Pilot {
    /// The version of what a model is told.
    pub(super) fn prompt(&self) -> Option<String> {
        match self {
            Self::Model { policy, .. } => Some(policy.prompt().version()),
            Self::BuiltIn { .. } => None,
        }
    }

    /// The next action.
    pub(super) async fn decide(&mut self, seen: &TimeStep) -> Result<Decision, PilotError> {
        match self {
            Self::Model { policy, answered } => {
                let turn = patiently(policy, seen, answered).await?;
                answered.fetch_or(turn.error.is_none(), Ordering::Relaxed);
                Ok(Decision { action: turn.action.clone(), error: turn.error.clone(), turn: Some(turn) })
            }
            Self::BuiltIn { policy, task, actions } => {
                let observed = task.spec.read_observation(&seen.with_reward_and_done()).map_err(|error| {
                    PilotError::World(format!("the observation is none of {}: {error}", task.spec.id()))
                })?;
                let dim = task.spec.action_space().columns.len();
                let mut log = ActionLog::new(dim, Precision::F64);
                policy.act(&*observed, &mut log);
                Ok(Decision { action: actions.encode(log.step(0)), error: None, turn: None })
            }
        }
    }

    /// What actions look like.
    pub(super) fn actions(&self) -> &ActionCodec {
        match self {
            Self::Model { policy, .. } => policy.prompt().codec(),
            Self::BuiltIn { actions, .. } => actions,
        }
    }
}
