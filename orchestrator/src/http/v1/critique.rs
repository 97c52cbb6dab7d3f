//! A critique as it is answered, and the critique of one episode.

use axum::extract::State;
use env_core::critique::{Critique, Encounter, Failure, Measure, Remedy, Verdict, bearing_sector};
use env_core::{ActionLog, Scenario};
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::{NoQuery, Path};
use super::super::problem::Problem;
use super::episodes::Found;
use super::{id, run_id};
use crate::http::state::AppState;
use crate::engine::error::ServiceError;

/// What a finished episode shows, from its scenario and actions alone.
#[derive(Serialize, ToSchema)]
pub(super) struct CritiqueView {
    /// Why score was lost, in order of step.
    failures: Vec<FailureView>,
    /// What each action was worth, in order of step: the counterfactual is the same episode without it.
    actions: Vec<ActionView>,
    /// The deterministic judge.
    judged: JudgedView,
}

/// One reason why score was lost.
#[derive(Serialize, ToSchema)]
struct FailureView {
    /// The failure mode.
    mode: &'static str,
    /// Whose.
    agent: u32,
    /// When, counted from 1.
    step: u32,
    /// With what, from where, how fast; none where nothing was met.
    encounter: Option<EncounterView>,
    /// Further numbers that belong to the mode.
    measures: Vec<MeasureView>,
    /// The same in one sentence.
    words: String,
}

/// A number with its name and unit.
#[derive(Serialize, ToSchema)]
struct MeasureView {
    /// What it is.
    name: &'static str,
    /// How much.
    value: f64,
    /// Its unit, empty for a pure number.
    unit: &'static str,
}

/// The geometry of a meeting.
#[derive(Serialize, ToSchema)]
struct EncounterView {
    /// The id of what was met, among the bodies of its kind.
    body: u32,
    /// Where it was some steps before, seen from the agent: degrees in [0, 360) from radial out towards in-track.
    bearing_deg: f64,
    /// The same from +X towards +Y of the inertial frame; none in a world without one.
    bearing_inertial_deg: Option<f64>,
    /// Its bearing sector in a failure profile, 0 to 11.
    sector: u32,
    /// Relative speed at contact, in the world's unit of speed.
    relative_speed: f64,
    /// Its speed band in a failure profile, from 0.
    band: u32,
    /// The first step after which the body was visible (0: at the start); none if it never was.
    first_visible_step: Option<u32>,
    /// Steps from then to the contact in which somebody could still act.
    steps_left: u32,
    /// Whether acting from that step on, within what was left of the fuel, would have avoided it; none if it was never
    /// visible.
    avoidable: Option<bool>,
    /// The cheapest such action that was found.
    cheapest: Option<RemedyView>,
}

/// An action that would have helped.
#[derive(Serialize, ToSchema)]
struct RemedyView {
    /// When, counted from 1.
    step: u32,
    /// Its values, as the task's action space has them.
    values: Vec<f64>,
    /// What it costs, in the world's unit of fuel.
    cost: f64,
}

/// What an action was worth.
#[derive(Serialize, ToSchema)]
struct ActionView {
    /// When, counted from 1.
    step: u32,
    /// Whose.
    agent: u32,
    /// What it cost, in the world's unit of fuel.
    cost: f64,
    /// `needed`, `harmless`, `wasteful` or `harmful`.
    #[schema(value_type = String)]
    verdict: Verdict,
    /// The score with it minus the score without it.
    gain: f64,
}

/// The deterministic judge's word.
#[derive(Serialize, ToSchema)]
struct JudgedView {
    /// Within −1 to 1.
    value: f64,
    /// Which of the judge's cases it is.
    case: &'static str,
    /// The same in one sentence.
    words: String,
}

/// The critique of one episode.
#[derive(Serialize, ToSchema)]
pub(super) struct EpisodeCritique {
    /// The episode.
    episode: String,
    /// The task.
    task: &'static str,
    /// What it shows.
    #[serde(flatten)]
    critique: CritiqueView,
}

impl CritiqueView {
    /// A critique of an episode of this scenario.
    pub(super) fn of(scenario: &Scenario, critique: Critique) -> Self {
        let Critique { failures, actions, judged } = critique;
        let actions = actions.into_iter().map(|a| ActionView {
            step: a.step,
            agent: a.agent,
            cost: a.cost,
            verdict: a.verdict,
            gain: a.gain,
        });
        Self {
            failures: failures.into_iter().map(|failure| FailureView::of(scenario, failure)).collect(),
            actions: actions.collect(),
            judged: JudgedView { value: judged.value, case: judged.case, words: judged.words },
        }
    }
}

impl FailureView {
    fn of(scenario: &Scenario, failure: Failure) -> Self {
        let Failure { mode, agent, step, encounter, measures, words } = failure;
        let measure = |Measure { name, value, unit }| MeasureView { name, value, unit };
        Self {
            mode,
            agent,
            step,
            encounter: encounter.map(|e| EncounterView::of(scenario, e)),
            measures: measures.into_iter().map(measure).collect(),
            words,
        }
    }
}

impl EncounterView {
    fn of(scenario: &Scenario, encounter: Encounter) -> Self {
        let remedy = |Remedy { step, values, cost }| RemedyView { step, values, cost };
        Self {
            body: encounter.body,
            bearing_deg: encounter.bearing_deg,
            bearing_inertial_deg: encounter.bearing_inertial_deg,
            sector: bearing_sector(encounter.bearing_deg),
            relative_speed: encounter.relative_speed,
            band: scenario.task().speed_bands().band(encounter.relative_speed),
            first_visible_step: encounter.first_visible_step,
            steps_left: encounter.steps_left,
            avoidable: encounter.avoidable,
            cheapest: encounter.cheapest.map(remedy),
        }
    }
}

/// Criticise an episode: why it lost score, and what its actions were worth. Computed from the stored actions when asked;
/// it moves nothing.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}/critique", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id.")),
    responses(
        (status = 200, body = EpisodeCritique), (status = 400, body = Problem),
        (status = 404, body = Problem, description = "No such episode, or one that was never flown."),
        (status = 410, body = Problem, description = "The run keeps its actions no longer.")
    )
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, episode)): Path<(String, String)>,
) -> Result<axum::Json<EpisodeCritique>, Problem> {
    let mut conn = app.readers.acquire().await?;
    let found = Found::look(&mut conn, &run_id(&run)?, id("episode", &episode)?).await?;
    drop(conn);
    let log = found.log.ok_or_else(|| ServiceError::UnknownEpisode(format!("{episode} that was flown")))?;
    let scenario = found.scenario;
    let task = scenario.task().id();
    // Counterfactuals take milliseconds: off the threads that answer others.
    let critique = tokio::task::spawn_blocking(move || view(&scenario, &log)).await;
    let critique = critique.map_err(|_| Problem::internal())??;
    Ok(axum::Json(EpisodeCritique { episode: found.id.to_string(), task, critique }))
}

fn view(scenario: &Scenario, log: &ActionLog) -> Result<CritiqueView, Problem> {
    let critique = scenario.task().critique(scenario, log);
    let critique = critique.map_err(|error| crate::store::StoreError::corrupt("an action log", error))?;
    Ok(CritiqueView::of(scenario, critique))
}
