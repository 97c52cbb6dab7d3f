//! Reported episodes of a run: those that are kept whole, and those of which only is kept how they came out.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::{Page, next, reader_of, run_id};
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, LayoutId, LeaseId};
use crate::http::state::AppState;
use crate::store::episodes::{self, EpisodeRow, ListedEpisode, EpisodeGroup};
use crate::store::keys::EpisodeKey;
use crate::store::compacted_leases::{self, CompactedEpisode, CompactedGroup, CompactedLease};

/// Whether the actions of an episode are there to be replayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Replayable {
    /// They are.
    Available,
    /// They were, and the run keeps them no longer.
    Expired,
    /// Nobody reported any.
    None,
}

/// One episode in a list.
#[derive(Serialize, ToSchema)]
pub(super) struct EpisodeHead {
    /// Its id.
    episode: String,
    /// The task.
    task: Option<String>,
    /// The level its scenario was drawn at.
    level: Option<i64>,
    /// What its group was for: the curriculum's role of it (`frontier`, `replay`, `probe`, …), `designed` or `suite`.
    role: String,
    /// The layout's id, where its group was designed.
    layout: Option<String>,
    /// `leased`, `finished`, `failed`, `late` or `expired`.
    state: String,
    /// The score, by replay.
    score: Option<f64>,
    /// Whether it is a success, by the run's rule.
    success: Option<bool>,
    /// The skill, where the scenario defines one.
    skill: Option<f64>,
    /// The policy that flew it.
    policy_version: Option<i64>,
    /// When it was reported, RFC 3339.
    at: Option<String>,
    /// `available`, `expired` (past what the run keeps whole) or `none` (it has no actions).
    replay: Replayable,
}

impl EpisodeHead {
    /// One that is kept whole; `unreported` is its state where it was not reported.
    pub(super) fn of(id: &EpisodeId, group: EpisodeGroup, row: Option<&EpisodeRow>, unreported: &str) -> Self {
        let flown = row.is_some_and(|row| row.flown.is_some());
        Self {
            episode: id.to_string(),
            task: Some(group.task),
            level: group.level,
            role: group.role.to_string(),
            layout: group.layout.map(|id| LayoutId(id).to_string()),
            state: row.map_or(unreported, |r| r.state.as_str()).to_owned(),
            score: row.and_then(|r| r.score),
            success: row.and_then(|r| r.success),
            skill: row.and_then(|r| r.skill),
            policy_version: row.map(|r| r.policy_version),
            at: row.map(|r| rfc3339(r.at)),
            replay: if flown { Replayable::Available } else { Replayable::None },
        }
    }

    /// One of a group that was folded; `known` where it was reported.
    pub(super) fn folded(
        lease: &CompactedLease,
        index: i64,
        (group, known): (&CompactedGroup, Option<&CompactedEpisode>),
    ) -> Self {
        let flown = known.is_some_and(|known| known.score.is_some());
        Self {
            episode: EpisodeId { lease: lease.row.lease_id(), index }.to_string(),
            task: Some(group.task.clone()),
            level: group.level,
            role: group.role.to_string(),
            layout: group.layout.map(|id| LayoutId(id).to_string()),
            state: known.map_or("expired", |known| known.state.as_str()).to_owned(),
            score: known.and_then(|known| known.score),
            success: known.and_then(|known| known.success),
            skill: known.and_then(|known| known.skill),
            policy_version: known.map(|known| known.policy_version),
            at: known.map(|known| rfc3339(lease.row.created_at + known.after_ms)),
            replay: if flown { Replayable::Expired } else { Replayable::None },
        }
    }
}

/// A page of reported episodes.
#[derive(Serialize, ToSchema)]
pub(super) struct Episodes {
    /// In order of lease and index.
    episodes: Vec<EpisodeHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// List reported episodes.
#[utoipa::path(
    get, path = "/runs/{run}/episodes", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = Episodes), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Episodes>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let (lease, index) = page.cursor()?;
    let number = if page.cursor.is_none() {
        -1
    } else {
        index.parse().map_err(|_| Problem::invalid("cursor", "it is not one that a list gave"))?
    };
    let after = EpisodeKey { lease, number };
    let mut conn = reader_of(&app, &run).await?;
    let whole = episodes::page(&mut conn, run.as_str(), after, limit).await?;
    let mut heads: Vec<(EpisodeKey, EpisodeHead)> = whole.into_iter().map(head).collect();
    let reported = |folded: &CompactedLease| {
        let key = |known: &CompactedEpisode| EpisodeKey { lease: folded.row.id, number: known.number };
        folded.episodes().filter(|(_, known)| key(known) > after).count() as i64
    };
    for folded in compacted_leases::from(&mut conn, run.as_str(), lease, limit, reported).await? {
        for (group, known) in folded.episodes() {
            let place = EpisodeKey { lease: folded.row.id, number: known.number };
            if place > after {
                heads.push((place, EpisodeHead::folded(&folded, known.number, (group, Some(known)))));
            }
        }
    }
    heads.sort_by_key(|(place, _)| *place);
    heads.dedup_by_key(|(place, _)| *place); // one that was folded meanwhile: whole it came first
    heads.truncate(usize::try_from(limit).unwrap_or_default());
    let last = heads.last().map(|(key, _)| (key.lease, key.number.to_string()));
    let next = next(heads.len(), limit, last.as_ref().map(|(lease, index)| (*lease, index.as_str())));
    Ok(axum::Json(Episodes { episodes: heads.into_iter().map(|(_, head)| head).collect(), next }))
}

pub(super) fn head(ListedEpisode { token, group, row }: ListedEpisode) -> (EpisodeKey, EpisodeHead) {
    let lease = LeaseId { number: row.lease, token };
    let id = EpisodeId { lease, index: row.number };
    (row.key(), EpisodeHead::of(&id, group, Some(&row), "finished"))
}
