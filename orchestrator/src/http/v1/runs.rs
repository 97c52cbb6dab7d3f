//! Runs: create, list, show, pause, archive, resume.

use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::super::access::Caller;
use super::super::extract::{Json, NoQuery, Path, Query};
use super::super::problem::Problem;
use super::failures::Backlog;
use super::{Page, next, run_id};
use crate::clock::rfc3339;
use crate::ids::LeaseId;
use crate::judging::Judge;
use crate::http::state::AppState;
use crate::store::run_warnings::{self, RunWarningRow, RunWarnings};
use crate::store::runs::{self, RunCursor, RunRow};
use crate::store::{from_json, to_u64};
use crate::runs::settings::RunSettings;
use crate::engine::error::ServiceError;
use crate::runs::create_run::CreateRun;
use crate::runs::settings::RunRequest;
use crate::runs::run_status::{RunAction, SetRunStatus, SetPolicyVersion};

/// A run.
#[derive(Serialize, ToSchema)]
pub(super) struct Run {
    /// Its id.
    id: String,
    /// Its name for people.
    name: String,
    /// The seed of its random streams.
    seed: u64,
    /// `active` or `paused`.
    status: String,
    /// When it was made, RFC 3339.
    created_at: String,
    /// When it was archived, RFC 3339.
    archived_at: Option<String>,
    /// The newest policy version a trainer reported.
    policy_version: i64,
    /// Its settings, complete.
    #[schema(value_type = Object)]
    settings: RunSettings,
}

impl Run {
    pub(super) fn of(row: RunRow) -> Result<Self, Problem> {
        Ok(Self {
            settings: from_json("a run's settings", &row.settings)?,
            id: row.id,
            name: row.name,
            seed: to_u64(row.seed),
            status: row.status.to_string(),
            created_at: rfc3339(row.created_at),
            archived_at: row.archived_at.map(rfc3339),
            policy_version: row.policy_version,
        })
    }
}

/// A run, and how far what happens behind the acknowledgement has come.
#[derive(Serialize, ToSchema)]
pub(super) struct RunNow {
    /// The run.
    #[serde(flatten)]
    run: Run,
    /// How far the critique is behind.
    critique: Backlog,
    /// What somebody should know before trusting it: how much, and the newest.
    marks: Marks,
}

/// What somebody should know of a run.
#[derive(Serialize, ToSchema)]
struct Marks {
    /// How many there are.
    count: i64,
    /// The newest first, at most 20.
    newest: Vec<Mark>,
}

/// A mark.
#[derive(Serialize, ToSchema)]
struct Mark {
    /// `refused_claim`: a trainer's columns said other than its logs.
    kind: String,
    /// The lease that it is about.
    lease: Option<String>,
    /// A sentence.
    words: String,
    /// When, RFC 3339.
    at: String,
}

/// Marks that are shown.
const MARKS: i64 = 20;

impl From<RunWarningRow> for Mark {
    fn from(row: RunWarningRow) -> Self {
        let lease = row.lease.zip(row.token).map(|(number, token)| LeaseId { number, token }.to_string());
        Self { kind: row.kind.to_string(), lease, words: row.words, at: rfc3339(row.at) }
    }
}

/// A page of runs.
#[derive(Serialize, ToSchema)]
pub(super) struct Runs {
    /// Oldest first.
    runs: Vec<Run>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// Create a run. Everything may be left out: `{}` is a ladder over the tasks of the first world.
#[utoipa::path(
    post, path = "/runs", tag = "runs", request_body = RunRequest,
    responses(
        (status = 201, body = Run),
        (status = 400, body = Problem), (status = 409, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn create(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Json(wish): Json<RunRequest>,
) -> Result<(StatusCode, axum::Json<Run>), Problem> {
    if wish.judge == Some(Judge::Llm) && !app.judges.has_model() {
        let reason = "this server has no language model that judges; serve with --judge-url or --llm-url";
        return Err(ServiceError::Invalid { field: "judge".to_owned(), reason: reason.to_owned() }.into());
    }
    let row = app.writer.change(CreateRun::read(&wish)?.of(caller.owns(app.each.runs))).await?;
    tracing::info!(run = %row.id, "A run was created.");
    Ok((StatusCode::CREATED, axum::Json(Run::of(row)?)))
}

/// Which runs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Which {
    /// Those that are archived, instead of the others (false).
    #[serde(default)]
    archived: bool,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// List runs, oldest first.
#[utoipa::path(
    get, path = "/runs", tag = "runs", params(Which),
    responses((status = 200, body = Runs), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Query(which): Query<Which>,
) -> Result<axum::Json<Runs>, Problem> {
    let page = Page { limit: which.limit, cursor: which.cursor };
    let limit = page.limit()?;
    let mut conn = app.readers.acquire().await?;
    let (created_at, id) = page.cursor()?;
    let rows = runs::page(&mut conn, RunCursor { created_at, id }, which.archived, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.created_at, row.id.as_str())));
    Ok(axum::Json(Runs { runs: rows.into_iter().map(Run::of).collect::<Result<_, _>>()?, next }))
}

/// Show a run.
#[utoipa::path(
    get, path = "/runs/{run}", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = RunNow), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunNow>, Problem> {
    let run = run_id(&run)?;
    let mut conn = app.readers.acquire().await?;
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let critique = Backlog::look(&mut conn, &run).await?;
    let RunWarnings { count, newest } = run_warnings::newest(&mut conn, run.as_str(), MARKS).await?;
    let marks = Marks { count, newest: newest.into_iter().map(Mark::from).collect() };
    Ok(axum::Json(RunNow { run: Run::of(row)?, critique, marks }))
}

/// Pause a run: it grants no more leases; results of those it has granted are still taken.
#[utoipa::path(
    post, path = "/runs/{run}/pause", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn pause(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Run>, Problem> {
    steer(&app, &run, RunAction::Pause).await
}

/// Archive a run: it is paused, and left out of lists unless those that are archived are asked for. Resuming brings it back.
#[utoipa::path(
    post, path = "/runs/{run}/archive", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn archive(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Run>, Problem> {
    steer(&app, &run, RunAction::Archive).await
}

/// Resume a run that is paused or archived.
#[utoipa::path(
    post, path = "/runs/{run}/resume", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn resume(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Run>, Problem> {
    steer(&app, &run, RunAction::Resume).await
}

/// The newest policy version as it should be.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Newest {
    /// The version.
    policy_version: u32,
}

/// Set the newest policy version. Leases and results raise it by themselves; one that was named by mistake makes all that
/// come after it stale (`max_staleness`) until it is set back here.
#[utoipa::path(
    put, path = "/runs/{run}/policy_version", tag = "runs", request_body = Newest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_newest(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<Newest>,
) -> Result<axum::Json<Run>, Problem> {
    let change = SetPolicyVersion { run: run_id(&run)?, policy_version: wish.policy_version };
    Ok(axum::Json(Run::of(app.writer.change(change).await?)?))
}

async fn steer(app: &AppState, run: &str, course: RunAction) -> Result<axum::Json<Run>, Problem> {
    let row = app.writer.change(SetRunStatus { run: run_id(run)?, course }).await?;
    Ok(axum::Json(Run::of(row)?))
}
