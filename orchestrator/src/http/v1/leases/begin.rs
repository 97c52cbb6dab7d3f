//! Begin of groups of a lease.

use api_types::{BeginGroupsRequest, Lease};
use axum::Extension;
use axum::extract::State;

use super::view::load_lease;
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::begin::BeginGroups;
use crate::leases::create::{GrantedLease, MAX_GROUPS};

/// Begin groups of a lease with `disclosure: begin`.
///
/// The response has the scenarios of these groups. From then on each of them counts: an episode without a result is missing. A group
/// that was begun before is returned again.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/groups/begin", tag = "leases", request_body = BeginGroupsRequest,
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Lease), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem),
        (status = 409, body = Problem, description = "The lease has ended, or the run is paused."),
        (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn begin_groups(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
    Json(BeginGroupsRequest { groups }): Json<BeginGroupsRequest>,
) -> Result<axum::Json<Lease>, Problem> {
    if groups.is_empty() || groups.len() > MAX_GROUPS as usize {
        let reason = format!("must have 1 to {MAX_GROUPS} numbers, got {}", groups.len());
        return Err(Problem::invalid("groups", reason));
    }
    let (run, lease, actor) = (parse_run_id(&run)?, parse_id("lease", &lease)?, caller.actor());
    let change = BeginGroups { run, lease, groups, actor };
    let GrantedLease { row, groups, .. } = app.writer.change(change).await?;
    Ok(axum::Json(load_lease(&mut *app.readers.acquire().await?, row, groups).await?))
}
