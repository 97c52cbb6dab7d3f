//! One lease with its groups.

use api_types::Lease;
use axum::Extension;
use axum::extract::State;
use store::groups;

use super::view::load_lease;
use crate::engine::error::ServiceError;
use crate::http::access::Caller;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::find::find_own_lease;

/// Get a lease with its groups.
///
/// A compacted lease has only the groups on which a level move, a layout or an example of a failure depends.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Lease), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The lease was compacted; only the outcomes of its episodes are kept.")
    )
)]
pub(in crate::http::v1) async fn get_lease(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<Lease>, Problem> {
    let (run, lease) = (parse_run_id(&run)?, parse_id("lease", &lease)?);
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = find_own_lease(&mut conn, &run, &lease, caller.actor()).await?;
    let groups = groups::of_lease(&mut conn, row.id).await?;
    if row.is_compacted && groups.is_empty() {
        return Err(ServiceError::Expired(lease.to_string()).into());
    }
    Ok(axum::Json(load_lease(&mut conn, row, groups).await?))
}
