//! Claims of groups for a time.

use std::time::Duration;

use api_types::{DeliveredGroup, TrajectoryClaim, TrajectoryPage};
use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use store::ids::RunId;
use store::trajectories::{self, FeedGroup};

use super::response::{acquire_answer, groups_response};
use super::wait::{FeedSource, WaitParams, check_range, wait_for_groups};
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::rollouts::feed::DeliverGroups;

/// Groups that can be claimed.
struct ClaimableGroups {
    run: RunId,
    limit: i64,
    /// Duration of the claim, milliseconds.
    ttl_ms: i64,
}

impl FeedSource for ClaimableGroups {
    async fn available(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let mut conn = acquire_run_reader(app, &self.run).await?;
        let now = app.clock.now();
        if trajectories::deliverable(&mut conn, self.run.as_str(), now, 1).await?.is_empty() {
            return Ok(Vec::new());
        }
        drop(conn);
        let deliver = DeliverGroups { run: self.run.clone(), limit: self.limit, ttl_ms: self.ttl_ms };
        Ok(app.writer.change(deliver).await?)
    }

    async fn next_at(&self, app: &AppState) -> Result<Option<Duration>, Problem> {
        let mut conn = app.readers.acquire().await?;
        let at = trajectories::next_deliverable_at(&mut conn, self.run.as_str()).await?;
        // At least 10 ms, since the claim may expire in this very millisecond.
        Ok(at.map(|at| Duration::from_millis(u64::try_from(at - app.clock.now()).unwrap_or(0).max(10))))
    }
}

/// Claim finished groups of the trajectory feed, in order.
///
/// The server claims the groups for `ttl_s` seconds, and delivers a group again if it is not acknowledged in that time. So each group
/// is delivered at least once; `id` identifies repeats. With `wait_s` the server responds as soon as there is a group.
#[utoipa::path(
    post, path = "/runs/{run}/trajectories/claim", tag = "trajectories", request_body = TrajectoryClaim,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, description = "Groups, as JSON, as JSON lines (one group a line) or as MessagePack, by `Accept`.", content(
            (TrajectoryPage = "application/json"), (DeliveredGroup = "application/x-ndjson"), (TrajectoryPage = "application/msgpack")
        )),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem, description = "Too many long polls or answers are open; retry after `Retry-After`."),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn claim_trajectories(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    headers: HeaderMap,
    Json(claim): Json<TrajectoryClaim>,
) -> Result<Response, Problem> {
    let TrajectoryClaim { limit, wait_s, ttl_s } = claim;
    let run = parse_run_id(&run)?;
    let params = WaitParams::from_request(limit, wait_s)?;
    let ttl_ms = check_range("ttl_s", ttl_s, 600, 1..=86_400)? * 1000;
    let source = ClaimableGroups { run, limit: params.limit, ttl_ms };
    drop(acquire_run_reader(&app, &source.run).await?);
    let permit = acquire_answer(&app, &caller.identity)?;
    let heads = wait_for_groups(&app, &source, params.wait).await?;
    let next = heads.last().map(|last| last.id);
    Ok(groups_response(&app, &headers, heads, next, permit))
}
