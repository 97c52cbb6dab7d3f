//! Check of a scenario that a user wrote: validation, bracket, replay and critique.

use api_types::{EpisodeActions, EpisodeOutcome, ReplayedOutcome, ScenarioCheck, ScenarioRequest};
use axum::Extension;
use axum::extract::State;
use env_core::admission::{SuccessRule, admit_while, is_success};
use env_core::error::ReplayError;
use env_core::log::Precision;
use env_core::rollout::{read_log, replay};
use env_core::{ActionLog, Scenario, Seed, SeedSpace};
use serde_json::Value;

use super::episode_critique::critique_response;
use super::results::{precision, stop_reason};
use crate::http::access::{Caller, plan_denial};
use crate::http::extract::{Json, NoQuery, parse_value};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::leases::bracket_view::scenario_bracket;
use env_core::frames::{FrameContent, FrameRange, MAX_FRAME_BYTES, frames};

/// Check a scenario: validate it, compute its bracket, and replay and criticise actions on it.
///
/// The server stores nothing. A client that may not read the planner's plan of the scenario gets the critique without avoiding
/// actions, and `critique.withheld` says why.
#[utoipa::path(
    post, path = "/scenarios", tag = "scenarios", request_body = ScenarioRequest,
    responses(
        (status = 200, body = ScenarioCheck), (status = 400, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 503, body = Problem, description = "Too many checks run at once, or the check took longer than a minute.")
    )
)]
pub(super) async fn check_scenario(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Json(body): Json<Value>,
) -> Result<axum::Json<ScenarioCheck>, Problem> {
    let request = read_request(body)?;
    let scenario = user_scenario(&request.scenario)?;
    let denial = plan_denial(&mut *app.readers.acquire().await?, &caller, &scenario).await?;
    let options = CheckOptions {
        actions: request.actions,
        telemetry: request.telemetry,
        withheld: denial.map(|denial| denial.to_string()),
    };
    let check = app.concurrency.planning.run(move |wanted| evaluate(&scenario, options, wanted)).await?;
    Ok(axum::Json(check?))
}

/// Parses a scenario with a user seed: training and evaluation scenarios are not disclosed here.
///
/// # Errors
/// Returns a problem with the field at fault.
pub(super) fn user_scenario(scenario: &Value) -> Result<Scenario, Problem> {
    let scenario = Scenario::from_json(scenario).map_err(|error| {
        let field = match error.field() {
            "scenario" => "scenario".to_owned(),
            field => format!("scenario.{field}"),
        };
        Problem::invalid(field, error.reason())
    })?;
    if scenario.seed().space() != SeedSpace::User {
        let error = Seed::user(scenario.seed().get()).err();
        return Err(Problem::invalid(
            "scenario.seed",
            error.map_or_else(String::new, |error| error.reason()),
        ));
    }
    Ok(scenario)
}

/// Problem of actions that do not fit the scenario; `parent` is the field of the log, empty for the whole body.
pub(super) fn replay_problem(parent: &str, error: ReplayError) -> Problem {
    match error {
        ReplayError::Scenario(error) => Problem::invalid("scenario", error.to_string()),
        ReplayError::Policy(error) => Problem::invalid("policy", error.to_string()),
        ReplayError::Log(error) if parent.is_empty() => {
            Problem::invalid(error.field().to_owned(), error.reason())
        }
        ReplayError::Log(error) => Problem::invalid(format!("{parent}.{}", error.field()), error.reason()),
    }
}

/// Parses a request. A scenario without its wrapper gets an error that shows the wrapper.
fn read_request(body: Value) -> Result<ScenarioRequest, Problem> {
    if body.get("scenario").is_none() && body.get("task").is_some() {
        let detail = "is required; send {\"scenario\": {\"task\": …, \"seed\": 7}}";
        return Err(Problem::invalid("scenario", detail));
    }
    parse_value(body)
}

/// Parts of the check of a scenario that depend on the request.
struct CheckOptions {
    /// Actions to replay and criticise.
    actions: Option<EpisodeActions>,
    /// True if the check includes frames with observations.
    telemetry: bool,
    /// Reason why the critique is without avoiding actions.
    withheld: Option<String>,
}

fn evaluate(
    scenario: &Scenario,
    options: CheckOptions,
    wanted: &dyn Fn() -> bool,
) -> Result<ScenarioCheck, Problem> {
    let CheckOptions { actions, telemetry, withheld } = options;
    // `None` means that the client has disconnected.
    let admission = admit_while(scenario, wanted).ok_or_else(Problem::timed_out)?;
    let (mut replayed, mut critique) = (None, None);
    let mut log = ActionLog::new(scenario.task().action_space().dim(), Precision::F64);
    if let (Some(actions), Some(bracket)) = (actions, &admission.bracket) {
        let stopped = actions.stopped.map(stop_reason);
        log = read_log(scenario, &actions.steps, precision(actions.precision), stopped)
            .map_err(|error| replay_problem("actions", error.into()))?;
        let outcome = replay(scenario, &log).map_err(|error| replay_problem("actions", error))?;
        replayed = Some(ReplayedOutcome {
            skill: bracket.skill(outcome.score),
            success: is_success(scenario, SuccessRule::Task, bracket, &outcome),
            outcome: outcome_response(outcome),
        });
        let found =
            scenario.task().critique(scenario, &log).map_err(|error| replay_problem("actions", error))?;
        critique = Some(critique_response(scenario, found, withheld));
    }
    let frames = (telemetry && admission.fair.is_ok())
        .then(|| frames(scenario, &log, FrameContent::Telemetry, FrameRange::all(MAX_FRAME_BYTES)))
        .transpose()
        .map_err(|error| Problem::invalid("telemetry", error.to_string()))?;
    Ok(ScenarioCheck {
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        fair: admission.fair.is_ok(),
        unfair_reason: admission.fair.err().map(|error| error.to_string()),
        solvable: admission.solvable,
        contested: admission.contested,
        bracket: admission.bracket.map(|b| scenario_bracket(scenario, &b)),
        outcome: replayed,
        critique,
        frames,
    })
}

/// Converts the outcome of an episode.
pub(super) const fn outcome_response(outcome: env_core::EpisodeOutcome) -> EpisodeOutcome {
    let env_core::EpisodeOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s } = outcome;
    EpisodeOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s }
}
