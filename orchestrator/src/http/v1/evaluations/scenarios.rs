//! Results of an evaluation by scenario.

use api_types::{EvaluationScenario, EvaluationScenarioPage, PageQuery, SuiteSection};
use axum::extract::State;
use store::evaluations::{self, EntryEpisodes};
use store::from_json;
use store::ids::{EpisodeId, EvaluationId, LeaseId};

use crate::engine::error::ServiceError;
use crate::evaluations::read::suite_of;
use crate::http::extract::{Path, Query};
use crate::http::paging::{PageCursor, next_cursor, number_after, page_limit};
use crate::http::path_ids::parse_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use evaluation::results::EpisodeMeasures;
use evaluation::suite::{SuiteEntry, SuitePart};

/// List the scenarios of an evaluation with their results so far, in the order of the suite.
#[utoipa::path(
    get, path = "/evaluations/{evaluation}/scenarios", tag = "evaluations",
    params(("evaluation" = String, Path, description = "The evaluation's id."), PageQuery),
    responses(
        (status = 200, body = EvaluationScenarioPage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list_evaluation_scenarios(
    State(app): State<AppState>,
    Path(evaluation): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<EvaluationScenarioPage>, Problem> {
    let EvaluationId { number, .. } = parse_id("evaluation", &evaluation)?;
    let limit = page_limit(page.limit)?;
    let after = number_after(page.cursor.as_deref())?;
    let mut conn = app.readers.acquire().await?;
    let row = evaluations::get(&mut conn, number).await?.ok_or(ServiceError::UnknownEvaluation(number))?;
    let suite = &suite_of(&row)?.suite;
    let flown = evaluations::scenarios(&mut conn, number, after, limit).await?;
    let all: Vec<(usize, &SuiteEntry)> = suite
        .groups
        .iter()
        .flat_map(|group| group.entries.iter().map(|entry| (group.level, entry)))
        .collect();
    let mut scenarios = Vec::with_capacity(flown.len());
    for row in flown {
        let index = row.entry;
        let Some((level, entry)) = usize::try_from(index).ok().and_then(|index| all.get(index)) else {
            continue;
        };
        let episodes: Option<Vec<EpisodeMeasures>> =
            row.episodes.as_deref().map(|text| from_json("an evaluation", text)).transpose()?;
        let first_episode = first_episode(row).filter(|_| episodes.is_some());
        let scenario = evaluation_scenario(index, *level, entry, &episodes.unwrap_or_default());
        scenarios.push(EvaluationScenario { first_episode, ..scenario });
    }
    let next = next_cursor(scenarios.len(), limit, scenarios.last().map(|row| PageCursor::at(row.index)));
    Ok(axum::Json(EvaluationScenarioPage { scenarios, next }))
}

/// Returns the id of the first episode of a scenario that a trainer runs.
fn first_episode(row: EntryEpisodes) -> Option<String> {
    let lease = LeaseId { number: row.lease?, suffix: row.id_suffix? };
    Some(EpisodeId { lease, index: row.first_number? }.to_string())
}

fn evaluation_scenario(
    index: i64,
    level: usize,
    entry: &SuiteEntry,
    episodes: &[EpisodeMeasures],
) -> EvaluationScenario {
    let EpisodeMeasures { score, success, skill, lost, fuel_used } = EpisodeMeasures::mean_of(episodes);
    let part = match entry.part {
        SuitePart::Contested => SuiteSection::Contested,
        SuitePart::AsTheyCome => SuiteSection::AsTheyCome,
    };
    EvaluationScenario {
        index,
        scenario_id: entry.scenario.id().to_string(),
        task: entry.scenario.task().id().to_owned(),
        level,
        part,
        floor: entry.bracket.floor,
        reference: entry.bracket.reference.score,
        episodes: episodes.len(),
        first_episode: None,
        score,
        success,
        skill,
        lost,
        fuel_used,
    }
}
