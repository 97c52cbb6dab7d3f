//! Members of a run.

use api_types::{RunMembersRequest, RunSummary};
use axum::Extension;
use axum::extract::State;

use super::runs::run_from_row;
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::set_members::SetMembers;

/// Replace the members of a run.
///
/// A member is the principal of tokens. It may lease, report results, open sessions and claim trajectories; only the owner and admins
/// change the run. An admin can also set the owner, for example of a run that was created without authentication.
#[utoipa::path(
    put, path = "/runs/{run}/members", tag = "runs", request_body = RunMembersRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_members(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Json(request): Json<RunMembersRequest>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let change = SetMembers::from_request(parse_run_id(&run)?, caller.actor(), request)?;
    Ok(axum::Json(run_from_row(app.writer.change(change).await?, app.clock.now())?))
}
