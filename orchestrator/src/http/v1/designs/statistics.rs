//! Numbers of a run's designs.

use crate::api_enums::ConvertEnum;
use api_types::{DesignStatistics, DesignerUsage, GateCheckCount, LearningSignal, TaskDesigns};
use axum::extract::State;
use designer::GateCheck;
use store::design_counters::{self, GateCount, LayoutCount, TrainingGroups};
use store::layouts::{LayoutState, RetirementReason};
use store::learning_signals::{self, SignalSums};
use store::{StoreError, design_requests, from_json, runs};

use crate::designs::finish_design::ADMITTED;
use crate::designs::learning_value::ArmValue;
use crate::engine::error::ServiceError;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::settings::RunSettings;

/// Get statistics of a run's designs: by state, by check of the gate, and their share of training.
#[utoipa::path(
    get, path = "/runs/{run}/designs/statistics", tag = "designs",
    params(("run" = String, Path, description = "The run's id.")),
    responses((status = 200, body = DesignStatistics), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn get_design_statistics(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
) -> Result<axum::Json<DesignStatistics>, Problem> {
    let run = parse_run_id(&run)?;
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let row = runs::get(&mut conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let TrainingGroups { all: train_groups, designed: designed_groups } =
        design_counters::groups(&mut conn, run.as_str()).await?;
    let signals = learning_signals::get(&mut conn, run.as_str()).await?;
    let states = design_counters::states(&mut conn, run.as_str()).await?;
    let verdicts = design_counters::verdicts(&mut conn, run.as_str()).await?;
    let totals = design_requests::totals(&mut conn, run.as_str()).await?;
    let tasks = settings.curriculum.tasks.iter().map(|plan| task_designs(&plan.task, &states, &verdicts));
    Ok(axum::Json(DesignStatistics {
        run: run.to_string(),
        tasks: tasks.collect(),
        settings: serde_json::to_value(settings.design)
            .map_err(|error| StoreError::corrupt("a run's settings", error))?,
        train_groups,
        designed_groups,
        share: (train_groups > 0).then(|| designed_groups as f64 / train_groups as f64),
        next_share: settings.design.current_share(&signals),
        designed_signal: learning_signal(signals.designed),
        ordinary_signal: learning_signal(signals.ordinary),
        designers: totals
            .into_iter()
            .map(|totals| DesignerUsage {
                designer: totals.designer.convert(),
                requests: totals.requests,
                failed: totals.failed,
                tokens_in: totals.tokens_in,
                tokens_out: totals.tokens_out,
                cost: totals.cost,
            })
            .collect(),
        llm: app.designers.health(),
    }))
}

fn learning_signal(sums: SignalSums) -> LearningSignal {
    let ArmValue { mean, error_sq } = ArmValue::of(sums);
    LearningSignal { groups: sums.weight, mean, standard_error: error_sq.sqrt() }
}

fn task_designs(task: &str, layouts: &[LayoutCount], verdicts: &[GateCount]) -> TaskDesigns {
    let count = |verdict: &str| {
        verdicts.iter().find(|of| of.task == task && of.verdict == verdict).map_or(0, |of| of.count)
    };
    let in_state = |state| layouts.iter().filter(move |of| of.task == task && of.state == state);
    let word = |reason: Option<RetirementReason>| reason.map_or("", RetirementReason::as_str).to_owned();
    TaskDesigns {
        task: task.to_owned(),
        active: in_state(LayoutState::Active).map(|of| of.count).sum(),
        retired: in_state(LayoutState::Retired).map(|of| (word(of.retirement_reason), of.count)).collect(),
        admitted: count(ADMITTED),
        refused: GateCheck::ALL
            .iter()
            .map(|check| GateCheckCount {
                check: check.as_str().to_owned(),
                description: check.description().to_owned(),
                count: count(check.as_str()),
            })
            .collect(),
    }
}
