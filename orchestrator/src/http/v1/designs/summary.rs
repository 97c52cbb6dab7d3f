//! What was designed for a run, in numbers.

use std::collections::BTreeMap;

use axum::extract::State;
use designer::GateCheck;
use serde::Serialize;
use serde_json::Value;
use sqlx::Connection;
use utoipa::ToSchema;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::run_id;
use crate::http::state::AppState;
use crate::store::design_counters::{self, GateCount, LayoutCount, TrainingGroups};
use crate::store::layouts::{LayoutState, RetirementReason};
use crate::store::{design_requests, from_json, runs};
use crate::designs::DesignSettings;
use crate::designs::design_request::ADMITTED;
use crate::engine::error::ServiceError;
use crate::runs::settings::RunSettings;

/// What was designed for a run.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Summary {
    /// The run.
    run: String,
    /// What the run wants of designs.
    #[schema(value_type = Object)]
    settings: DesignSettings,
    /// Groups leased for training so far.
    train_groups: i64,
    /// Of these, designed.
    designed_groups: i64,
    /// designed_groups / train_groups; none before the first.
    share: Option<f64>,
    /// By task.
    tasks: Vec<TaskSummary>,
    /// By the designer that was asked.
    designers: Vec<DesignerSummary>,
    /// How the language model is; none where none is configured.
    #[schema(value_type = Option<Object>)]
    llm: Option<Value>,
}

/// What was designed for a task.
#[derive(Serialize, ToSchema)]
struct TaskSummary {
    /// The task.
    task: String,
    /// Layouts that serve.
    active: i64,
    /// Layouts that are retired, by why: `mastered`, `hopeless`, `hand`.
    retired: BTreeMap<String, i64>,
    /// Designs that the gate let through.
    admitted: i64,
    /// Designs that it refused, by its checks in their order; those that are not kept are counted too.
    refused: Vec<CheckCount>,
}

/// Designs that failed one check.
#[derive(Serialize, ToSchema)]
struct CheckCount {
    /// The check.
    check: &'static str,
    /// What it checks.
    about: &'static str,
    /// How many.
    count: i64,
}

/// What a designer was asked, and what it took.
#[derive(Serialize, ToSchema)]
struct DesignerSummary {
    /// `llm` or `procedural`.
    designer: String,
    /// Asks.
    asks: i64,
    /// Those that failed.
    failed: i64,
    /// Tokens in.
    tokens_in: i64,
    /// Tokens out.
    tokens_out: i64,
    /// What they cost.
    cost: f64,
}

/// Show what was designed for a run in numbers: by state, by what the gate said, and how much of training it is.
#[utoipa::path(
    get, path = "/runs/{run}/designs/summary", tag = "designs", operation_id = "summarise_designs",
    params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = Summary), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<Summary>, Problem> {
    let run = run_id(&run)?;
    let mut conn = app.readers.acquire().await?;
    let mut conn = conn.begin().await?; // all of one moment
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let TrainingGroups { all: train_groups, designed: designed_groups } =
        design_counters::groups(&mut conn, run.as_str()).await?;
    let states = design_counters::states(&mut conn, run.as_str()).await?;
    let verdicts = design_counters::verdicts(&mut conn, run.as_str()).await?;
    let totals = design_requests::totals(&mut conn, run.as_str()).await?;
    let tasks = settings.curriculum.tasks.iter().map(|plan| summary(&plan.task, &states, &verdicts));
    Ok(axum::Json(Summary {
        run: run.to_string(),
        tasks: tasks.collect(),
        settings: settings.design,
        train_groups,
        designed_groups,
        share: (train_groups > 0).then(|| designed_groups as f64 / train_groups as f64),
        designers: totals
            .into_iter()
            .map(|totals| DesignerSummary {
                designer: totals.designer.to_string(),
                asks: totals.requests,
                failed: totals.failed,
                tokens_in: totals.tokens_in,
                tokens_out: totals.tokens_out,
                cost: totals.cost,
            })
            .collect(),
        llm: app.designers.health(),
    }))
}

fn summary(
    task: &str,
    layouts: &[LayoutCount],
    verdicts: &[GateCount],
) -> TaskSummary {
    let count = |verdict: &str| {
        verdicts.iter().find(|of| of.task == task && of.verdict == verdict).map_or(0, |of| of.count)
    };
    let in_state = |state| layouts.iter().filter(move |of| of.task == task && of.state == state);
    let word = |reason: Option<RetirementReason>| reason.map_or("", RetirementReason::as_str).to_owned();
    TaskSummary {
        task: task.to_owned(),
        active: in_state(LayoutState::Active).map(|of| of.count).sum(),
        retired: in_state(LayoutState::Retired).map(|of| (word(of.reason), of.count)).collect(),
        admitted: count(ADMITTED),
        refused: GateCheck::ALL
            .iter()
            .map(|check| CheckCount {
                check: check.as_str(),
                about: check.description(),
                count: count(check.as_str()),
            })
            .collect(),
    }
}
