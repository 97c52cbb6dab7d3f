//! Conversion of stored designs and design requests to responses.

use crate::api_enums::ConvertEnum;
use api_types::{DesignAim, DesignPage, DesignRequestSummary, DesignResults, DesignSummary, DesignTable};
use serde_json::Value;
use store::StoreError;
use store::design_requests::{DesignRequestRow, DesignerKind};
use store::from_json;
use store::ids::{DesignRequestId, LayoutId};
use store::layouts::LayoutRow;

use crate::designs::layout_status::RecentResult;
use crate::http::paging::{PageCursor, next_cursor};
use crate::http::problem::Problem;
use clock::rfc3339;

/// Converts the row of a layout.
///
/// # Errors
/// Returns an internal problem if the stored outcomes cannot be read.
pub(in crate::http::v1) fn design_summary(row: &LayoutRow) -> Result<DesignSummary, Problem> {
    let mean = |sum: f64| (row.episodes > 0).then(|| sum / row.episodes as f64);
    let aim = row.mode.clone().map(|mode| DesignAim {
        mode,
        bearing_deg: row.bearing_deg,
        frame: row.frame.clone(),
    });
    let designer: DesignerKind =
        row.designer.parse().map_err(|error| StoreError::corrupt("the designer of a layout", error))?;
    let recent: Vec<RecentResult> = from_json("a layout's results", &row.recent_results)?;
    Ok(DesignSummary {
        id: LayoutId::of_run(&row.run, row.id).to_string(),
        run: row.run.clone(),
        task: row.task.clone(),
        level: row.level,
        start_rung: row.start_rung,
        name: row.name.clone(),
        request: DesignRequestId(row.request).to_string(),
        designer: designer.convert(),
        round: row.round,
        aim,
        kind: row.kind.map(ConvertEnum::convert),
        state: row.state.convert(),
        state_reason: row.retirement_reason.map(|why| why.to_string()).or_else(|| row.gate_check.clone()),
        refusal_reason: row.refusal_reason.clone(),
        novelty: row.novelty,
        results: DesignResults {
            groups: row.groups,
            outcomes: row.outcomes,
            episodes: row.episodes,
            successes: row.successes,
            success: mean(row.successes as f64),
            score: mean(row.score_sum),
            regret: mean(row.regret_sum),
            as_aimed: row.aimed_failure_share(),
            recent: recent.into_iter().map(RecentResult::success_rate).collect(),
        },
        created_at: rfc3339(row.created_at),
        served_at: row.served_at.map(rfc3339),
        retired_at: row.retired_at.map(rfc3339),
    })
}

/// Converts a page of layouts.
///
/// # Errors
/// Returns an internal problem if the stored outcomes of a layout cannot be read.
pub(in crate::http::v1) fn design_page(rows: &[LayoutRow], limit: i64) -> Result<DesignPage, Problem> {
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    Ok(DesignPage { designs: rows.iter().map(design_summary).collect::<Result<_, _>>()?, next })
}

/// Design as its designer returned it, or as the gate read it.
///
/// # Errors
/// Returns an internal problem if the stored design cannot be read.
pub(in crate::http::v1) fn design_json(row: &LayoutRow) -> Result<Option<Value>, Problem> {
    Ok(row.design.as_deref().map(|text| from_json("a design", text)).transpose()?)
}

/// Returns a design as a table; `None` if the world of its task cannot read it.
pub(super) fn design_table(task: &str, design: &Value) -> Option<DesignTable> {
    let table = designer::design_language(env_core::task(task)?)?.table(design)?;
    let header = table.header.into_iter().map(str::to_owned).collect();
    Some(DesignTable { aim: table.aim, header, rows: table.rows })
}

/// Converts the row of a request.
///
/// # Errors
/// Returns an internal problem if its stored warnings cannot be read.
pub(super) fn request_summary(row: DesignRequestRow) -> Result<DesignRequestSummary, Problem> {
    Ok(DesignRequestSummary {
        id: DesignRequestId(row.id).to_string(),
        warnings: from_json("the warnings of a design request", &row.warnings)?,
        task: row.task,
        level: row.level,
        designer: row.designer.convert(),
        requested_by: row.requested_by.convert(),
        state: row.state.convert(),
        wanted: row.wanted,
        admitted: row.admitted,
        refused: row.refused,
        model: row.model,
        prompt_version: row.prompt_version,
        rounds: row.rounds,
        tokens_in: row.tokens_in,
        tokens_out: row.tokens_out,
        cost: row.cost,
        latency_ms: row.latency_ms,
        criticised: row.criticised,
        error: row.error,
        created_at: rfc3339(row.created_at),
        ended_at: row.ended_at.map(rfc3339),
    })
}
