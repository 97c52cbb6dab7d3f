//! Designs of a run, and the requests to designers that they come from.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::ScenarioBracket;

/// Choice of the designer of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignerChoice {
    /// The language model if the server or a worker that designs has one, else the procedural designer.
    Auto,
    /// The language model. The procedural designer makes the layouts that the model fails to deliver.
    Llm,
    /// The procedural designer, without a model.
    Procedural,
    /// No designer: nothing is designed.
    Off,
}

/// Request to a designer. All fields are optional.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CreateDesignRequest {
    /// Task of the run to design for (default: the task whose failures weigh most).
    pub task: Option<String>,
    /// Number of layouts, from 1 to 32 (default: the run's reserve).
    #[schema(minimum = 1, maximum = 32)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 32>")]
    pub count: Option<u32>,
    /// Designer: `auto`, `llm` or `procedural` (default: the run's designer).
    pub designer: Option<DesignerChoice>,
}

/// Request to a designer, as lists show it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignRequestSummary {
    /// Id of the request.
    pub id: String,
    /// Id of the task.
    pub task: String,
    /// Level to design for; null before the request starts, and under a strategy without levels.
    pub level: Option<i64>,
    /// Designer of the layouts. The procedural designer makes those that a language model fails to deliver.
    pub designer: DesignerKind,
    /// Origin of the request.
    pub requested_by: DesignRequestOrigin,
    /// State of the request.
    pub state: DesignRequestState,
    /// Number of requested layouts.
    pub wanted: i64,
    /// Number of layouts that the gate admitted.
    pub admitted: i64,
    /// Number of designs that the gate refused.
    pub refused: i64,
    /// Language model; null for the procedural designer.
    pub model: Option<String>,
    /// Version of the model's prompt.
    pub prompt_version: Option<String>,
    /// Number of rounds of all designers together.
    pub rounds: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost of the tokens, in the currency of the configured prices.
    pub cost: f64,
    /// Duration of the request, milliseconds.
    pub latency_ms: i64,
    /// Number of criticised episodes behind the failure profile.
    pub criticised: Option<i64>,
    /// Problems that did not end the request, one sentence each.
    pub warnings: Vec<String>,
    /// Reason of a failure.
    pub error: Option<String>,
    /// Time of creation, RFC 3339.
    pub created_at: String,
    /// Time of its end, RFC 3339.
    pub ended_at: Option<String>,
}

/// Page of requests to designers.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignRequestPage {
    /// Requests of the page, newest first.
    pub requests: Vec<DesignRequestSummary>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Request to a designer, with the failure profile it is based on.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignRequest {
    /// The request, as lists show it.
    #[serde(flatten)]
    pub summary: DesignRequestSummary,
    /// Failure profile at the start of the request; null before.
    #[schema(value_type = Option<Object>)]
    pub profile: Option<Value>,
}

/// Query of the requests to designers.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct DesignRequestQuery {
    /// Id of the task.
    pub task: Option<String>,
    /// State: `waiting`, `running`, `done` or `failed`.
    pub state: Option<String>,
    /// Largest number of requests on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}

/// Design, as lists show it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignSummary {
    /// Id of the design and of its layout.
    pub id: String,
    /// Id of the run.
    pub run: String,
    /// Id of the task.
    pub task: String,
    /// Level that the design is for; null under a strategy without levels.
    pub level: Option<i64>,
    /// Start rung that the design is for; null if the rungs of the task are its levels.
    pub start_rung: Option<i64>,
    /// Name that the designer gave it.
    pub name: String,
    /// Id of the design request.
    pub request: String,
    /// Designer that made the design.
    pub designer: DesignerKind,
    /// Round of the request: 1, plus 1 for each repair.
    pub round: i64,
    /// Failure that the design aims at; null if the design could not be read.
    pub aim: Option<DesignAim>,
    /// Kind of the layout; null if the design was refused.
    pub kind: Option<LayoutKind>,
    /// State of the design.
    pub state: DesignState,
    /// Reason of retirement (`mastered`, `hopeless`, `user` or `wrong`), or the check of the gate that refused the design.
    pub state_reason: Option<String>,
    /// Reason of the refusal in one sentence.
    pub refusal_reason: Option<String>,
    /// Distance to the nearest earlier design, from 0 to 1; null for the first.
    pub novelty: Option<f64>,
    /// Results of the agent on the layout.
    pub results: DesignResults,
    /// Time of creation, RFC 3339.
    pub created_at: String,
    /// Time of the latest lease, RFC 3339.
    pub served_at: Option<String>,
    /// Time of retirement, RFC 3339.
    pub retired_at: Option<String>,
}

