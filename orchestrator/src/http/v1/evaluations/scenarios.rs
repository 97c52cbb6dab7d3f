//! An evaluation, scenario by scenario.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::{Page, id, next};
use crate::evaluation::results::EpisodeMeasures;
use crate::evaluation::suite::{SuiteEntry, SuitePart};
use crate::ids::EvaluationId;
use crate::http::state::AppState;
use crate::store::evaluations::{self, EntryEpisodes};
use crate::store::from_json;
use crate::engine::error::ServiceError;
use crate::evaluation::read::suite_of;

/// A page of an evaluation's scenarios.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct EvaluationScenarios {
    /// In the suite's order.
    scenarios: Vec<EvaluationScenario>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// How a policy fared on one scenario.
#[derive(Serialize, ToSchema)]
struct EvaluationScenario {
    /// Its place in the suite: of evaluations of one suite the same is the same scenario.
    place: i64,
    /// Its id.
    scenario_id: String,
    /// The task.
    task: &'static str,
    /// The level it was drawn at.
    level: usize,
    /// `contested` or `as_they_come`.
    part: &'static str,
    /// What is reached where nobody acts.
    floor: f64,
    /// What the reference reaches.
    reference: f64,
    /// Episodes that were flown; 0 until they are.
    episodes: usize,
    /// Their mean score.
    score: Option<f64>,
    /// Their share of successes.
    success: Option<f64>,
    /// Their mean skill, where it is defined.
    skill: Option<f64>,
    /// The share of agents that were lost.
    lost: Option<f64>,
    /// The fuel that they used on average, all agents together.
    fuel_used: Option<f64>,
}

/// Show an evaluation scenario by scenario, as far as it is flown.
#[utoipa::path(
    get, path = "/evaluations/{evaluation}/scenarios", tag = "evaluations", operation_id = "list_evaluation_scenarios",
    params(("evaluation" = String, Path, description = "The evaluation's id."), Page),
    responses(
        (status = 200, body = EvaluationScenarios), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list(
    State(app): State<AppState>,
    Path(evaluation): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<EvaluationScenarios>, Problem> {
    let EvaluationId(number) = id("evaluation", &evaluation)?;
    let limit = page.limit()?;
    let after = if page.cursor.is_some() { page.cursor()?.0 } else { -1 };
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
    for EntryEpisodes { entry: place, episodes } in flown {
        let Some((level, entry)) = usize::try_from(place).ok().and_then(|place| all.get(place)) else {
            continue;
        };
        let episodes: Option<Vec<EpisodeMeasures>> =
            episodes.as_deref().map(|text| from_json("an evaluation", text)).transpose()?;
        scenarios.push(EvaluationScenario::of(place, *level, entry, &episodes.unwrap_or_default()));
    }
    let next = next(scenarios.len(), limit, scenarios.last().map(|row| (row.place, "")));
    Ok(axum::Json(EvaluationScenarios { scenarios, next }))
}

impl EvaluationScenario {
    fn of(place: i64, level: usize, entry: &SuiteEntry, episodes: &[EpisodeMeasures]) -> Self {
        let EpisodeMeasures { score, success, skill, lost, fuel_used } = EpisodeMeasures::mean_of(episodes);
        Self {
            place,
            scenario_id: entry.scenario.id().to_string(),
            task: entry.scenario.task().id(),
            level,
            part: match entry.part {
                SuitePart::Contested => "contested",
                SuitePart::AsTheyCome => "as_they_come",
            },
            floor: entry.bracket.floor,
            reference: entry.bracket.reference.score,
            episodes: episodes.len(),
            score,
            success,
            skill,
            lost,
            fuel_used,
        }
    }
}
