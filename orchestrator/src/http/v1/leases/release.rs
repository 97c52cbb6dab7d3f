//! End of a lease on request of its client.

use api_types::LeaseSummary;
use axum::Extension;
use axum::extract::State;

use super::view::lease_summary;
use crate::http::access::Caller;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::end::ReleaseLease;

/// Release a lease.
///
/// Scenarios of groups with too few finished episodes return to the queue. A repeated release changes nothing.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/release", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = LeaseSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn release_lease(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<LeaseSummary>, Problem> {
    let (run, lease, actor) = (parse_run_id(&run)?, parse_id("lease", &lease)?, caller.actor());
    Ok(axum::Json(lease_summary(app.writer.change(ReleaseLease { run, lease, actor }).await?)))
}