/// Failure that a design aims at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DesignAim {
    /// Name of the failure mode.
    pub mode: String,
    /// Bearing of the threat from its agent, degrees in `frame`; null if the aim has no direction.
    pub bearing_deg: Option<i64>,
    /// Frame of the bearing; null in a world with one frame.
    pub frame: Option<String>,
}

/// Results of the agent on a layout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DesignResults {
    /// Number of leased groups.
    pub groups: i64,
    /// Number of closed groups.
    pub outcomes: i64,
    /// Number of finished episodes in the closed groups.
    pub episodes: i64,
    /// Number of successful episodes.
    pub successes: i64,
    /// Success rate: successes / episodes.
    pub success: Option<f64>,
    /// Mean score of the episodes.
    pub score: Option<f64>,
    /// Mean regret: (reference − score) / (reference − floor), clamped to 0 to 1.
    pub regret: Option<f64>,
    /// Share with the aimed failure mode, among the criticised episodes with a failure.
    pub as_aimed: Option<f64>,
    /// Success rates of the latest groups since the layout was admitted or restored, oldest first, at most 16.
    pub recent: Vec<f64>,
}

/// Page of the list of designs.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignPage {
    /// Designs of the page, newest first.
    pub designs: Vec<DesignSummary>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Query of the designs of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct DesignQuery {
    /// Id of the task.
    pub task: Option<String>,
    /// State: `active`, `retired` or `refused`.
    pub state: Option<String>,
    /// Failure mode that the design aims at.
    pub mode: Option<String>,
    /// Id of the design request.
    pub request: Option<String>,
    /// Largest number of designs on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}

/// Design with its parts, its scenario and its history.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Design {
    /// The design, as lists show it.
    #[serde(flatten)]
    pub summary: DesignSummary,
    /// Design in the language of its world: aim, params and parts (encounters, deputies or fields). A refused design is as the designer
    /// returned it, an admitted one as the gate read it. Null if it was too long to keep.
    #[schema(value_type = Option<Object>)]
    pub design: Option<Value>,
    /// The design as a table for display; null if it cannot be read.
    pub table: Option<DesignTable>,
    /// Id of the scenario; null if the design was refused. `GET /v1/layouts/{layout}` returns the bodies.
    pub scenario_id: Option<String>,
    /// Bracket of the scenario; null if the design was refused.
    pub bracket: Option<ScenarioBracket>,
    /// Changes of state, oldest first.
    pub transitions: Vec<DesignTransition>,
    /// Ids of the newest finished episodes on the layout, newest first, at most 16.
    pub episodes: Vec<String>,
}

/// Design as a table for display, by the language of its world.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DesignTable {
    /// Aim in a few words.
    pub aim: String,
    /// Titles of the columns, with units.
    pub header: Vec<String>,
    /// Parts of the design, such as encounters, deputies or fields, one row each.
    pub rows: Vec<Vec<String>>,
}

/// Change of a design's state.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignTransition {
    /// State after the change.
    pub state: DesignState,
    /// Reason of the change.
    pub reason: String,
    /// Time of the change, RFC 3339.
    pub at: String,
}

/// Kind of a designer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignerKind {
    /// Designer that calls a language model.
    Llm,
    /// Designer that samples and edits layouts, without a model.
    Procedural,
}

/// Origin of a design request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignRequestOrigin {
    /// The design worker: the reserve ran low, or the failures changed.
    Worker,
    /// A user of the API.
    User,
}

/// State of a design request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignRequestState {
    /// The request waits for the design worker.
    Waiting,
    /// The designer works on the request.
    Running,
    /// The designer has finished.
    Done,
    /// The designer failed, or the server stopped meanwhile.
    Failed,
}

/// State of a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DesignState {
    /// The layout is served.
    Active,
    /// The layout is no longer served, except for an occasional probe.
    Retired,
    /// The gate refused the design.
    Refused,
}

/// Kind of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LayoutKind {
    /// An agent that does nothing loses.
    Threat,
    /// An agent that does nothing succeeds, and acting is a waste.
    Decoy,
}
