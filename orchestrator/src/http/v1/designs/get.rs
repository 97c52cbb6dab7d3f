//! One design with its parts, scenario and history.

use crate::api_enums::ConvertEnum;
use api_types::{Design, DesignTransition};
use axum::extract::State;
use store::ids::{EpisodeId, LayoutId, LeaseId};
use store::layouts::{self, LayoutEpisode};
use store::scenarios::ScenarioLoader;
use store::{brackets, layout_transitions};

use super::view::{design_json, design_summary, design_table};
use crate::designs::retire_layout::find_layout;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::leases::bracket_view::scenario_bracket;
use clock::rfc3339;

/// Largest number of episodes that are listed.
const MAX_EPISODES: i64 = 16;

/// Get a design with its parts, scenario, bracket, results and changes of state.
#[utoipa::path(
    get, path = "/runs/{run}/designs/{design}", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("design" = String, Path, description = "The design's id.")),
    responses((status = 200, body = Design), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn get_design(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, layout)): Path<(String, String)>,
) -> Result<axum::Json<Design>, Problem> {
    let (run, layout) = (parse_run_id(&run)?, parse_id::<LayoutId>("design", &layout)?);
    let mut conn = acquire_run_reader(&app, &run).await?;
    let row = find_layout(&mut conn, &run, &layout).await?;
    let (mut scenario_id, mut bracket) = (None, None);
    if let Some(scenario_key) = &row.scenario {
        let scenario = ScenarioLoader::default().get(&mut conn, scenario_key).await?;
        bracket = brackets::newest(&mut conn, scenario_key).await?.map(|b| scenario_bracket(&scenario, &b));
        scenario_id = Some(scenario.id().to_string());
    }
    let transitions = layout_transitions::transitions(&mut conn, row.id).await?.into_iter();
    let episodes = layouts::episodes(&mut conn, row.id, MAX_EPISODES).await?.into_iter();
    let design = design_json(&row)?;
    Ok(axum::Json(Design {
        summary: design_summary(&row)?,
        table: design.as_ref().and_then(|design| design_table(&row.task, design)),
        design,
        scenario_id,
        bracket,
        transitions: transitions
            .map(|turn| DesignTransition {
                state: turn.state.convert(),
                reason: turn.reason,
                at: rfc3339(turn.at),
            })
            .collect(),
        episodes: episodes
            .map(|LayoutEpisode { lease: number, id_suffix: suffix, number: index }| {
                EpisodeId { lease: LeaseId { number, suffix }, index }.to_string()
            })
            .collect(),
    }))
}
