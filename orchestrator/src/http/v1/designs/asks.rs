//! What designers were asked, and what came of it.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use super::super::super::extract::{NoQuery, Path, Query};
use super::super::super::problem::Problem;
use super::super::failures::tasks_of;
use super::super::{Page, id, next, reader_of, run_id};
use super::view::{before, word_of};
use crate::clock::rfc3339;
use crate::ids::DesignRequestId;
use crate::http::state::AppState;
use crate::store::design_requests::{self, DesignRequestRow, RequestFilter, RequestState};
use crate::store::from_json;
use crate::engine::error::ServiceError;

/// One round of asking a designer.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct AskView {
    /// Its id.
    id: String,
    /// The task.
    task: String,
    /// The level it was for; none before it has begun, and where there are no levels.
    level: Option<i64>,
    /// Who was asked: `llm` or `procedural`. What a language model does not do the procedural designer does.
    designer: String,
    /// `worker` (the stock ran low, or the failures changed) or `hand`.
    asked_by: String,
    /// `waiting`, `running`, `done` or `failed`.
    state: String,
    /// How many layouts were wanted.
    wanted: i64,
    /// How many the gate let through.
    admitted: i64,
    /// How many it refused.
    refused: i64,
    /// The model, where one was asked.
    model: Option<String>,
    /// The version of its prompt.
    prompt: Option<String>,
    /// Rounds, of all designers together.
    rounds: i64,
    /// Tokens in.
    tokens_in: i64,
    /// Tokens out.
    tokens_out: i64,
    /// What they cost, in the currency that prices are configured in.
    cost: f64,
    /// How long it took, milliseconds.
    latency_ms: i64,
    /// Criticised episodes that the profile rests on.
    criticised: Option<i64>,
    /// What went wrong without ending it, in a sentence each.
    troubles: Vec<String>,
    /// Why it failed.
    error: Option<String>,
    /// When it was asked, RFC 3339.
    created_at: String,
    /// When it ended, RFC 3339.
    ended_at: Option<String>,
}

impl AskView {
    pub(super) fn of(row: DesignRequestRow) -> Result<Self, Problem> {
        Ok(Self {
            id: DesignRequestId(row.id).to_string(),
            troubles: from_json("an ask's troubles", &row.troubles)?,
            task: row.task,
            level: row.level,
            designer: row.designer.to_string(),
            asked_by: row.origin.to_string(),
            state: row.state.to_string(),
            wanted: row.wanted,
            admitted: row.admitted,
            refused: row.refused,
            model: row.model,
            prompt: row.prompt,
            rounds: row.rounds,
            tokens_in: row.tokens_in,
            tokens_out: row.tokens_out,
            cost: row.cost,
            latency_ms: row.latency_ms,
            criticised: row.criticised,
            error: row.error,
            created_at: rfc3339(row.created_at),
            ended_at: row.ended_at.map(rfc3339),
        })
    }
}

/// A page of asks.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Asks {
    /// The newest first.
    asks: Vec<AskView>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// An ask with what it rested on.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Ask {
    /// What a list says of it.
    #[serde(flatten)]
    head: AskView,
    /// The failure profile as it stood; none before it has begun.
    #[schema(value_type = Option<Object>)]
    profile: Option<Value>,
}

/// Which asks are listed.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct Listed {
    /// For this task.
    task: Option<String>,
    /// In this state: `waiting`, `running`, `done` or `failed`.
    state: Option<String>,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// List what designers were asked for a run, the newest first.
#[utoipa::path(
    get, path = "/runs/{run}/designs/asks", tag = "designs", operation_id = "list_asks",
    params(("run" = String, Path, description = "The run's id."), Listed),
    responses(
        (status = 200, body = Asks), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(listed): Query<Listed>,
) -> Result<axum::Json<Asks>, Problem> {
    let run = run_id(&run)?;
    let Listed { task, state, limit, cursor } = listed;
    let state: Option<RequestState> = word_of("state", state.as_deref(), RequestState::ALL)?;
    let page = Page { limit, cursor };
    let (limit, before) = (page.limit()?, before(&page)?);
    let mut conn = app.readers.acquire().await?;
    tasks_of(&mut conn, &run, task.as_deref()).await?;
    let filter = RequestFilter { task: task.as_deref(), state };
    let rows = design_requests::page(&mut conn, run.as_str(), filter, before, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(Asks { asks: rows.into_iter().map(AskView::of).collect::<Result<_, _>>()?, next }))
}

/// Show an ask, with the failure profile it rested on.
#[utoipa::path(
    get, path = "/runs/{run}/designs/asks/{ask}", tag = "designs", operation_id = "show_ask",
    params(("run" = String, Path, description = "The run's id."), ("ask" = String, Path, description = "The ask's id.")),
    responses((status = 200, body = Ask), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, ask)): Path<(String, String)>,
) -> Result<axum::Json<Ask>, Problem> {
    let (run, ask) = (run_id(&run)?, id::<DesignRequestId>("ask", &ask)?);
    let mut conn = reader_of(&app, &run).await?;
    let row = design_requests::get(&mut conn, run.as_str(), ask.0).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownAsk(ask.to_string()))?;
    let profile = row.profile.as_deref().map(|text| from_json("a failure profile", text)).transpose()?;
    Ok(axum::Json(Ask { profile, head: AskView::of(row)? }))
}
