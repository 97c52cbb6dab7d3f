//! Conversion of stored designs to responses, and checks of the filters of their lists.

use std::collections::BTreeSet;

use api_types::{DesignAim, DesignPage, DesignResults, DesignSummary};
use env_core::TaskSpec;
use serde_json::Value;

use super::super::super::problem::Problem;
use super::super::next_cursor;
use crate::clock::rfc3339;
use crate::ids::{DesignRequestId, LayoutId};
use crate::store::from_json;
use crate::store::layouts::LayoutRow;

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
    Ok(DesignSummary {
        id: LayoutId(row.id).to_string(),
        run: row.run.clone(),
        task: row.task.clone(),
        level: row.level,
        name: row.name.clone(),
        ask: DesignRequestId(row.request).to_string(),
        designer: row.designer.clone(),
        round: row.round,
        aim,
        claim: row.claim.map(|claim| claim.to_string()),
        state: row.state.to_string(),
        why: row.why.map(|why| why.to_string()).or_else(|| row.gate_check.clone()),
        reason: row.reason.clone(),
        novelty: row.novelty,
        flown: DesignResults {
            groups: row.groups,
            outcomes: row.outcomes,
            episodes: row.episodes,
            successes: row.successes,
            success: mean(row.successes as f64),
            score: mean(row.score),
            regret: mean(row.regret),
            as_aimed: row.as_aimed_share(),
            recent: from_json("a layout's outcomes", &row.recent)?,
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
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(DesignPage { designs: rows.iter().map(design_summary).collect::<Result<_, _>>()?, next })
}

/// Design as its designer returned it, or as the gate read it.
///
/// # Errors
/// Returns an internal problem if the stored design cannot be read.
pub(in crate::http::v1) fn design_json(row: &LayoutRow) -> Result<Option<Value>, Problem> {
    Ok(row.design.as_deref().map(|text| from_json("a design", text)).transpose()?)
}

/// Parses a word of a query that must be one of `known`.
///
/// # Errors
/// Returns a problem with the known words for any other word.
pub(in crate::http::v1) fn parse_filter_word<T: Copy + std::fmt::Display>(
    field: &str,
    word: Option<&str>,
    known: &[T],
) -> Result<Option<T>, Problem> {
    let Some(word) = word else { return Ok(None) };
    let value = known.iter().copied().find(|value| value.to_string() == word);
    value.map(Some).ok_or_else(|| unknown_word(field, known.iter().map(ToString::to_string)))
}

/// Checks that one of the tasks has a failure mode.
///
/// # Errors
/// Returns a problem with the failure modes of the tasks if none has it.
pub(in crate::http::v1) fn check_failure_mode(
    field: &str,
    mode: Option<&String>,
    tasks: &[&'static dyn TaskSpec],
) -> Result<(), Problem> {
    let modes: BTreeSet<&str> =
        tasks.iter().flat_map(|task| task.failure_modes()).map(|mode| mode.name).collect();
    match mode {
        Some(mode) if !modes.contains(mode.as_str()) => {
            Err(unknown_word(field, modes.into_iter().map(str::to_owned)))
        }
        _ => Ok(()),
    }
}

fn unknown_word(field: &str, known: impl Iterator<Item = String>) -> Problem {
    Problem::invalid(field, format!("choose one of {}", known.collect::<Vec<_>>().join(", ")))
}
