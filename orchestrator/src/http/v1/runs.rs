//! Runs: create, get, pause, archive, resume and delete.

use crate::api_enums::ConvertEnum;
use api_types::{
    Judge, PolicyVersionRequest, Run, RunDeletionQuery, RunRequest, RunSummary, RunWarning, RunWarnings,
};
use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use store::ids::LeaseId;
use store::run_warnings::{self, RunWarningRow};
use store::runs::{self, RunRow};
use store::shard::Shard;
use store::{from_json, run_filter, to_u64};

use super::failures::critique_backlog;
use crate::engine::error::ServiceError;
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::shard_routing::{ForwardedRequest, forward};
use crate::http::state::AppState;
use crate::runs::create_run::CreateRun;
use crate::runs::delete_run::DeleteRun;
use crate::runs::run_status::{RunAction, SetRunStatus};
use crate::runs::set_policy_version::SetPolicyVersion;
use clock::{Millis, rfc3339};

/// Age up to which results make a run count as running, in milliseconds.
pub(super) const RECENT: Millis = 60_000;
/// Number of warnings that a run shows.
const MAX_WARNINGS: i64 = 20;

/// Converts the row of a run at the moment `now`.
///
/// # Errors
/// Returns an internal problem if the stored settings cannot be read.
pub(super) fn run_from_row(row: RunRow, now: Millis) -> Result<RunSummary, Problem> {
    Ok(RunSummary {
        activity: run_filter::activity_of(&row, now - RECENT).convert(),
        note: row.note,
        episodes: row.episodes,
        skill: row.skill,
        first_results_at: row.first_results_at.map(rfc3339),
        last_results_at: row.last_results_at.map(rfc3339),
        settings: from_json("a run's settings", &row.settings)?,
        id: row.id,
        name: row.name,
        seed: to_u64(row.seed),
        seed_reused: row.is_seed_reused,
        status: row.status.convert(),
        created_at: rfc3339(row.created_at),
        archived_at: row.archived_at.map(rfc3339),
        policy_version: row.policy_version,
        tags: row.tags.0.into_iter().collect(),
        owner: row.owner,
        members: row.members.0.into_iter().collect(),
    })
}

fn run_warning(row: RunWarningRow) -> RunWarning {
    let lease = row.lease.zip(row.id_suffix).map(|(number, suffix)| LeaseId { number, suffix }.to_string());
    RunWarning { kind: row.kind.convert(), lease, message: row.message, at: rfc3339(row.at) }
}

/// Create a run.
///
/// All fields are optional: `{}` creates a run over the tasks of the first world, under the strategy `auto`. On a server with a shard,
/// an `id` begins with a shard and a dot; the server passes a request for the shard of a peer on.
#[utoipa::path(
    post, path = "/runs", tag = "runs", request_body = RunRequest,
    responses(
        (status = 201, body = RunSummary),
        (status = 400, body = Problem), (status = 409, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn create_run(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Json(request): Json<RunRequest>,
) -> Result<(StatusCode, axum::Json<RunSummary>), Problem> {
    let shard = request.id.as_deref().and_then(Shard::of_id);
    let forwarded = ForwardedRequest::post("/v1/runs", &request);
    if let Some(run) = forward(&app, &headers, shard.as_ref(), forwarded).await? {
        return Ok((StatusCode::CREATED, axum::Json(run)));
    }
    if request.judge == Some(Judge::Llm) && !app.judges.has_model() {
        let reason = "must be off or deterministic, because the server has no language model for judging; start it with --judge-url or --llm-url for llm";
        return Err(ServiceError::Invalid { field: "judge".to_owned(), reason: reason.to_owned() }.into());
    }
    let change = CreateRun::from_request(&request, &app.shards)?;
    let row = app.writer.change(change.owned_by(caller.owner_quota(app.client_limits.runs))).await?;
    tracing::info!(run = %row.id, "Run created.");
    Ok((StatusCode::CREATED, axum::Json(run_from_row(row, app.clock.now())?)))
}

/// Get a run with its warnings.
#[utoipa::path(
    get, path = "/runs/{run}", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn get_run(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Run>, Problem> {
    let run = parse_run_id(&run)?;
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let critique_backlog = critique_backlog(&mut conn, &run).await?;
    let warnings = run_warnings::newest(&mut conn, run.as_str(), MAX_WARNINGS).await?;
    let newest = warnings.newest.into_iter().map(run_warning).collect();
    let warnings = RunWarnings { count: warnings.count, newest };
    Ok(axum::Json(Run { summary: run_from_row(row, app.clock.now())?, critique_backlog, warnings }))
}

/// Pause a run.
///
/// The server grants no more leases of the run and still accepts results of existing leases.
#[utoipa::path(
    post, path = "/runs/{run}/pause", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn pause_run(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunSummary>, Problem> {
    set_status(&app, &run, RunAction::Pause).await
}

/// Archive a run.
///
/// The run is paused, and lists leave it out without `archived=true`. Resume the run to restore it.
#[utoipa::path(
    post, path = "/runs/{run}/archive", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn archive_run(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunSummary>, Problem> {
    set_status(&app, &run, RunAction::Archive).await
}

/// Resume a paused or archived run.
#[utoipa::path(
    post, path = "/runs/{run}/resume", tag = "runs", params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn resume_run(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunSummary>, Problem> {
    set_status(&app, &run, RunAction::Resume).await
}

/// Delete an archived run with its leases, results, layouts and evaluations.
///
/// The deletion is permanent. All later requests for the run return 404. The server deletes the data in the background, within seconds
/// to minutes. Until then no other run can have the id.
#[utoipa::path(
    delete, path = "/runs/{run}", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), RunDeletionQuery),
    responses(
        (status = 200, body = RunSummary, description = "The run before the deletion."), (status = 400, body = Problem),
        (status = 404, body = Problem), (status = 409, body = Problem, description = "The run is not archived."),
        (status = 422, body = Problem), (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn delete_run(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<RunDeletionQuery>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let run = parse_run_id(&run)?;
    let row = app.writer.change(DeleteRun { run: run.clone(), name: query.name }).await?;
    app.sessions.end_run(&run);
    tracing::info!(%run, "Run deleted; its data is deleted in the background.");
    Ok(axum::Json(run_from_row(row, app.clock.now())?))
}

/// Set the newest policy version of a run.
///
/// Results raise it automatically. If a trainer reports a version by mistake, later results are stale (`max_staleness`)
/// until this request corrects the version. A version more than 1 000 000 above the newest is rejected, unless an admin sends it.
#[utoipa::path(
    put, path = "/runs/{run}/policy_version", tag = "runs", request_body = PolicyVersionRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_policy_version(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Json(request): Json<PolicyVersionRequest>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let (run, actor) = (parse_run_id(&run)?, caller.actor());
    let change = SetPolicyVersion { run, policy_version: request.policy_version, actor };
    Ok(axum::Json(run_from_row(app.writer.change(change).await?, app.clock.now())?))
}

async fn set_status(app: &AppState, run: &str, action: RunAction) -> Result<axum::Json<RunSummary>, Problem> {
    let row = app.writer.change(SetRunStatus { run: parse_run_id(run)?, action }).await?;
    Ok(axum::Json(run_from_row(row, app.clock.now())?))
}
