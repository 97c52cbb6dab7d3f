//! The episodes before and after an episode, and those of its group.

use api_types::EpisodeNeighbours;
use sqlx::SqliteConnection;
use store::StoreError;
use store::episode_search::{self, EpisodeCursor, EpisodeFilter, EpisodeOrder};
use store::ids::{EpisodeId, RunId};
use store::listed_episodes::ListedEpisode;

use super::episode_list::listed_summary;

/// Largest number of episodes of a group that are listed.
const MAX_GROUP_EPISODES: i64 = 64;

/// Reads the neighbours of an episode, whose group has `group_size` episodes.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub(super) async fn episode_neighbours(
    conn: &mut SqliteConnection,
    run: &RunId,
    id: &EpisodeId,
    group_size: i64,
) -> Result<EpisodeNeighbours, StoreError> {
    let first = id.index - id.index % group_size;
    let previous = read_from(conn, run, id, EpisodeOrder::Newest, id.index, 1).await?;
    let next = read_from(conn, run, id, EpisodeOrder::Oldest, id.index, 1).await?;
    let limit = group_size.min(MAX_GROUP_EPISODES);
    let group = read_from(conn, run, id, EpisodeOrder::Oldest, first - 1, limit).await?;
    let is_in_group = |listed: &ListedEpisode| {
        listed.row.lease == id.lease.number && listed.row.number < first + group_size
    };
    let name = |listed: Vec<ListedEpisode>| Some(listed_summary(run, listed.into_iter().next()?).episode);
    Ok(EpisodeNeighbours {
        previous: name(previous),
        next: name(next),
        group: group.into_iter().filter(is_in_group).map(|listed| listed_summary(run, listed)).collect(),
    })
}

/// Reads the episodes after the one at `index` of the same lease, in an order by lease.
async fn read_from(
    conn: &mut SqliteConnection,
    run: &RunId,
    id: &EpisodeId,
    order: EpisodeOrder,
    index: i64,
    limit: i64,
) -> Result<Vec<ListedEpisode>, StoreError> {
    let cursor = EpisodeCursor { value: None, lease: id.lease.number, number: index };
    episode_search::page(conn, run.as_str(), &EpisodeFilter::default(), order, Some(cursor), limit).await
}
