//! Rolls out one episode by a policy: a built-in one, one from a file, or a language model.

use api_types::TrajectoryMetrics;
use env_core::policy_factory::PolicyFactory;
use env_core::{Scenario, StopReason};
use llm::{LlmClient, LlmError};
use llm_policy::{
    ActionCodec, ActionFailure, ChatPolicy, ChatSettings, ChatTurn, ObservationFormat, TaskPrompt,
};
use serde::{Deserialize, Serialize};

use crate::recorder::{EpisodeRecorder, RecordedEpisode, RecordingBudget};

/// Result of rolling out an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RolloutOutcome {
    /// The recorded episode, or why the infrastructure lost it.
    pub episode: Result<RecordedEpisode, String>,
    /// Metrics of the language model; `None` for other policies.
    pub metrics: Option<TrajectoryMetrics>,
}

/// An episode that a built-in policy or one from a file rolls out.
pub(crate) struct PolicyEpisode<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) policy: &'a dyn PolicyFactory,
    /// Seed of a stochastic policy.
    pub(crate) seed: u64,
    pub(crate) budget: &'a RecordingBudget,
    /// Returns false once the result is not wanted any more.
    pub(crate) is_wanted: &'a (dyn Fn() -> bool + Sync),
}

/// Rolls out an episode by a built-in policy or one from a file.
pub(crate) fn roll_out_policy(episode: &PolicyEpisode<'_>) -> RolloutOutcome {
    let PolicyEpisode { scenario, policy, seed, budget, is_wanted } = *episode;
    let roll_out = || -> Result<RecordedEpisode, String> {
        let mut policy = policy.create(scenario, seed).map_err(|error| error.to_string())?;
        let mut recorder = EpisodeRecorder::start(scenario, budget).map_err(|error| error.to_string())?;
        while !recorder.is_done() {
            if !is_wanted() {
                return Err("the rollout was cancelled".to_owned());
            }
            recorder.act(&mut *policy).map_err(|error| error.to_string())?;
            recorder.step(None).map_err(|error| error.to_string())?;
        }
        Ok(recorder.finish())
    };
    RolloutOutcome { episode: roll_out(), metrics: None }
}

/// Rolls out an episode by a language model, in a conversation of its own.
pub(crate) async fn roll_out_chat(
    scenario: &Scenario,
    llm: &LlmClient,
    settings: ChatSettings,
    budget: &RecordingBudget,
) -> RolloutOutcome {
    let mut metrics = TrajectoryMetrics { temperature: settings.temperature, ..TrajectoryMetrics::default() };
    let episode = converse(scenario, llm, settings, budget, &mut metrics).await;
    RolloutOutcome { episode, metrics: Some(metrics) }
}

/// Steps an episode by the model's actions until it is over.
async fn converse(
    scenario: &Scenario,
    llm: &LlmClient,
    settings: ChatSettings,
    budget: &RecordingBudget,
    metrics: &mut TrajectoryMetrics,
) -> Result<RecordedEpisode, String> {
    let prompt = TaskPrompt::new(ActionCodec::new(scenario.task()), ObservationFormat::Compact);
    let mut policy = ChatPolicy::new(llm.clone(), prompt, settings);
    let mut recorder = EpisodeRecorder::start(scenario, budget).map_err(|error| error.to_string())?;
    while !recorder.is_done() {
        let turn = policy.act(&recorder.time_step()).await.map_err(|error: LlmError| error.to_string())?;
        add_turn(metrics, &turn);
        let refused = match TurnResult::of(&turn, llm.is_responsive()) {
            TurnResult::Action => step(&mut recorder, scenario, &turn).err(),
            TurnResult::AgentFailed(reason) => {
                recorder.stop(reason, turn.error, turn.completions).map_err(|error| error.to_string())?;
                continue;
            }
            TurnResult::EndpointFailed => return Err(turn.error.unwrap_or_default()),
        };
        if let Some(error) = refused {
            let stopped = recorder.stop(StopReason::Unparsable, Some(error), turn.completions);
            stopped.map_err(|error| error.to_string())?;
        }
    }
    Ok(recorder.finish())
}

/// Steps the episode by the action of a turn. The policy returns an action of the task; the episode may still refuse it, and then
/// the agent is at fault.
fn step(recorder: &mut EpisodeRecorder<'_>, scenario: &Scenario, turn: &ChatTurn) -> Result<(), String> {
    openenv_wire::wire_format(scenario.task())
        .read_action(&turn.action, &mut recorder.log)
        .map_err(|faults| faults.first().map_or_else(String::new, ToString::to_string))?;
    recorder.step(Some(turn.completions.clone())).map_err(|error| error.to_string())
}

/// Adds a turn to the metrics of its episode.
fn add_turn(metrics: &mut TrajectoryMetrics, turn: &ChatTurn) {
    let usage = turn.usage();
    metrics.tokens_in = metrics.tokens_in.saturating_add(usage.tokens_in);
    metrics.tokens_out = metrics.tokens_out.saturating_add(usage.tokens_out);
    metrics.truncated |= turn.completions.iter().any(|completion| completion.truncated);
    metrics.invalid_actions += u64::from(turn.invalid);
}

/// Result of a turn: an action, or who is at fault that there is none.
enum TurnResult {
    /// The model returned an action.
    Action,
    /// The agent is at fault: the episode is stopped, and counts.
    AgentFailed(StopReason),
    /// The endpoint is at fault: the episode is lost.
    EndpointFailed,
}

impl TurnResult {
    /// Decides who is at fault. An answer that is no action is the agent's fault. So is a timeout while the endpoint answers other
    /// requests (`is_responsive`). If it answers none, or returns a malformed response, the endpoint fails.
    fn of(turn: &ChatTurn, is_responsive: bool) -> Self {
        match (turn.failure, is_responsive) {
            (None, _) => Self::Action,
            (Some(ActionFailure::Invalid), _) => Self::AgentFailed(StopReason::Unparsable),
            (Some(ActionFailure::CutOff), _) => Self::AgentFailed(StopReason::TooLong),
            (Some(ActionFailure::Timeout), true) => Self::AgentFailed(StopReason::TooLate),
            (Some(ActionFailure::Timeout), false) | (Some(ActionFailure::MalformedResponse), _) => {
                Self::EndpointFailed
            }
        }
    }
}
