//! A design as it is answered.

use std::collections::BTreeSet;

use env_core::TaskSpec;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::super::super::problem::Problem;
use crate::clock::rfc3339;
use crate::ids::{DesignRequestId, LayoutId};
use crate::store::from_json;
use crate::store::layouts::LayoutRow;

/// A design in a list.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct DesignHead {
    /// Its id.
    id: String,
    /// The run.
    run: String,
    /// The task.
    task: String,
    /// The level it was designed at; none where the strategy has no levels.
    level: Option<i64>,
    /// Its name, in its designer's words.
    name: String,
    /// The ask it came of.
    ask: String,
    /// Who thought of it: `llm` or `procedural`.
    designer: String,
    /// In which round: 1, and one more for every repair.
    round: i64,
    /// What it goes for; none where the design could not be read.
    aim: Option<AimView>,
    /// `threat` or `decoy`; none where it was refused.
    claim: Option<String>,
    /// `active`, `retired` or `refused`.
    state: String,
    /// Why it is retired (`mastered`, `hopeless` or `hand`), or which check of the gate refused it.
    why: Option<String>,
    /// The gate's sentence, where it was refused.
    reason: Option<String>,
    /// How far the nearest design was that was known before it, 0 to 1; none where it was the first.
    novelty: Option<f64>,
    /// How the agent fared.
    flown: FlownView,
    /// When it was made, RFC 3339.
    created_at: String,
    /// When it was leased last, RFC 3339.
    served_at: Option<String>,
    /// When it was retired, RFC 3339.
    retired_at: Option<String>,
}

/// What a design goes for.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct AimView {
    /// The failure mode.
    mode: String,
    /// From where, degrees in the frame; none where the mode has no direction.
    bearing_deg: Option<i64>,
    /// What bearings are measured in.
    frame: Option<String>,
}

/// How the agent fared on a layout.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct FlownView {
    /// Groups leased.
    groups: i64,
    /// Groups that came back.
    outcomes: i64,
    /// Episodes of these that finished.
    episodes: i64,
    /// Of these, successes.
    successes: i64,
    /// successes / episodes.
    success: Option<f64>,
    /// Mean score.
    score: Option<f64>,
    /// Mean of what was left on the table: (reference − score)/(reference − floor) within 0 to 1.
    regret: Option<f64>,
    /// Of the criticised episodes in which something went wrong, the share in which the aimed failure mode did.
    as_aimed: Option<f64>,
    /// The last outcomes since it began or came back, the oldest first: shares of success, at most 16.
    recent: Vec<f64>,
}

impl DesignHead {
    pub(in crate::http::v1) fn of(row: &LayoutRow) -> Result<Self, Problem> {
        let over = |sum: f64| (row.episodes > 0).then(|| sum / row.episodes as f64);
        let aim = row.mode.clone().map(|mode| AimView {
            mode,
            bearing_deg: row.bearing_deg,
            frame: row.frame.clone(),
        });
        Ok(Self {
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
            flown: FlownView {
                groups: row.groups,
                outcomes: row.outcomes,
                episodes: row.episodes,
                successes: row.successes,
                success: over(row.successes as f64),
                score: over(row.score),
                regret: over(row.regret),
                as_aimed: row.as_aimed_share(),
                recent: from_json("a layout's outcomes", &row.recent)?,
            },
            created_at: rfc3339(row.created_at),
            served_at: row.served_at.map(rfc3339),
            retired_at: row.retired_at.map(rfc3339),
        })
    }
}

/// A page of designs.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Designs {
    /// The newest first.
    designs: Vec<DesignHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

impl Designs {
    pub(in crate::http::v1) fn of(rows: &[LayoutRow], limit: i64) -> Result<Self, Problem> {
        let next = super::super::next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
        Ok(Self { designs: rows.iter().map(DesignHead::of).collect::<Result<_, _>>()?, next })
    }
}

/// The number that a page of what is numbered goes on before.
pub(in crate::http::v1) fn before(page: &super::super::Page) -> Result<i64, Problem> {
    if page.cursor.is_none() { Ok(i64::MAX) } else { Ok(page.cursor()?.0) }
}

/// A word that must be one of these.
pub(in crate::http::v1) fn one_of(field: &str, word: Option<&String>, known: &[&str]) -> Result<(), Problem> {
    match word {
        Some(word) if !known.contains(&word.as_str()) => {
            Err(Problem::invalid(field, format!("choose one of {}", known.join(", "))))
        }
        _ => Ok(()),
    }
}

/// The value among `known` that a word stands for.
pub(in crate::http::v1) fn word_of<T: Copy + std::fmt::Display>(
    field: &str,
    word: Option<&str>,
    known: &[T],
) -> Result<Option<T>, Problem> {
    let Some(word) = word else { return Ok(None) };
    let found = known.iter().copied().find(|value| value.to_string() == word);
    let unknown = || {
        let known: Vec<String> = known.iter().map(ToString::to_string).collect();
        Problem::invalid(field, format!("choose one of {}", known.join(", ")))
    };
    found.map(Some).ok_or_else(unknown)
}

/// A failure mode that one of these tasks must have.
pub(in crate::http::v1) fn known_mode(
    field: &str,
    mode: Option<&String>,
    tasks: &[&'static dyn TaskSpec],
) -> Result<(), Problem> {
    let modes: BTreeSet<&str> =
        tasks.iter().flat_map(|task| task.failure_modes()).map(|mode| mode.name).collect();
    one_of(field, mode, &modes.into_iter().collect::<Vec<_>>())
}

/// A design as its designer gave it, or as the gate read it.
pub(in crate::http::v1) fn design(row: &LayoutRow) -> Result<Option<Value>, Problem> {
    Ok(row.design.as_deref().map(|text| from_json("a design", text)).transpose()?)
}
