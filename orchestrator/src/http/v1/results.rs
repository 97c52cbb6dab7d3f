//! Results: batches of finished and failed episodes.

use axum::extract::{Request, State};
use env_core::StopReason;
use env_core::log::Precision;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::{Bytes, Json, NoQuery, Path};
use super::super::problem::Problem;
use super::super::room::aside;
use super::run_id;
use crate::input;
use crate::http::state::AppState;
use crate::store::to_json;
use crate::results::refusal::{Refusal, RefusalCode};
use crate::results::report::ReportReceipts;
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::results::report_summary::{ReportSummary, ClosedGroup, RefilledGroups};
use crate::results::receipt::Receipt;
use curriculum::LevelMove;

/// Most results of a batch.
const MAX_RESULTS: usize = 5000;
/// Longest reason of a failure, characters.
const MAX_REASON: usize = 1000;

/// A batch of results.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Results {
    /// The policy that flew them, where an episode does not say (the lease's).
    policy_version: Option<u32>,
    /// At most 5 000, and 16 MiB together: episodes of many steps come fewer at a time.
    #[schema(value_type = Vec<ResultItem>)]
    results: Vec<Value>,
}

/// One episode's result. There is no score in it: that comes from the actions.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ResultItem {
    /// The episode's id.
    episode: String,
    /// Whether it was flown, or the infrastructure lost it (finished).
    #[serde(default = "finished")]
    status: Status,
    /// What every agent did; needed when finished.
    actions: Option<Actions>,
    /// Why it failed, in a few words.
    reason: Option<String>,
    /// The policy that flew it.
    policy_version: Option<u32>,
    /// What the trainer wants to remember of it.
    metrics: Option<Metrics>,
}

#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum Status {
    Finished,
    Failed,
}

const fn finished() -> Status {
    Status::Finished
}

/// An action log.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Actions {
    /// One entry a step, the first step's first, in the task's own form: a list of `[agent, value, …]` with the values of its action space, as
    /// `[satellite, dvx, dvy]` for kessler. An agent without an entry goes on as it is.
    #[schema(value_type = Vec<Vec<Vec<Value>>>, example = json!([[[0, 0.1, 0.0]], [], []]))]
    pub(super) steps: Vec<Value>,
    /// `f32` or `f64` (default): the precision the actions were taken in.
    #[serde(default)]
    pub(super) precision: PrecisionWord,
    /// Why the log ends before the episode: `unparsable`, `too_long` or `too_late`. The rest is flown as hold.
    pub(super) stopped: Option<StoppedWord>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum PrecisionWord {
    F32,
    #[default]
    F64,
}

#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum StoppedWord {
    Unparsable,
    TooLong,
    TooLate,
}

impl From<PrecisionWord> for Precision {
    fn from(word: PrecisionWord) -> Self {
        match word {
            PrecisionWord::F32 => Self::F32,
            PrecisionWord::F64 => Self::F64,
        }
    }
}

impl From<StoppedWord> for StopReason {
    fn from(word: StoppedWord) -> Self {
        match word {
            StoppedWord::Unparsable => Self::Unparsable,
            StoppedWord::TooLong => Self::TooLong,
            StoppedWord::TooLate => Self::TooLate,
        }
    }
}

/// What a trainer may log of an episode.
#[derive(Debug, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
struct Metrics {
    /// Sampling temperature.
    #[serde(skip_serializing_if = "Option::is_none")]
    temperature: Option<f64>,
    /// Prompt tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    tokens_in: Option<u64>,
    /// Completion tokens.
    #[serde(skip_serializing_if = "Option::is_none")]
    tokens_out: Option<u64>,
    /// An answer was cut off.
    #[serde(skip_serializing_if = "Option::is_none")]
    truncated: Option<bool>,
    /// Answers that were no action.
    #[serde(skip_serializing_if = "Option::is_none")]
    invalid_actions: Option<u64>,
    /// Mean positive value loss over its steps: what `plr` and its kin go by under `score: positive_value_loss`.
    #[serde(skip_serializing_if = "Option::is_none")]
    positive_value_loss: Option<f64>,
    /// Its MaxMC regret: the same under `score: max_mc`.
    #[serde(skip_serializing_if = "Option::is_none")]
    max_mc: Option<f64>,
}

