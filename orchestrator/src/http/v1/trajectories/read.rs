//! Reading of groups from an id on, which changes nothing.

use api_types::{DeliveredGroup, TrajectoryPage, TrajectoryQuery};
use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use store::ids::RunId;
use store::trajectories::{self, FeedGroup};

use super::response::{acquire_answer, groups_response};
use super::wait::{FeedSource, WaitParams, wait_for_groups};
use crate::http::access::Caller;
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::rollouts::feed::limit_bytes;

/// Groups after an id.
struct GroupsAfter {
    run: RunId,
    after: i64,
    limit: i64,
}

impl FeedSource for GroupsAfter {
    async fn available(&self, app: &AppState) -> Result<Vec<FeedGroup>, Problem> {
        let mut conn = acquire_run_reader(app, &self.run).await?;
        let heads = trajectories::after(&mut conn, self.run.as_str(), self.after, self.limit).await?;
        Ok(limit_bytes(heads))
    }
}

/// Read finished groups of the trajectory feed from an id on, in order, acknowledged or not.
///
/// Nothing is claimed. With `wait_s` the server responds as soon as there is a group.
#[utoipa::path(
    get, path = "/runs/{run}/trajectories", tag = "trajectories",
    params(("run" = String, Path, description = "The run's id."), TrajectoryQuery),
    responses(
        (status = 200, description = "Groups, as JSON, as JSON lines (one group a line) or as MessagePack, by `Accept`.", content(
            (TrajectoryPage = "application/json"), (DeliveredGroup = "application/x-ndjson"), (TrajectoryPage = "application/msgpack")
        )),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem, description = "Too many long polls or answers are open; retry after `Retry-After`."),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn read_trajectories(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Query(query): Query<TrajectoryQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let TrajectoryQuery { limit, wait_s, after } = query;
    let run = parse_run_id(&run)?;
    let after = i64::try_from(after.unwrap_or(0)).unwrap_or(i64::MAX);
    let params = WaitParams::from_request(limit, wait_s)?;
    let source = GroupsAfter { run, after, limit: params.limit };
    drop(acquire_run_reader(&app, &source.run).await?);
    let permit = acquire_answer(&app, &caller.identity)?;
    let heads = wait_for_groups(&app, &source, params.wait).await?;
    let next = heads.last().map_or(after, |last| last.id);
    Ok(groups_response(&app, &headers, heads, Some(next), permit))
}
