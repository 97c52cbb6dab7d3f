//! Joins the lists of runs of several shards.

use std::collections::BTreeMap;

use api_types::{MissingShard, RunGroup, RunGroupList, RunPage, RunSummary};
use jiff::Timestamp;
use store::run_list::{RunOrder, RunPosition, RunSortKey, RunSortValue};

use super::run_cursor::format_cursor;
use crate::shards::{PeerError, PeerParts, ShardPart};

/// Largest number of groups.
const MAX_GROUPS: usize = 1000;

/// Run with its position in the order of the list.
struct PlacedRun {
    position: RunPosition,
    run: RunSummary,
}

/// Merges pages that begin after the same position, and have at most `limit` runs each. A cursor is a position in the order of all
/// runs, so that it needs no part for each shard.
pub(super) fn merge_runs(order: RunOrder, limit: i64, own: RunPage, peers: PeerParts<RunPage>) -> RunPage {
    let PeerParts { parts, mut missing } = peers;
    if parts.is_empty() && missing.is_empty() {
        return own;
    }
    let (mut total, mut is_longer) = (own.total, own.next.is_some());
    let mut placed = place(order, own.runs).unwrap_or_default();
    for ShardPart { shard, part: page } in parts {
        let Some(runs) = place(order, page.runs) else {
            missing.push(MissingShard { shard: shard.to_string(), reason: PeerError::Malformed.to_string() });
            continue;
        };
        placed.extend(runs);
        is_longer |= page.next.is_some();
        total = total.map(|total| total + page.total.unwrap_or(0));
    }
    placed.sort_by(|a, b| order.compare(&a.position, &b.position));
    let limit = usize::try_from(limit).unwrap_or_default();
    is_longer |= placed.len() > limit;
    placed.truncate(limit);
    let last = placed.last().filter(|_| is_longer);
    let next = last.map(|last| format_cursor(order, &last.position));
    let runs = placed.into_iter().map(|placed| placed.run).collect();
    RunPage { runs, total, next, missing_shards: missing }
}

/// Returns runs with their positions; `None` if a run has a time that is no time.
fn place(order: RunOrder, runs: Vec<RunSummary>) -> Option<Vec<PlacedRun>> {
    runs.into_iter().map(|run| Some(PlacedRun { position: position_of(order, &run)?, run })).collect()
}

fn position_of(order: RunOrder, run: &RunSummary) -> Option<RunPosition> {
    let time = |text: &str| {
        let at = text.parse::<Timestamp>().ok()?;
        Some(RunSortValue::Integer(at.as_millisecond()))
    };
    let value = match order.key {
        RunSortKey::Created => time(&run.created_at)?,
        RunSortKey::Name => RunSortValue::Text(run.name.clone()),
        RunSortKey::Episodes => RunSortValue::Integer(run.episodes),
        RunSortKey::LastResults => match &run.last_results_at {
            Some(at) => time(at)?,
            None => RunSortValue::Missing,
        },
        RunSortKey::Skill => run.skill.map_or(RunSortValue::Missing, RunSortValue::Real),
    };
    Some(RunPosition { value, id: run.id.clone() })
}

/// Merges groups with equal values.
pub(super) fn merge_groups(own: RunGroupList, peers: PeerParts<RunGroupList>) -> RunGroupList {
    let PeerParts { parts, missing } = peers;
    let mut groups: BTreeMap<String, RunGroup> = BTreeMap::new();
    for group in own.groups.into_iter().chain(parts.into_iter().flat_map(|part| part.part.groups)) {
        match groups.get_mut(&group.value) {
            None => {
                groups.insert(group.value.clone(), group);
            }
            Some(known) => {
                known.runs += group.runs;
                known.episodes += group.episodes;
                // Times have one format, in which the later one is the greater text.
                known.last_results_at = known.last_results_at.take().max(group.last_results_at);
            }
        }
    }
    RunGroupList { groups: groups.into_values().take(MAX_GROUPS).collect(), missing_shards: missing }
}
