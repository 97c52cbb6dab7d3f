//! Renewing a lease.

use axum::extract::State;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::{id, run_id};
use super::view::LeaseHead;
use crate::http::state::AppState;
use crate::leases::renew::RenewLease;

/// Renew a lease: it holds for its time again, from now.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/renew", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = LeaseHead), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The lease is over."), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn renew(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<LeaseHead>, Problem> {
    let change = RenewLease { run: run_id(&run)?, lease: id("lease", &lease)? };
    Ok(axum::Json(LeaseHead::of(app.writer.change(change).await?)))
}
