//! Results of episodes and their receipts.

use curriculum::LevelMove;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::GroupState;

/// Batch of results of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResultsRequest {
    /// Policy version of episodes that do not name one (default: the lease's).
    pub policy_version: Option<u32>,
    /// Results, at most 5 000 and 16 MiB together. A malformed result is refused on its own if it names its episode.
    #[schema(value_type = Vec<EpisodeResult>)]
    pub results: Vec<Value>,
}

/// Result of one episode. It has no score: the server replays the actions.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EpisodeResult {
    /// Id of the episode.
    pub episode: String,
    /// `finished` (default), or `failed` if the infrastructure lost the episode.
    #[serde(default)]
    pub status: EpisodeResultStatus,
    /// Actions of all agents; required if finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actions: Option<EpisodeActions>,
    /// Reason of a failure, cut to 1 000 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Policy version that ran the episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy_version: Option<u32>,
    /// Metrics of the trainer, stored with the episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<EpisodeMetrics>,
}

/// State of a reported episode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeResultStatus {
    /// The episode was run to its end.
    #[default]
    Finished,
    /// The infrastructure lost the episode.
    Failed,
}

/// Action log of an episode.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EpisodeActions {
    /// One entry for each step, first step first: a list of `[agent, value, …]` with the values of the task's action space, for
    /// example `[satellite, dvx, dvy]` in kessler. An agent without an entry does not act.
    #[schema(value_type = Vec<Vec<Vec<Value>>>, example = json!([[[0, 0.1, 0.0]], [], []]))]
    pub steps: Vec<Value>,
    /// Precision of the actions: `f32` or `f64` (default).
    #[serde(default)]
    pub precision: ActionPrecision,
    /// Reason why the log ends before the episode: `unparsable`, `too_long` or `too_late`. The rest is replayed without actions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<ActionStopReason>,
}

/// Floating-point precision of actions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionPrecision {
    /// Single precision, 32 bits.
    F32,
    /// Double precision, 64 bits.
    #[default]
    F64,
}

/// Reason why an action log ends before the episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionStopReason {
    /// The agent's output could not be parsed.
    Unparsable,
    /// The agent's output was too long.
    TooLong,
    /// The agent answered too late.
    TooLate,
}

/// Metrics that a trainer may store with an episode.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeMetrics {
    /// Sampling temperature of the policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Number of prompt tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens_in: Option<u64>,
    /// Number of completion tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens_out: Option<u64>,
    /// True if a completion was truncated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truncated: Option<bool>,
    /// Number of completions without a valid action.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub invalid_actions: Option<u64>,
    /// Mean positive value loss over the steps, for `plr` and related strategies with `score: positive_value_loss`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub positive_value_loss: Option<f64>,
    /// MaxMC regret, for the same strategies with `score: max_mc`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_mc: Option<f64>,
}

/// Response to a batch of results.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ResultsResponse {
    /// One receipt for each result, in order.
    pub results: Vec<ResultReceipt>,
    /// Level moves that these results caused.
    #[schema(value_type = Vec<Object>)]
    pub moves: Vec<LevelMove>,
    /// Groups that these results closed.
    pub groups: Vec<GroupReceipt>,
    /// Groups that replace groups whose episodes all have the same score (`refill`).
    pub refills: Vec<GroupRefill>,
}

/// Receipt of one reported episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResultReceipt {
    /// Episode id, as it was sent.
    pub episode: String,
    /// Effect of the report.
    pub status: ReceiptStatus,
    /// Reason of a refusal, for programs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub code: Option<RefusalCode>,
    /// Reason of a refusal for people, one sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// Score of the replay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Skill between floor (0) and reference (1), if the scenario defines one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skill: Option<f64>,
    /// True if the episode was a success by the run's rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<bool>,
}

/// Group that a report closed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GroupReceipt {
    /// Id of its lease.
    pub lease: String,
    /// Number of the group in its lease, from 0.
    pub group: i64,
    /// State of the group: `complete`, `partial` or `lost`.
    pub state: GroupState,
    /// Number of finished episodes.
    pub finished: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Number of episodes without a result when the lease ended.
    pub expired: i64,
    /// Number of successful episodes.
    pub successes: i64,
    /// Mean score of the finished episodes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_score: Option<f64>,
    /// True if all finished episodes have the same score, so that the group carries no learning signal. Left out if fewer than two
    /// episodes finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_variance: Option<bool>,
}

/// Groups that were added to a lease in place of groups with zero variance. `GET` the lease to read them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct GroupRefill {
    /// Id of the lease.
    pub lease: String,
    /// Numbers of the added groups in the lease.
    pub groups: Vec<i64>,
}

/// Effect of the report of one episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReceiptStatus {
    /// The episode counts, and its group can move the curriculum.
    Counted,
    /// The episode is a statistic only. It is of an evaluation, a designed layout, a policy version
    /// that is too old, or a training lease while evidence comes from probes.
    Stored,
    /// The replay agrees with the columns of the lease. The episode counts once all audited ones are reported.
    Audited,
    /// The infrastructure lost the episode.
    Failed,
    /// The lease had ended.
    Late,
    /// The same result was reported before.
    Duplicate,
    /// The result was refused.
    Refused,
}

impl ReceiptStatus {
    /// All values, in the order of their declaration.
    pub const ALL: &[Self] = &[
        Self::Counted,
        Self::Stored,
        Self::Audited,
        Self::Failed,
        Self::Late,
        Self::Duplicate,
        Self::Refused,
    ];

    /// Name of the value, as in JSON and in metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Counted => "counted",
            Self::Stored => "stored",
            Self::Audited => "audited",
            Self::Failed => "failed",
            Self::Late => "late",
            Self::Duplicate => "duplicate",
            Self::Refused => "refused",
        }
    }
}

/// Reason why a reported episode is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RefusalCode {
    /// The episode id is malformed.
    BadId,
    /// The lease has no such episode, or it is not audited.
    UnknownEpisode,
    /// The lease belongs to another run.
    ForeignEpisode,
    /// The lease belongs to another principal.
    ForeignLease,
    /// The fields of the result are invalid.
    InvalidResult,
    /// The action log does not replay.
    InvalidLog,
    /// Another result was reported for the episode before.
    Conflict,
    /// The result names another policy version than its evaluation.
    VersionMismatch,
    /// The run no longer keeps the scenario of the episode, and no result was reported for it.
    Expired,
    /// The replay contradicts the columns of the lease, which are refused.
    ColumnsMismatch,
    /// The group of the episode was not begun, so its scenario is not disclosed.
    NotBegun,
}

impl RefusalCode {
    /// All values, in the order of their declaration.
    pub const ALL: &[Self] = &[
        Self::BadId,
        Self::UnknownEpisode,
        Self::ForeignEpisode,
        Self::ForeignLease,
        Self::InvalidResult,
        Self::InvalidLog,
        Self::Conflict,
        Self::VersionMismatch,
        Self::Expired,
        Self::ColumnsMismatch,
        Self::NotBegun,
    ];

    /// Name of the value, as in JSON and in metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::BadId => "bad_id",
            Self::UnknownEpisode => "unknown_episode",
            Self::ForeignEpisode => "foreign_episode",
            Self::ForeignLease => "foreign_lease",
            Self::InvalidResult => "invalid_result",
            Self::InvalidLog => "invalid_log",
            Self::Conflict => "conflict",
            Self::VersionMismatch => "version_mismatch",
            Self::Expired => "expired",
            Self::ColumnsMismatch => "columns_mismatch",
            Self::NotBegun => "not_begun",
        }
    }
}
