//! History of a run's settings.

use api_types::{PageQuery, RunSettingsPage, RunSettingsVersion};
use axum::extract::State;
use store::from_json;
use store::runs::{self, SettingsRow};

use crate::http::extract::{Path, Query};
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use clock::rfc3339;

/// List the settings of a run and their earlier versions, newest first.
#[utoipa::path(
    get, path = "/runs/{run}/settings", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), PageQuery),
    responses(
        (status = 200, body = RunSettingsPage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list_run_settings(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<RunSettingsPage>, Problem> {
    let (run, limit) = (parse_run_id(&run)?, page_limit(page.limit)?);
    let mut conn = acquire_run_reader(&app, &run).await?;
    let before = number_before(page.cursor.as_deref())?;
    let rows = runs::settings_history(&mut conn, run.as_str(), before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.revision)));
    let settings = rows.into_iter().map(|SettingsRow { revision, at, settings }| {
        Ok(RunSettingsVersion {
            revision,
            at: rfc3339(at),
            settings: from_json("a run's settings", &settings)?,
        })
    });
    Ok(axum::Json(RunSettingsPage { settings: settings.collect::<Result<_, Problem>>()?, next }))
}
