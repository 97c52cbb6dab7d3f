//! Scenarios by hand: validate, bracket, replay, and criticise.

use axum::extract::State;
use env_core::admission::{SuccessRule, admit_while, is_success};
use env_core::log::Precision;
use env_core::error::ReplayError;
use env_core::rollout::{read_log, replay};
use env_core::{ActionLog, Scenario, Seed, SeedSpace};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::{Json, NoQuery, read};
use super::super::problem::Problem;
use super::critique::CritiqueView;
use super::results::Actions;
use crate::frames::{FrameContent, FrameRange, MAX_FRAME_BYTES, frames};
use crate::http::state::AppState;
use crate::store::brackets::StoredOutcome;
use crate::leases::bracket_view::BracketView;

/// A scenario to look at, and actions to fly on it.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Wish {
    /// The scenario: a task and a seed from 0 to 2^51 − 1, and what is wanted of params, physics and layout, whose defaults
    /// hold for what is left out. A layout is `{mode, bodies, provenance}`: tables of rows that stand after what is drawn
    /// (`extend`) or instead of it (`replace`), at most 512 rows in all.
    #[schema(value_type = Object, example = json!({"task": "kessler/survival", "params": {"debris": 100}, "seed": 7}))]
    scenario: Value,
    /// An action log to replay on it.
    actions: Option<Actions>,
    /// Whether to answer with `frames`: the flight step by step, with what the agents saw (false). Without actions
    /// nobody acts.
    #[serde(default)]
    telemetry: bool,
}

/// What a scenario is.
#[derive(Serialize, ToSchema)]
pub(super) struct Checked {
    /// Its id.
    scenario_id: String,
    /// The scenario, complete.
    #[schema(value_type = Object)]
    scenario: Value,
    /// Nothing is lost before anybody could act.
    fair: bool,
    /// Why it is not fair.
    unfair_because: Option<String>,
    /// The reference succeeds.
    solvable: bool,
    /// The reference succeeds and acting blindly mostly does not.
    contested: bool,
    /// What it is worth.
    bracket: Option<BracketView>,
    /// How the actions fared, if any were sent.
    flown: Option<Judged>,
    /// What the actions show, if any were sent: why score was lost, and what each was worth.
    critique: Option<CritiqueView>,
    /// Where `telemetry` was asked for and the scenario is fair: the start, then one frame a step, as a run's episode is
    /// replayed, with `observation`: what the agents saw.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Object>>)]
    frames: Option<Vec<Value>>,
}

/// How actions fared.
#[derive(Serialize, ToSchema)]
struct Judged {
    /// The flight.
    #[serde(flatten)]
    flown: StoredOutcome,
    /// Against floor and reference.
    skill: Option<f64>,
    /// By the task's own rule.
    success: bool,
}

/// Validate, bracket, replay and criticise a scenario by hand. Nothing is stored.
#[utoipa::path(
    post, path = "/scenarios", tag = "scenarios", request_body = Wish,
    responses(
        (status = 200, body = Checked), (status = 400, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 503, body = Problem, description = "Too many are planned on at once, or it took longer than a minute.")
    )
)]
pub(super) async fn check(
    _: NoQuery,
    State(app): State<AppState>,
    Json(body): Json<Value>,
) -> Result<axum::Json<Checked>, Problem> {
    let wish = wish(body)?;
    let scenario = by_user(&wish.scenario)?;
    let planned =
        app.turns.planning.work(move |wanted| judge(&scenario, wish.actions, wish.telemetry, wanted)).await?;
    Ok(axum::Json(planned?))
}

/// A scenario that whoever asks may see: of no training and no evaluation.
pub(super) fn by_user(scenario: &Value) -> Result<Scenario, Problem> {
    let scenario = Scenario::from_json(scenario).map_err(|error| {
        let field = match error.field() {
            "scenario" => "scenario".to_owned(),
            field => format!("scenario.{field}"),
        };
        Problem::invalid(field, error.to_string())
    })?;
    if scenario.seed().space() != SeedSpace::User {
        let error = Seed::user(scenario.seed().get()).err();
        return Err(Problem::invalid("scenario.seed", error.map_or_else(String::new, |e| e.to_string())));
    }
    Ok(scenario)
}

/// Actions that are not of this scenario; `under` is the field that they stand in, if in one.
pub(super) fn refuse(under: &str, error: ReplayError) -> Problem {
    match error {
        ReplayError::Scenario(error) => Problem::invalid("scenario", error.to_string()),
        ReplayError::Log(error) if under.is_empty() => {
            Problem::invalid(error.field().to_owned(), error.to_string())
        }
        ReplayError::Log(error) => {
            Problem::invalid(format!("{under}.{}", error.field()), error.with_parent(under).to_string())
        }
    }
}

/// A body, told of the wrapper where it is a bare scenario.
fn wish(body: Value) -> Result<Wish, Problem> {
    if body.get("scenario").is_none() && body.get("task").is_some() {
        let detail = "it is missing: wrap the scenario in it, as {\"scenario\": {\"task\": …, \"seed\": 7}}";
        return Err(Problem::invalid("scenario", detail));
    }
    read(body)
}

fn judge(
    scenario: &Scenario,
    actions: Option<Actions>,
    telemetry: bool,
    wanted: &dyn Fn() -> bool,
) -> Result<Checked, Problem> {
    // Given up only where nobody reads the answer.
    let admission = admit_while(scenario, wanted).ok_or_else(Problem::timed_out)?;
    let (mut judged, mut critique) = (None, None);
    let mut log = ActionLog::new(scenario.task().action_space().columns.len(), Precision::F64);
    if let (Some(actions), Some(bracket)) = (actions, &admission.bracket) {
        let stopped = actions.stopped.map(Into::into);
        log = read_log(scenario, &actions.steps, actions.precision.into(), stopped)
            .map_err(|error| refuse("actions", error.into()))?;
        let flown = replay(scenario, &log).map_err(|error| refuse("actions", error))?;
        judged = Some(Judged {
            skill: bracket.skill(flown.score),
            success: is_success(scenario, SuccessRule::Task, bracket, &flown),
            flown: flown.into(),
        });
        let shown = scenario.task().critique(scenario, &log).map_err(|error| refuse("actions", error))?;
        critique = Some(CritiqueView::of(scenario, shown));
    }
    let frames = (telemetry && admission.fair.is_ok())
        .then(|| frames(scenario, &log, FrameContent::Telemetry, FrameRange::all(MAX_FRAME_BYTES)))
        .transpose()
        .map_err(|error| Problem::invalid("telemetry", error.to_string()))?;
    Ok(Checked {
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        fair: admission.fair.is_ok(),
        unfair_because: admission.fair.err().map(|error| error.to_string()),
        solvable: admission.solvable,
        contested: admission.contested,
        bracket: admission.bracket.map(|b| BracketView::of(scenario, &b)),
        flown: judged,
        critique,
        frames,
    })
}