/// What became of a batch.
#[derive(Serialize, ToSchema)]
pub(super) struct Receipts {
    /// One per result, in order.
    results: Vec<Receipt>,
    /// Level moves that these results caused.
    #[schema(value_type = Vec<Object>)]
    moves: Vec<LevelMove>,
    /// Groups that these results closed.
    groups: Vec<ClosedGroup>,
    /// Groups that leases were given in place of those whose episodes all have the same score (`refill`).
    refills: Vec<RefilledGroups>,
}

/// Report results. Idempotent: what was reported before is answered as before and counts once. Each result gets its own
/// answer; one that is refused does not touch the others. The answer comes after everything is on disk.
#[utoipa::path(
    post, path = "/runs/{run}/results", tag = "results", request_body = Results,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Receipts), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn report(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    request: Request,
) -> Result<axum::Json<Receipts>, Problem> {
    let run = run_id(&run)?;
    let (body, _room) = app.room.body(request).await?;
    let (policy_version, claims) = aside(move || claims(body)).await?;
    let ReportReceipts { receipts: results, summary } = app.desk.submit_results(run, policy_version, claims).await?;
    let ReportSummary { moves, groups, refills } = summary;
    Ok(axum::Json(Receipts { results, moves, groups, refills }))
}

/// What a body claims, and the policy version it names.
fn claims(body: Bytes) -> Result<(Option<u32>, Vec<ReportedEpisode>), Problem> {
    let Json(body) = Json::<Results>::of(body)?;
    if body.results.len() > MAX_RESULTS {
        let detail = format!("{} results; at most {MAX_RESULTS} are taken at a time", body.results.len());
        return Err(Problem::invalid("results", detail));
    }
    let claims = body.results.into_iter().enumerate().map(claim).collect::<Result<_, _>>()?;
    Ok((body.policy_version, claims))
}

/// One result. What is wrong with it is its own affair as long as it says of which episode it is.
fn claim((at, value): (usize, Value)) -> Result<ReportedEpisode, Problem> {
    let episode = value.get("episode").and_then(Value::as_str).map(str::to_owned);
    match (input::from_value(value), episode) {
        (Ok(item), _) => claimed(item),
        (Err(fault), Some(episode)) => {
            let detail = format!("{}: {}", fault.field, fault.reason);
            let outcome = ReportedOutcome::Refused(Refusal::new(RefusalCode::InvalidResult, detail));
            Ok(ReportedEpisode { episode, outcome, policy_version: None, metrics: None })
        }
        (Err(fault), None) => {
            let dot = if fault.field.is_empty() { "" } else { "." };
            Err(Problem::invalid(format!("results.{at}{dot}{}", fault.field), fault.reason))
        }
    }
}

fn claimed(item: ResultItem) -> Result<ReportedEpisode, Problem> {
    let refused = |why: &str| ReportedOutcome::Refused(Refusal::new(RefusalCode::InvalidLog, format!("actions: {why}")));
    let outcome = match (item.status, item.actions) {
        (Status::Finished, Some(actions)) => ReportedOutcome::Finished {
            steps: actions.steps,
            precision: actions.precision.into(),
            stopped: actions.stopped.map(Into::into),
        },
        (Status::Finished, None) => refused("a finished episode needs them"),
        (Status::Failed, None) => {
            ReportedOutcome::Failed { reason: item.reason.unwrap_or_default().chars().take(MAX_REASON).collect() }
        }
        (Status::Failed, Some(_)) => refused("a failed episode has none that count; leave them out"),
    };
    let metrics = item.metrics.map(|m| to_json(&m)).transpose()?;
    Ok(ReportedEpisode { episode: item.episode, outcome, policy_version: item.policy_version, metrics })
}
