//! Taking a layout out of training, and putting it back.

use axum::extract::State;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::{id, run_id};
use super::view::DesignHead;
use crate::http::state::AppState;
use crate::designs::manual::SetLayoutRetired;

/// Retire a layout by hand: it is never served again. Groups of it that are leased already end as they would have.
#[utoipa::path(
    post, path = "/runs/{run}/designs/{design}/retire", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses(
        (status = 200, body = DesignHead), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The gate refused it: it never serves."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn retire(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, design)): Path<(String, String)>,
) -> Result<axum::Json<DesignHead>, Problem> {
    set_retired(&app, &run, &design, true).await
}

/// Put a retired layout back, whyever it was retired: it serves again, and what it was retired for is forgotten.
#[utoipa::path(
    post, path = "/runs/{run}/designs/{design}/revive", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses(
        (status = 200, body = DesignHead), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The gate refused it: it never serves."),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn revive(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, design)): Path<(String, String)>,
) -> Result<axum::Json<DesignHead>, Problem> {
    set_retired(&app, &run, &design, false).await
}

async fn set_retired(
    app: &AppState,
    run: &str,
    design: &str,
    retired: bool,
) -> Result<axum::Json<DesignHead>, Problem> {
    let change = SetLayoutRetired { run: run_id(run)?, layout: id("design", design)?, retired };
    let row = app.writer.change(change).await?;
    Ok(axum::Json(DesignHead::of(&row)?))
}
