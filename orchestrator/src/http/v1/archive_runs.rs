//! Archiving of several runs.

use api_types::{ArchiveRequest, ArchivedRuns};
use axum::extract::State;
use axum::http::HeaderMap;

use super::runs::run_from_row;
use crate::http::extract::{Json, NoQuery};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::shard_routing::{ForwardedRequest, common_shard, forward};
use crate::http::state::AppState;
use crate::runs::run_status::ArchiveRuns;

/// Largest number of runs in a request.
const MAX_RUNS: usize = 1000;

/// Archive several runs: all of them or none.
///
/// The runs are paused, and lists leave them out without `archived=true`. Runs that are archived already stay so. All runs of a request
/// are of one shard; the server passes a request for the shard of a peer on.
#[utoipa::path(
    post, path = "/archive", tag = "runs", request_body = ArchiveRequest,
    responses(
        (status = 200, body = ArchivedRuns), (status = 400, body = Problem), (status = 408, body = Problem),
        (status = 413, body = Problem), (status = 415, body = Problem),
        (status = 422, body = Problem, description = "A run does not exist, or the list is empty or too long."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn archive_many_runs(
    _: NoQuery,
    State(app): State<AppState>,
    headers: HeaderMap,
    Json(request): Json<ArchiveRequest>,
) -> Result<axum::Json<ArchivedRuns>, Problem> {
    let count = request.runs.len();
    if !(1..=MAX_RUNS).contains(&count) {
        let reason = format!("must have 1 to {MAX_RUNS} ids of runs, got {count}");
        return Err(Problem::invalid("runs", reason));
    }
    if let Some(own) = app.shards.own() {
        let shard = common_shard("runs", own, request.runs.iter().map(String::as_str))?;
        let forwarded = ForwardedRequest::post("/v1/archive", &request);
        if let Some(archived) = forward(&app, &headers, Some(&shard), forwarded).await? {
            return Ok(axum::Json(archived));
        }
    }
    let runs = request.runs.iter().enumerate().map(|(at, run)| {
        parse_run_id(run).map_err(|_| Problem::invalid(format!("runs.{at}"), "is not the id of a run"))
    });
    let rows = app.writer.change(ArchiveRuns { runs: runs.collect::<Result<_, _>>()? }).await?;
    let now = app.clock.now();
    let runs = rows.into_iter().map(|row| run_from_row(row, now)).collect::<Result<_, _>>()?;
    Ok(axum::Json(ArchivedRuns { runs }))
}
