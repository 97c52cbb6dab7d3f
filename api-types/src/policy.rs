//! Policy that the server runs for a run: its settings, its progress and the fill level of its feed.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Fill level of a trajectory feed.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FeedStatus {
    /// Number of groups that wait to be delivered.
    pub waiting: i64,
    /// Number of delivered groups whose claim has not expired.
    pub delivered: i64,
    /// Number of acknowledged groups that can still be read again.
    pub acknowledged: i64,
    /// Size of the unacknowledged groups as stored, bytes.
    pub bytes: i64,
    /// True if the server rolls out no more groups until the trainer acknowledges some.
    pub full: bool,
}

/// Latest error of a run's policy.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunPolicyError {
    /// Description in one sentence.
    pub message: String,
    /// Time of the error, RFC 3339.
    pub at: String,
}

/// Request to set the policy of a run. A field that is left out gets its default, except that `version` keeps its value.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolicyRequest {
    /// `off`, `chat` (the language model that the server or a worker was started with), a built-in policy that every task of the
    /// run has (`GET /v1/tasks` lists them), or a file in the server's policy folder, such as `onnx:model.onnx`. `reference` is not
    /// allowed, because its trajectories are the planner's plans.
    #[schema(example = "heuristic")]
    pub policy: String,
    /// Version of the policy, which groups that start later get. Raise it when the endpoint serves new weights; it never decreases.
    pub version: Option<u32>,
    /// Sampling temperature of `chat`, from 0 to 5 (default: the server's setting, else that of the worker that rolls out, else the
    /// endpoint's).
    #[schema(minimum = 0.0, maximum = 5.0)]
    pub temperature: Option<f64>,
    /// Number of earlier exchanges in the prompt of `chat`, from 0 to 64 (default 2).
    #[schema(minimum = 0, maximum = 64, default = 2)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 64>")]
    pub history: Option<u32>,
    /// Largest number of tokens of one reply of `chat`, from 16 to 131 072 (default: the setting of the server or the worker that
    /// rolls out).
    #[schema(minimum = 16, maximum = 131_072)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 16, 131_072>")]
    pub max_tokens: Option<u32>,
    /// Observations in trajectories (default `telemetry`).
    pub observations: Option<ObservationMode>,
    /// Largest number of unacknowledged groups in the feed, from 1 to 4 096 (default 32).
    #[schema(minimum = 1, maximum = 4096, default = 32)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 4096>")]
    pub max_unacknowledged_groups: Option<u32>,
    /// True to replace groups whose episodes all have the same score (default false).
    pub refill: Option<bool>,
    /// How trainers receive groups (default `http`). `nats` needs a server that was started with `--nats`.
    pub delivery: Option<FeedDelivery>,
}

/// Settings of a run's policy, complete, as stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PolicySettings {
    /// Sampling temperature of `chat`; null for the setting of the worker that rolls out, else the endpoint's.
    pub temperature: Option<f64>,
    /// Number of earlier exchanges in the prompt of `chat`.
    pub history: u32,
    /// Largest number of tokens of one reply of `chat`; null for the setting of the server or the worker that rolls out.
    pub max_tokens: Option<u32>,
    /// Observations that trajectories have.
    pub observations: ObservationMode,
    /// Largest number of unacknowledged groups in the feed.
    pub max_unacknowledged_groups: u32,
    /// True if groups whose episodes all have the same score are replaced.
    #[serde(default)]
    pub refill: bool,
    /// How trainers receive groups.
    #[serde(default)]
    pub delivery: FeedDelivery,
}

/// Default number of unacknowledged groups in a feed.
const DEFAULT_MAX_UNACKNOWLEDGED_GROUPS: u32 = 32;
/// Default number of earlier exchanges in a prompt, the same as in `sparring play`.
const DEFAULT_HISTORY: u32 = 2;

impl Default for PolicySettings {
    fn default() -> Self {
        Self {
            temperature: None,
            history: DEFAULT_HISTORY,
            max_tokens: None,
            observations: ObservationMode::default(),
            max_unacknowledged_groups: DEFAULT_MAX_UNACKNOWLEDGED_GROUPS,
            refill: false,
            delivery: FeedDelivery::default(),
        }
    }
}

/// Kind of observations in trajectories.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationMode {
    /// The observation of each step, in the wire form.
    #[default]
    Telemetry,
    /// Trajectories have no observations.
    None,
}

/// Delivery of the groups of a feed to trainers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FeedDelivery {
    /// Trainers claim groups over HTTP.
    #[default]
    Http,
    /// The server publishes groups to a stream on NATS, too. Acknowledgements of its consumers acknowledge groups.
    Nats,
}

/// Policy of a run, with its settings and progress.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunPolicyState {
    /// `off`, `chat`, or the name of a built-in policy.
    pub policy: String,
    /// Version of the policy, which new groups get.
    pub version: i64,
    /// Settings of the policy.
    #[serde(flatten)]
    pub settings: PolicySettings,
    /// Language model of the server for `chat`; null for another policy, and if the server has none. Its endpoint is not disclosed.
    pub model: Option<String>,
    /// Language models of connected workers for `chat`, each once; empty for another policy. Workers roll out first, and the server
    /// if they have no room.
    #[serde(default)]
    pub worker_models: Vec<String>,
    /// Time of the latest change, RFC 3339.
    pub changed_at: Option<String>,
    /// Number of groups pushed to the feed.
    pub groups: i64,
    /// Number of episodes in these groups.
    pub episodes: i64,
    /// Number of episodes that the infrastructure lost, usually because of the model's endpoint.
    pub failed: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Fill level of the feed.
    pub feed: FeedStatus,
    /// Latest error of the policy.
    pub last_error: Option<RunPolicyError>,
}
