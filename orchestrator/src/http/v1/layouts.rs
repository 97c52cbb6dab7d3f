//! Layouts of all runs that the gate admitted.

use api_types::{DesignPage, Layout, LayoutQuery};
use axum::extract::State;
use env_core::TaskSpec;
use store::brackets;
use store::ids::LayoutId;
use store::layouts::{self, LayoutFilter, LayoutState};
use store::scenarios::ScenarioLoader;
use store::shard::Shard;

use super::designs::view::{design_json, design_page, design_summary};
use super::scenarios::outcome_response;
use crate::engine::error::ServiceError;
use crate::http::extract::{NoQuery, Path, Query};
use crate::http::filters::{check_failure_mode, parse_filter_word};
use crate::http::paging::{number_before, page_limit};
use crate::http::path_ids::parse_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::bracket_view::scenario_bracket;

/// States of an admitted layout.
const STATES: [LayoutState; 2] = [LayoutState::Active, LayoutState::Retired];

/// List the layouts of all runs that the gate admitted, newest first.
#[utoipa::path(
    get, path = "/layouts", tag = "designs", params(LayoutQuery),
    responses((status = 200, body = DesignPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_layouts(
    State(app): State<AppState>,
    Query(query): Query<LayoutQuery>,
) -> Result<axum::Json<DesignPage>, Problem> {
    let LayoutQuery { task, state, aim, limit, cursor } = query;
    let state = parse_filter_word("state", state.as_deref(), &STATES)?;
    let tasks: Vec<&'static dyn TaskSpec> = match &task {
        None => env_core::tasks().collect(),
        Some(id) => vec![env_core::task(id).ok_or_else(|| {
            let id: String = id.chars().take(60).collect();
            Problem::invalid("task", format!("task {id:?} does not exist; `GET /v1/tasks` lists all tasks"))
        })?],
    };
    check_failure_mode("aim", aim.as_ref(), &tasks)?;
    let (limit, before) = (page_limit(limit)?, number_before(cursor.as_deref())?);
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let filter = LayoutFilter { task, state, mode: aim, ..LayoutFilter::default() };
    let rows = layouts::of_all_runs(&mut conn, &filter, before, limit).await?;
    Ok(axum::Json(design_page(&rows, limit)?))
}

/// Get a layout with its complete scenario, bodies included, and its bracket.
#[utoipa::path(
    get, path = "/layouts/{layout}", tag = "designs",
    params(("layout" = String, Path, description = "The layout's id.")),
    responses((status = 200, body = Layout), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn get_layout(
    _: NoQuery,
    State(app): State<AppState>,
    Path(layout): Path<String>,
) -> Result<axum::Json<Layout>, Problem> {
    let layout: LayoutId = parse_id("layout", &layout)?;
    let unknown = || ServiceError::UnknownLayout(layout.to_string());
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = layouts::get(&mut conn, layout.number).await?.ok_or_else(unknown)?;
    if layout.shard.is_some() && layout.shard != Shard::of_id(&row.run) {
        return Err(unknown().into());
    }
    let scenario_key = row.scenario.as_ref().ok_or_else(unknown)?;
    let scenario = ScenarioLoader::default().get(&mut conn, scenario_key).await?;
    let bracket = brackets::newest(&mut conn, scenario_key).await?.ok_or_else(unknown)?;
    Ok(axum::Json(Layout {
        summary: design_summary(&row)?,
        design: design_json(&row)?,
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        reference_outcome: outcome_response(bracket.reference),
        bracket: scenario_bracket(&scenario, &bracket),
    }))
}
