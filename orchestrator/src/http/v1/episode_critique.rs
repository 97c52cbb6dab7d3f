//! Critique of one episode, and the conversion of critiques to responses.

use api_types::{
    ActionValue, ActionVerdict, AvoidingAction, Critique, CritiqueEncounter, CritiqueFailure,
    EpisodeCritique, FailureMeasure, JudgeAssessment,
};
use axum::Extension;
use axum::extract::State;
use env_core::critique::{self, Encounter, Failure, Measure, Remedy, Verdict, profile_sector};
use env_core::{ActionLog, Scenario};

use super::episodes::StoredEpisode;
use crate::engine::error::ServiceError;
use crate::http::access::{Caller, plan_denial};
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;

/// Converts the critique of an episode of `scenario`. If there is a reason to withhold avoiding actions, failures are without them.
pub(super) fn critique_response(
    scenario: &Scenario,
    critique: critique::Critique,
    withheld: Option<String>,
) -> Critique {
    let critique::Critique { failures, actions, assessment } = critique;
    let action = |a: critique::ActionVerdict| ActionValue {
        step: a.step,
        agent: a.agent,
        cost: a.cost,
        verdict: action_verdict(a.verdict),
        gain: a.gain,
    };
    let failures = failures.into_iter().map(|failure| failure_response(scenario, failure));
    let failures = failures.map(|failure| match withheld {
        Some(_) => without_avoiding_action(scenario, failure),
        None => failure,
    });
    Critique {
        failures: failures.collect(),
        actions: actions.into_iter().map(action).collect(),
        assessment: JudgeAssessment {
            value: assessment.value,
            case: assessment.case.to_owned(),
            explanation: assessment.explanation,
        },
        withheld,
    }
}

/// Returns a failure without its avoiding action. Measures and explanation name it, too.
fn without_avoiding_action(scenario: &Scenario, failure: CritiqueFailure) -> CritiqueFailure {
    let mode = scenario.task().failure_modes().iter().find(|mode| mode.name == failure.mode);
    CritiqueFailure {
        encounter: failure
            .encounter
            .map(|encounter| CritiqueEncounter { cheapest_avoidance: None, ..encounter }),
        measures: Vec::new(),
        explanation: mode.map_or_else(String::new, |mode| mode.description.to_owned()),
        ..failure
    }
}

/// Converts the verdict on an action.
pub(super) const fn action_verdict(verdict: Verdict) -> ActionVerdict {
    match verdict {
        Verdict::Needed => ActionVerdict::Needed,
        Verdict::Harmless => ActionVerdict::Harmless,
        Verdict::Wasteful => ActionVerdict::Wasteful,
        Verdict::Harmful => ActionVerdict::Harmful,
    }
}

fn failure_response(scenario: &Scenario, failure: Failure) -> CritiqueFailure {
    let sector_deg = failure.sector_deg();
    let Failure { mode, agent, step, encounter, measures, explanation, .. } = failure;
    let measure = |Measure { name, value, unit }| FailureMeasure {
        name: String::from(name),
        value,
        unit: String::from(unit),
    };
    CritiqueFailure {
        mode: mode.to_owned(),
        agent,
        step,
        sector: sector_deg.map(profile_sector),
        sector_deg,
        encounter: encounter.map(|encounter| encounter_response(scenario, encounter)),
        measures: measures.into_iter().map(measure).collect(),
        explanation,
    }
}

fn encounter_response(scenario: &Scenario, encounter: Encounter) -> CritiqueEncounter {
    let remedy = |Remedy { step, values, cost }| AvoidingAction { step, values, cost };
    CritiqueEncounter {
        body: encounter.body,
        bearing_deg: encounter.bearing_deg,
        bearing_inertial_deg: encounter.bearing_inertial_deg,
        relative_speed: encounter.relative_speed,
        band: scenario.task().speed_bands().band(encounter.relative_speed),
        first_visible_step: encounter.first_visible_step,
        steps_left: encounter.steps_left,
        avoidable: encounter.avoidable,
        cheapest_avoidance: encounter.cheapest_avoidance.map(remedy),
    }
}

/// Get the critique of an episode: its failures and a verdict on each action.
///
/// The server computes it from the stored actions on each request; it does not affect the curriculum. A client that may not read the
/// planner's plan of the scenario gets the critique without avoiding actions, and `withheld` says why.
#[utoipa::path(
    get, path = "/runs/{run}/episodes/{episode}/critique", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), ("episode" = String, Path, description = "The episode's id.")),
    responses(
        (status = 200, body = EpisodeCritique), (status = 400, body = Problem),
        (status = 404, body = Problem, description = "The episode does not exist, or it has no actions."),
        (status = 409, body = Problem, description = "The group of the episode is not begun."),
        (status = 410, body = Problem, description = "The actions of the episode were deleted.")
    )
)]
pub(super) async fn get_episode_critique(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path((run, episode)): Path<(String, String)>,
) -> Result<axum::Json<EpisodeCritique>, Problem> {
    let run = parse_run_id(&run)?;
    let id = parse_id("episode", &episode)?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let found = StoredEpisode::load(&mut conn, &run, id).await?;
    let denial = plan_denial(&mut conn, &caller, &found.scenario).await?;
    drop(conn);
    let log = found.log.ok_or_else(|| ServiceError::UnknownEpisode(format!("{episode} with actions")))?;
    let scenario = found.scenario;
    let task = scenario.task().id();
    // Counterfactuals take milliseconds or more, so that they do not run on the threads of the runtime.
    let critique = tokio::task::spawn_blocking(move || {
        criticise(&scenario, &log, denial.map(|denial| denial.to_string()))
    })
    .await;
    let critique = critique.map_err(|_| Problem::internal())??;
    Ok(axum::Json(EpisodeCritique { episode: found.id.to_string(), task: task.to_owned(), critique }))
}

fn criticise(scenario: &Scenario, log: &ActionLog, withheld: Option<String>) -> Result<Critique, Problem> {
    let critique = scenario.task().critique(scenario, log);
    let critique = critique.map_err(|error| store::StoreError::corrupt("an action log", error))?;
    Ok(critique_response(scenario, critique, withheld))
}
