//! What a run was told, whenever it was told otherwise.

use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::{Page, next, reader_of, run_id};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::store::from_json;
use crate::store::runs::{self, SettingsRow};

/// A page of settings.
#[derive(Serialize, ToSchema)]
pub(super) struct Told {
    /// The newest first.
    settings: Vec<Settings>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// The settings of a run from a moment on.
#[derive(Serialize, ToSchema)]
struct Settings {
    /// The how-manieth, from 0.
    nth: i64,
    /// Since when, RFC 3339.
    at: String,
    /// All of them, as they were written down then.
    #[schema(value_type = Object)]
    settings: Value,
}

/// Show the settings of a run and those it had before, the newest first.
#[utoipa::path(
    get, path = "/runs/{run}/settings", tag = "runs",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = Told), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Told>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let mut conn = reader_of(&app, &run).await?;
    let before = if page.cursor.is_some() { page.cursor()?.0 } else { i64::MAX };
    let rows = runs::settings_history(&mut conn, run.as_str(), before, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.nth, "")));
    let settings = rows.into_iter().map(|SettingsRow { nth, at, settings }| {
        Ok(Settings { nth, at: rfc3339(at), settings: from_json("a run's settings", &settings)? })
    });
    Ok(axum::Json(Told { settings: settings.collect::<Result<_, Problem>>()?, next }))
}
