//! One design with everything that is known of it.

use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::{id, reader_of, run_id};
use super::view::{DesignHead, design};
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, LeaseId};
use crate::http::state::AppState;
use crate::store::layouts::{self, LayoutEpisode};
use crate::store::scenarios::ScenarioLoader;
use crate::store::{brackets, layout_transitions};
use crate::leases::bracket_view::BracketView;
use crate::designs::manual::find;

/// Episodes that are named.
const EPISODES: i64 = 16;

/// One design.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Design {
    /// What a list says of it.
    #[serde(flatten)]
    head: DesignHead,
    /// The design in the language of its world: aim, params, encounters. As the gate read it, or, where it was refused, as
    /// it was given; none where it was too long to be kept.
    #[schema(value_type = Option<Object>)]
    design: Option<Value>,
    /// The scenario's id; none where it was refused. `GET /v1/layouts/{layout}` shows the bodies.
    scenario_id: Option<String>,
    /// What the scenario is worth; none where it was refused.
    bracket: Option<BracketView>,
    /// Every change of its state, in order.
    turns: Vec<TurnView>,
    /// The newest finished episodes behind it, the newest first: at most 16.
    episodes: Vec<String>,
}

/// A change of a design's state.
#[derive(Serialize, ToSchema)]
struct TurnView {
    /// The state from then on.
    state: String,
    /// Why.
    reason: String,
    /// When, RFC 3339.
    at: String,
}

/// Show a design: its encounters, what the gate said, what it is worth, and how the agent fared.
#[utoipa::path(
    get, path = "/runs/{run}/designs/{design}", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses((status = 200, body = Design), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, layout)): Path<(String, String)>,
) -> Result<axum::Json<Design>, Problem> {
    let (run, layout) = (run_id(&run)?, id("design", &layout)?);
    let mut conn = reader_of(&app, &run).await?;
    let row = find(&mut conn, &run, layout).await?;
    let (mut scenario_id, mut bracket) = (None, None);
    if let Some(of) = &row.scenario {
        let scenario = ScenarioLoader::default().get(&mut conn, of).await?;
        bracket = brackets::newest(&mut conn, of).await?.map(|b| BracketView::of(&scenario, &b));
        scenario_id = Some(scenario.id().to_string());
    }
    let turns = layout_transitions::transitions(&mut conn, row.id).await?.into_iter();
    let episodes = layouts::episodes(&mut conn, row.id, EPISODES).await?.into_iter();
    Ok(axum::Json(Design {
        head: DesignHead::of(&row)?,
        design: design(&row)?,
        scenario_id,
        bracket,
        turns: turns
            .map(|turn| TurnView { state: turn.state.to_string(), reason: turn.reason, at: rfc3339(turn.at) })
            .collect(),
        episodes: episodes
            .map(|LayoutEpisode { lease: number, token, number: index }| {
                EpisodeId { lease: LeaseId { number, token }, index }.to_string()
            })
            .collect(),
    }))
}
