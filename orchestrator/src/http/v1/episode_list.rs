//! List of a run's reported episodes: complete ones, and compacted ones of which only the outcome is kept.

use crate::api_enums::ConvertEnum;
use api_types::{EpisodePage, EpisodeState, EpisodeSummary, PageQuery, ReplayAvailability};
use axum::extract::State;
use store::compacted_leases::{self, CompactedEpisode, CompactedGroup, CompactedLease};
use store::episodes::EpisodeRow;
use store::ids::{EpisodeId, LayoutId, LeaseId, RunId};
use store::keys::EpisodeKey;
use store::listed_episodes::{self, EpisodeGroup, ListedEpisode};

use crate::http::extract::{Path, Query};
use crate::http::paging::{PageCursor, next_cursor, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use clock::rfc3339;

/// Converts an episode that is kept complete; `unreported` is its state if it was not reported.
pub(super) fn episode_summary(
    run: &RunId,
    id: &EpisodeId,
    group: EpisodeGroup,
    row: Option<&EpisodeRow>,
    unreported: EpisodeState,
) -> EpisodeSummary {
    let has_actions = row.is_some_and(|row| row.outcome.is_some());
    EpisodeSummary {
        episode: id.to_string(),
        task: Some(group.task),
        level: group.level,
        role: group.role.convert(),
        layout: group.layout.map(|id| LayoutId::of_run(run.as_str(), id).to_string()),
        state: row.map_or(unreported, |row| row.state.convert()),
        score: row.and_then(|r| r.score),
        success: row.and_then(|r| r.success),
        skill: row.and_then(|r| r.skill),
        policy_version: row.map(|r| r.policy_version),
        reported_at: row.map(|r| rfc3339(r.at)),
        replay: if has_actions { ReplayAvailability::Available } else { ReplayAvailability::None },
    }
}

/// Converts the episode at `index` of a compacted lease; `episode` is its outcome if it was reported.
pub(super) fn compacted_summary(
    lease: &CompactedLease,
    index: i64,
    group: &CompactedGroup,
    episode: Option<&CompactedEpisode>,
) -> EpisodeSummary {
    let had_actions = episode.is_some_and(|episode| episode.score.is_some());
    EpisodeSummary {
        episode: EpisodeId { lease: lease.row.lease_id(), index }.to_string(),
        task: Some(group.task.clone()),
        level: group.level,
        role: group.role.convert(),
        layout: group.layout.map(|id| LayoutId::of_run(&lease.row.run, id).to_string()),
        state: episode.map_or(EpisodeState::Expired, |episode| episode.state.convert()),
        score: episode.and_then(|episode| episode.score),
        success: episode.and_then(|episode| episode.success),
        skill: episode.and_then(|episode| episode.skill),
        policy_version: episode.map(|episode| episode.policy_version),
        reported_at: episode.map(|episode| rfc3339(lease.row.created_at + episode.after_ms)),
        replay: if had_actions { ReplayAvailability::Expired } else { ReplayAvailability::None },
    }
}

/// Converts a reported episode of a list.
pub(super) fn listed_summary(run: &RunId, episode: ListedEpisode) -> EpisodeSummary {
    let ListedEpisode { id_suffix: suffix, group, row } = episode;
    let id = EpisodeId { lease: LeaseId { number: row.lease, suffix }, index: row.number };
    episode_summary(run, &id, group, Some(&row), EpisodeState::Finished)
}

/// List the reported episodes of a run, by lease and index.
#[utoipa::path(
    get, path = "/runs/{run}/episodes", tag = "episodes",
    params(("run" = String, Path, description = "The run's id."), PageQuery),
    responses(
        (status = 200, body = EpisodePage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list_episodes(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<EpisodePage>, Problem> {
    let (run, limit) = (parse_run_id(&run)?, page_limit(page.limit)?);
    let after = episode_after(page.cursor.as_deref())?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let complete = listed_episodes::page(&mut conn, run.as_str(), after, limit).await?;
    let mut listed: Vec<(EpisodeKey, EpisodeSummary)> =
        complete.into_iter().map(|episode| (episode.row.key(), listed_summary(&run, episode))).collect();
    let key = |lease: &CompactedLease, episode: &CompactedEpisode| EpisodeKey {
        lease: lease.row.id,
        number: episode.number,
    };
    let reported = |lease: &CompactedLease| {
        lease.episodes().filter(|(_, episode)| key(lease, episode) > after).count() as i64
    };
    for lease in compacted_leases::from(&mut conn, run.as_str(), after.lease, limit, reported).await? {
        for (group, episode) in lease.episodes().filter(|(_, episode)| key(&lease, episode) > after) {
            let summary = compacted_summary(&lease, episode.number, group, Some(episode));
            listed.push((key(&lease, episode), summary));
        }
    }
    listed.sort_by_key(|(key, _)| *key);
    listed.dedup_by_key(|(key, _)| *key); // an episode that was compacted meanwhile is listed complete
    listed.truncate(usize::try_from(limit).unwrap_or_default());
    let last = listed.last().map(|(key, _)| *key);
    let number = last.map(|key| key.number.to_string()).unwrap_or_default();
    let last = last.map(|key| PageCursor { number: key.lease, text: &number });
    let next = next_cursor(listed.len(), limit, last);
    Ok(axum::Json(EpisodePage { episodes: listed.into_iter().map(|(_, summary)| summary).collect(), next }))
}

/// Key of the episode after which a page starts.
fn episode_after(cursor: Option<&str>) -> Result<EpisodeKey, Problem> {
    let Some(PageCursor { number: lease, text }) = PageCursor::parse(cursor)? else {
        return Ok(EpisodeKey { lease: 0, number: -1 });
    };
    let number =
        text.parse().map_err(|_| Problem::invalid("cursor", "must be the `next` of a previous page"))?;
    Ok(EpisodeKey { lease, number })
}
