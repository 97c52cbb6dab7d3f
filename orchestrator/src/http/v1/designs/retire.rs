//! Retirement of a layout, and its reversal.

use api_types::DesignSummary;
use axum::extract::State;

use super::view::design_summary;
use crate::designs::retire_layout::SetLayoutRetired;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Retire a layout.
///
/// The server leases no more groups of it. Groups that are already leased are not affected.
#[utoipa::path(
    post, path = "/runs/{run}/designs/{design}/retire", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses(
        (status = 200, body = DesignSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The gate refused the design, so it has no layout."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn retire_design(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, design)): Path<(String, String)>,
) -> Result<axum::Json<DesignSummary>, Problem> {
    set_retired(&app, &run, &design, true).await
}

/// Restore a retired layout, for any reason of its retirement but `wrong`.
///
/// The server leases groups of it again, and resets the outcomes behind its retirement.
#[utoipa::path(
    post, path = "/runs/{run}/designs/{design}/revive", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses(
        (status = 200, body = DesignSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The gate refused the design, or a worker judged it wrongly."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn revive_design(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, design)): Path<(String, String)>,
) -> Result<axum::Json<DesignSummary>, Problem> {
    set_retired(&app, &run, &design, false).await
}

async fn set_retired(
    app: &AppState,
    run: &str,
    design: &str,
    retired: bool,
) -> Result<axum::Json<DesignSummary>, Problem> {
    let change = SetLayoutRetired { run: parse_run_id(run)?, layout: parse_id("design", design)?, retired };
    let row = app.writer.change(change).await?;
    Ok(axum::Json(design_summary(&row)?))
}
