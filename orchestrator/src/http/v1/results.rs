//! Reports of finished and failed episodes.

use std::collections::BTreeMap;

use api_types::{
    ActionPrecision, ActionStopReason, EpisodeResult, EpisodeResultStatus, RefusalCode, ResultsRequest,
    ResultsResponse,
};
use axum::Extension;
use axum::extract::{Request, State};
use env_core::StopReason;
use env_core::log::Precision;
use serde_json::Value;
use store::to_json;
use strict_input::{FieldError, ParsedInput};

use crate::http::access::Caller;
use crate::http::blocking::run_blocking;
use crate::http::extract::{EncodedBody, NoQuery, Path, parse_value};
use crate::http::large_body::{LargeBody, receive_large_body};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;

use crate::results::refusal::Refusal;
use crate::results::report::ReportReceipts;
use crate::results::report_summary::ReportSummary;
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::trainer_activity::TrainerWork;

/// Largest number of results in a batch.
const MAX_RESULTS: usize = 5000;
/// Longest reason of a failure, in characters.
const MAX_REASON_CHARS: usize = 1000;

/// Report results of episodes.
///
/// Each result has its own receipt; a refused result does not affect the others. A repeated result returns the same receipt and
/// counts once. A result for another principal's lease is refused (`foreign_lease`). The server responds after the commit.
#[utoipa::path(
    post, path = "/runs/{run}/results", tag = "results", request_body = ResultsRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = ResultsResponse), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn report_results(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    request: Request,
) -> Result<(Extension<TrainerWork>, axum::Json<ResultsResponse>), Problem> {
    let run = parse_run_id(&run)?;
    let LargeBody { body, permit: _permit } = receive_large_body(&app.body_limit, request).await?;
    let (policy_version, episodes) = run_blocking(move || read_report(body)).await?;
    let report = app.lease_service.submit_results(run, caller.actor(), policy_version, episodes).await?;
    let ReportReceipts { receipts, summary } = report;
    let ReportSummary { moves, groups, refills } = summary;
    let work = TrainerWork {
        episodes: receipts.len() as u64,
        policy_version: policy_version.map(i64::from),
        ..TrainerWork::default()
    };
    Ok((Extension(work), axum::Json(ResultsResponse { results: receipts, moves, groups, refills })))
}

/// Reads the episodes of a body and the policy version that it names.
pub(in crate::http) fn read_report(
    body: EncodedBody,
) -> Result<(Option<u32>, Vec<ReportedEpisode>), Problem> {
    let ParsedInput { value, non_finite } = body.parse()?;
    let mut invalid_numbers = BTreeMap::new();
    for error in non_finite {
        let (index, error) = in_result(error)?;
        invalid_numbers.entry(index).or_insert(error);
    }
    let body: ResultsRequest = parse_value(value)?;
    if body.results.len() > MAX_RESULTS {
        let detail = format!("must have at most {MAX_RESULTS} entries, got {}", body.results.len());
        return Err(Problem::invalid("results", detail));
    }
    let results = body.results.into_iter().enumerate();
    let read = |(index, value)| read_result(index, value, invalid_numbers.remove(&index));
    let episodes = results.map(read).collect::<Result<_, _>>()?;
    Ok((body.policy_version, episodes))
}

/// Returns the index of the result that has an invalid number, with the error inside that result. A number outside the results
/// rejects the body.
fn in_result(error: FieldError) -> Result<(usize, FieldError), Problem> {
    let inside = error.field.strip_prefix("results.").and_then(|rest| {
        let (index, field) = rest.split_once('.').unwrap_or((rest, ""));
        Some((index.parse().ok()?, field.to_owned()))
    });
    match inside {
        Some((index, field)) => Ok((index, FieldError { field, reason: error.reason })),
        None => Err(Problem::invalid(error.field, error.reason)),
    }
}

/// Reads one result. A malformed result is refused on its own if it names its episode; otherwise the whole body is rejected.
fn read_result(
    index: usize,
    value: Value,
    invalid_number: Option<FieldError>,
) -> Result<ReportedEpisode, Problem> {
    let episode = value.get("episode").and_then(Value::as_str).map(str::to_owned);
    let result = invalid_number.map_or_else(|| strict_input::from_value(value), Err);
    match (result, episode) {
        (Ok(result), _) => reported_episode(result),
        (Err(fault), Some(episode)) => {
            let detail = format!("{}: {}", fault.field, fault.reason);
            let outcome = ReportedOutcome::Refused(Refusal::new(RefusalCode::InvalidResult, detail));
            Ok(ReportedEpisode { episode, outcome, policy_version: None, metrics: None })
        }
        (Err(fault), None) => {
            let dot = if fault.field.is_empty() { "" } else { "." };
            Err(Problem::invalid(format!("results.{index}{dot}{}", fault.field), fault.reason))
        }
    }
}

fn reported_episode(result: EpisodeResult) -> Result<ReportedEpisode, Problem> {
    let refused = |why: &str| {
        ReportedOutcome::Refused(Refusal::new(RefusalCode::InvalidLog, format!("actions: {why}")))
    };
    let outcome = match (result.status, result.actions) {
        (EpisodeResultStatus::Finished, Some(actions)) => ReportedOutcome::Finished {
            steps: actions.steps,
            precision: precision(actions.precision),
            stopped: actions.stopped.map(stop_reason),
        },
        (EpisodeResultStatus::Finished, None) => refused("must be set for a finished episode"),
        (EpisodeResultStatus::Failed, None) => ReportedOutcome::Failed {
            reason: result.reason.unwrap_or_default().chars().take(MAX_REASON_CHARS).collect(),
        },
        (EpisodeResultStatus::Failed, Some(_)) => refused("must be left out for a failed episode"),
    };
    let metrics = result.metrics.map(|metrics| to_json(&metrics)).transpose()?;
    Ok(ReportedEpisode { episode: result.episode, outcome, policy_version: result.policy_version, metrics })
}

/// Converts the precision of submitted actions.
pub(super) const fn precision(precision: ActionPrecision) -> Precision {
    match precision {
        ActionPrecision::F32 => Precision::F32,
        ActionPrecision::F64 => Precision::F64,
    }
}

/// Converts the reason why submitted actions end before the episode.
pub(super) const fn stop_reason(reason: ActionStopReason) -> StopReason {
    match reason {
        ActionStopReason::Unparsable => StopReason::Unparsable,
        ActionStopReason::TooLong => StopReason::TooLong,
        ActionStopReason::TooLate => StopReason::TooLate,
    }
}
