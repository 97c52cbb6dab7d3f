//! Flying one episode by a policy: a built-in one, or a language model.

use llm::LlmError;
use env_core::{Scenario, StopReason};
use serde::Serialize;
use utoipa::ToSchema;

use crate::rollouts::settings::{Endpoint, PolicySettings};
use crate::rollouts::recorder::EpisodeRecorder;
pub use crate::rollouts::recorder::{AgentEnd, RecordedEpisode, RecordingBudget, TrajectoryStep};
use crate::policy::{ActionCodec, ActionFailure, TaskPrompt, ChatPolicy, ChatSettings, ChatTurn, ObservationFormat};

/// What is remembered of an episode, by the names under which trainers log it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, ToSchema)]
pub struct ModelMetrics {
    /// Sampling temperature.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Prompt tokens.
    pub tokens_in: u64,
    /// Completion tokens.
    pub tokens_out: u64,
    /// An answer was cut off.
    pub truncated: bool,
    /// Answers that were no action.
    pub invalid_actions: u64,
}

impl ModelMetrics {
    fn count(&mut self, turn: &ChatTurn) {
        let usage = turn.usage();
        self.tokens_in = self.tokens_in.saturating_add(usage.tokens_in);
        self.tokens_out = self.tokens_out.saturating_add(usage.tokens_out);
        self.truncated |= turn.completions.iter().any(|completion| completion.cut);
        self.invalid_actions += u64::from(turn.invalid);
    }
}

/// What came of an episode.
#[derive(Debug)]
pub struct RolloutOutcome {
    /// How it was flown, or why the infrastructure lost it.
    pub flight: Result<RecordedEpisode, String>,
    /// What a language model took; none of a built-in policy.
    pub metrics: Option<ModelMetrics>,
}

/// Flies an episode by a built-in policy.
#[must_use]
pub fn built_in(scenario: &Scenario, policy: &str, seed: u64, room: &RecordingBudget) -> RolloutOutcome {
    let fly = || -> Result<RecordedEpisode, String> {
        let mut policy = scenario.task().policy(policy, scenario, seed).map_err(|e| e.to_string())?;
        let mut tape = EpisodeRecorder::begin(scenario, room).map_err(|error| error.to_string())?;
        while !tape.done() {
            tape.ask(&mut *policy);
            tape.step(None).map_err(|error| error.to_string())?;
        }
        Ok(tape.end())
    };
    RolloutOutcome { flight: fly(), metrics: None }
}

/// Flies an episode by a language model, in a conversation of its own.
pub async fn chat(
    run: &str,
    scenario: &Scenario,
    endpoint: &Endpoint,
    settings: &PolicySettings,
    room: &RecordingBudget,
) -> RolloutOutcome {
    let mut metrics = ModelMetrics { temperature: settings.temperature, ..ModelMetrics::default() };
    let flight = converse(run, scenario, endpoint, settings, room, &mut metrics).await;
    RolloutOutcome { flight, metrics: Some(metrics) }
}

async fn converse(
    run: &str,
    scenario: &Scenario,
    endpoint: &Endpoint,
    settings: &PolicySettings,
    room: &RecordingBudget,
    metrics: &mut ModelMetrics,
) -> Result<RecordedEpisode, String> {
    let prompt = TaskPrompt::new(ActionCodec::new(scenario.task()), ObservationFormat::Compact);
    let settings = ChatSettings {
        run: run.to_owned(),
        history: settings.history as usize,
        temperature: settings.temperature,
        max_tokens: settings.max_tokens.unwrap_or(endpoint.llm.config().max_tokens),
    };
    let mut policy = ChatPolicy::new(endpoint.llm.clone(), prompt, settings);
    let mut tape = EpisodeRecorder::begin(scenario, room).map_err(|error| error.to_string())?;
    while !tape.done() {
        let turn = policy.act(&tape.seen()).await.map_err(|error: LlmError| error.to_string())?;
        metrics.count(&turn);
        let refused = match whose(&turn, endpoint.llm.is_responsive()) {
            Whose::Nobodys => {
                // What the policy says is an action of the task; what this episode refuses of it is the agent's.
                let read = openenv_wire::wire_format(scenario.task()).read_action(&turn.action, &mut tape.log);
                let read =
                    read.map_err(|faults| faults.first().map_or_else(String::new, ToString::to_string));
                read.err().or_else(|| tape.step(Some(turn.completions.clone())).err().map(|e| e.to_string()))
            }
            Whose::Agents(why) => {
                tape.stop(why, turn.error, turn.completions).map_err(|error| error.to_string())?;
                continue;
            }
            Whose::Endpoints => return Err(turn.error.unwrap_or_default()),
        };
        if let Some(error) = refused {
            let stopped = tape.stop(StopReason::Unparsable, Some(error), turn.completions);
            stopped.map_err(|error| error.to_string())?;
        }
    }
    Ok(tape.end())
}

/// Whose doing it is that there is no action.
enum Whose {
    /// There is one.
    Nobodys,
    /// The agent's.
    Agents(StopReason),
    /// The endpoint's.
    Endpoints,
}

/// An answer that is no action is the agent's doing. So is one that does not come in time while the endpoint answers
/// `others`; where it answers nobody, or talks nonsense, the endpoint fails.
fn whose(turn: &ChatTurn, others: bool) -> Whose {
    match (turn.failure, others) {
        (None, _) => Whose::Nobodys,
        (Some(ActionFailure::Invalid), _) => Whose::Agents(StopReason::Unparsable),
        (Some(ActionFailure::CutOff), _) => Whose::Agents(StopReason::TooLong),
        (Some(ActionFailure::Timeout), true) => Whose::Agents(StopReason::TooLate),
        (Some(ActionFailure::Timeout), false) | (Some(ActionFailure::MalformedResponse), _) => Whose::Endpoints,
    }
}
