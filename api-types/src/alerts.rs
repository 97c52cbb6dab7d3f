//! Alerts of the server and its runs.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::MissingShard;

/// Rule by which an alert begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlertRule {
    /// A run that had results has had none for some time.
    NoResults,
    /// A large share of a task's episodes is not reported.
    MissingShare,
    /// The disk of the database is nearly full.
    LowDisk,
    /// A task went down a level.
    LevelDown,
    /// A policy is worse than the version before it.
    EvaluationWorse,
    /// A worker on another machine takes no jobs any more.
    WorkerLost,
}

/// State of the message to the webhook.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlertMessageState {
    /// The server had no webhook.
    None,
    /// A message waits for its first or its next attempt.
    Waiting,
    /// The webhook took the message about the beginning, and that about the end if there is one.
    Sent,
    /// The webhook took no message for a day.
    GivenUp,
}

/// Alert of the server or of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Alert {
    /// Number of the alert on its server.
    pub id: i64,
    /// Shard of its server; null for a server without a shard.
    pub shard: Option<String>,
    /// Rule by which it began.
    pub rule: AlertRule,
    /// Id of its run; null for the server as a whole.
    pub run: Option<String>,
    /// Name of the run.
    pub run_name: Option<String>,
    /// Part of the run that it is about, such as a task; empty for the whole of it.
    pub subject: String,
    /// Message as a sentence for people.
    #[schema(example = "no results for 15 minutes; archive or pause a run that has ended")]
    pub message: String,
    /// Time of its beginning, RFC 3339.
    pub began_at: String,
    /// Time of its end, RFC 3339; null while it lasts. An event ends when it begins.
    pub ended_at: Option<String>,
    /// State of the message to the webhook.
    pub message_state: AlertMessageState,
    /// Error of the last failed attempt to send the message; null after a success.
    pub message_error: Option<String>,
}

/// Rule that the server checks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ActiveAlertRule {
    /// Word of the rule, as `--alerts` takes it.
    pub rule: AlertRule,
    /// Condition under which an alert begins, with the limit of this server.
    #[schema(example = "a run that had results has none for 15 minutes")]
    pub condition: String,
}

/// Page of a list of alerts.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AlertPage {
    /// Alerts of the page, newest first.
    pub alerts: Vec<Alert>,
    /// Number of all alerts that last.
    pub lasting: i64,
    /// Rules that the server checks (`--alerts`).
    pub rules: Vec<ActiveAlertRule>,
    /// True if a webhook receives messages about alerts (`--alert-webhook`).
    pub has_webhook: bool,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
    /// Shards whose alerts the page and the number lack; empty for a server without peers.
    #[serde(default)]
    #[schema(required = true)]
    pub missing_shards: Vec<MissingShard>,
}

/// Query of the alerts.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct AlertsQuery {
    /// Id of a run; without it, alerts of all runs and of the server are listed.
    pub run: Option<String>,
    /// True to list only alerts that last (default false).
    #[serde(default)]
    pub lasting: bool,
    /// Largest number of alerts on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}
