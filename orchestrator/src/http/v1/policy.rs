//! Policy that the server runs for a run.

use api_types::{FeedStatus, PolicyRequest, RunPolicyError, RunPolicyState};
use axum::extract::State;
use store::ids::RunId;
use store::run_policies::{self, RunPolicy, TokenCounts};
use store::trajectories;

use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::{acquire_run_reader, find_run_tasks};
use crate::http::state::AppState;
use crate::rollouts::feed::MAX_UNACKED_BYTES;
use crate::rollouts::settings::{PolicyServer, SetPolicy, settings_from_row};
use clock::rfc3339;

/// Get the policy of a run with its settings and progress.
#[utoipa::path(
    get, path = "/runs/{run}/policy", tag = "trajectories", params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = RunPolicyState), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn get_policy(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<RunPolicyState>, Problem> {
    Ok(axum::Json(policy_state(&app, &parse_run_id(&run)?).await?))
}

/// Set the policy of a run.
///
/// The server, or workers on other machines that take rollouts, roll out the policy. The server pushes finished groups to the
/// trajectory feed of the run. `chat` uses the language model that the server or a worker was started with; a request cannot name
/// another one. A server without a language model accepts `chat` if it was started with `--nats`. Until a worker with a language model
/// is connected, `worker_models` is empty and `last_error` says that there is none. `onnx:FILE` and `reflex:FILE` are files in the
/// policy folder of the server; a worker needs the same file.
#[utoipa::path(
    put, path = "/runs/{run}/policy", tag = "trajectories", request_body = PolicyRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunPolicyState), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem),
        (status = 422, body = Problem, description = "A field is invalid, for example a version below the run's."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_policy(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<PolicyRequest>,
) -> Result<axum::Json<RunPolicyState>, Problem> {
    let run = parse_run_id(&run)?;
    let tasks = find_run_tasks(&mut *app.readers.acquire().await?, &run, None).await?;
    let (id, state) = (run.clone(), app.clone());
    // A policy file is read and prepared, which takes too long for a thread of the runtime.
    let parsed = tokio::task::spawn_blocking(move || {
        let server = PolicyServer {
            endpoint: state.endpoint.as_ref(),
            folder: &state.policy_folder,
            has_nats: state.has_nats,
        };
        SetPolicy::from_request(id, &request, server, &tasks)
    });
    let change = parsed.await.map_err(|error| Problem::invalid("policy", error.to_string()))??;
    app.writer.change(change).await?;
    tracing::info!(%run, "Policy of a run set.");
    Ok(axum::Json(policy_state(&app, &run).await?))
}

async fn policy_state(app: &AppState, run: &RunId) -> Result<RunPolicyState, Problem> {
    let mut conn = acquire_run_reader(app, run).await?;
    let row = run_policies::get(&mut conn, run.as_str()).await?;
    let settings = row.as_ref().map(settings_from_row).transpose()?.unwrap_or_default();
    let TokenCounts { tokens_in, tokens_out } = run_policies::tokens(&mut conn, run.as_str()).await?;
    let feed = trajectories::counts(&mut conn, run.as_str(), app.clock.now()).await?;
    let unacked = feed.waiting + feed.delivered;
    let policy = row.as_ref().map_or(RunPolicy::Off, |row| row.policy.clone());
    let model =
        app.endpoint.as_ref().filter(|_| policy == RunPolicy::Chat).map(|e| e.llm.config().model.clone());
    let worker_models = match policy {
        RunPolicy::Chat => app.lease_service.audits.queue.status().chat_models(),
        RunPolicy::Off | RunPolicy::BuiltIn(_) => Vec::new(),
    };
    let last_error = row.as_ref().and_then(|row| {
        Some(RunPolicyError { message: row.error.clone()?, at: rfc3339(row.error_at.unwrap_or_default()) })
    });
    let (groups, episodes, failed) =
        row.as_ref().map_or((0, 0, 0), |row| (row.groups, row.episodes, row.failed));
    Ok(RunPolicyState {
        policy: policy.to_string(),
        version: row.as_ref().map_or(0, |row| row.version),
        model,
        worker_models,
        changed_at: row.as_ref().map(|row| rfc3339(row.changed_at)),
        groups,
        episodes,
        failed,
        tokens_in,
        tokens_out,
        feed: FeedStatus {
            waiting: feed.waiting,
            delivered: feed.delivered,
            acknowledged: feed.acked,
            bytes: feed.bytes,
            full: unacked >= i64::from(settings.max_unacknowledged_groups) || feed.bytes >= MAX_UNACKED_BYTES,
        },
        last_error,
        settings,
    })
}
