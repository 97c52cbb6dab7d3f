//! Showing a lease.

use axum::extract::State;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::{id, run_id};
use super::view::{Lease, describe};
use crate::http::state::AppState;
use crate::store::groups;
use crate::engine::error::ServiceError;
use crate::leases::find::find_lease;

/// Show a lease with its groups: what was answered when it was taken. Past what the run keeps whole only those groups are
/// left that a level move, a layout or an example of a failure rests on.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Lease), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run keeps nothing of it any more but how its episodes came out.")
    )
)]
pub(in crate::http::v1) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<Lease>, Problem> {
    let (run, lease) = (run_id(&run)?, id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find_lease(&mut conn, &run, &lease).await?;
    let groups = groups::of_lease(&mut conn, row.id).await?;
    if row.is_compacted && groups.is_empty() {
        return Err(ServiceError::Expired(lease.to_string()).into());
    }
    Ok(axum::Json(describe(&mut conn, row, groups).await?))
}
