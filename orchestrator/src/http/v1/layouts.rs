//! Layouts of all runs: what the gate let through, to be looked at and flown by hand.

use axum::extract::State;
use env_core::TaskSpec;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use super::super::extract::{NoQuery, Path, Query};
use super::super::problem::Problem;
use super::designs::view::{DesignHead, Designs, before, design, known_mode, word_of};
use super::{Page, id};
use crate::ids::LayoutId;
use crate::http::state::AppState;
use crate::store::brackets::{self, StoredOutcome};
use crate::store::layouts::{self, LayoutFilter, LayoutState};
use crate::store::scenarios::ScenarioLoader;
use crate::leases::bracket_view::BracketView;
use crate::engine::error::ServiceError;

/// States of a layout that lists show.
const STATES: [LayoutState; 2] = [LayoutState::Active, LayoutState::Retired];

/// Which layouts are listed.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Listed {
    /// Of this task.
    task: Option<String>,
    /// In this state: `active` or `retired`.
    state: Option<String>,
    /// That go for this failure mode.
    aim: Option<String>,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// A layout with its bodies.
#[derive(Serialize, ToSchema)]
pub(super) struct Layout {
    /// What a list says of it.
    #[serde(flatten)]
    head: DesignHead,
    /// The design in the language of its world: aim, params, encounters.
    #[schema(value_type = Option<Object>)]
    design: Option<Value>,
    /// The scenario's id.
    scenario_id: String,
    /// The scenario, complete with its bodies: `POST /v1/scenarios` takes it as it is.
    #[schema(value_type = Object)]
    scenario: Value,
    /// What the scenario is worth.
    bracket: BracketView,
    /// How the witness fared: the planner's own flight, which shows that it can be done.
    witness: StoredOutcome,
}

/// List the layouts of all runs that the gate let through, the newest first.
#[utoipa::path(
    get, path = "/layouts", tag = "designs", operation_id = "list_layouts", params(Listed),
    responses((status = 200, body = Designs), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Query(listed): Query<Listed>,
) -> Result<axum::Json<Designs>, Problem> {
    let Listed { task, state, aim, limit, cursor } = listed;
    let state = word_of("state", state.as_deref(), &STATES)?;
    let tasks: Vec<&'static dyn TaskSpec> = match &task {
        None => env_core::tasks().collect(),
        Some(id) => vec![env_core::task(id).ok_or_else(|| {
            let id: String = id.chars().take(60).collect();
            Problem::invalid("task", format!("there is no task {id:?}; GET /v1/tasks lists them"))
        })?],
    };
    known_mode("aim", aim.as_ref(), &tasks)?;
    let page = Page { limit, cursor };
    let (limit, before) = (page.limit()?, before(&page)?);
    let mut conn = app.readers.acquire().await?;
    let wanted = LayoutFilter { task, state, mode: aim, ..LayoutFilter::default() };
    let rows = layouts::of_all_runs(&mut conn, &wanted, before, limit).await?;
    Ok(axum::Json(Designs::of(&rows, limit)?))
}

/// Show a layout with its whole scenario, bodies included, and what it is worth.
#[utoipa::path(
    get, path = "/layouts/{layout}", tag = "designs", operation_id = "show_layout",
    params(("layout" = String, Path, description = "The layout's id.")),
    responses((status = 200, body = Layout), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(layout): Path<String>,
) -> Result<axum::Json<Layout>, Problem> {
    let layout: LayoutId = id("layout", &layout)?;
    let unknown = || ServiceError::UnknownLayout(layout.to_string());
    let mut conn = app.readers.acquire().await?;
    let row = layouts::get(&mut conn, layout.0).await?.ok_or_else(unknown)?;
    let of = row.scenario.as_ref().ok_or_else(unknown)?;
    let scenario = ScenarioLoader::default().get(&mut conn, of).await?;
    let bracket = brackets::newest(&mut conn, of).await?.ok_or_else(unknown)?;
    Ok(axum::Json(Layout {
        head: DesignHead::of(&row)?,
        design: design(&row)?,
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        witness: bracket.reference.into(),
        bracket: BracketView::of(&scenario, &bracket),
    }))
}
