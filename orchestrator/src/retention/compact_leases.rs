//! Compacts old leases: the results of their episodes are kept, their actions and scenarios are deleted, except those that a level
//! move, a layout or an example of a failure rests on. The episodes that a run keeps whole thus form a ring.

use std::collections::{BTreeMap, BTreeSet};

use store::compacted_leases::{self, CompactedClaim, CompactedEpisode, CompactedGroup, CompactedLease};
use store::episodes::{self, EpisodeRow};
use store::groups::{self, GroupRow};
use store::keys::{EpisodeSpan, GroupKey};
use store::leases::{LeaseForm, LeaseRow};
use store::retention;
use store::{StoreError, columns, gc};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use crate::retention::move_evidence::MoveEvidenceSpans;

/// Maximum number of episodes in one change, so that the next change waits a few milliseconds only.
const MAX_EPISODES: i64 = 96;
/// Maximum number of leases in one change.
const MAX_LEASES: i64 = 32;

/// Kind of leases to compact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompactionGoal {
    /// The oldest leases of groups that are still whole.
    Groups,
    /// The oldest leases of columns that are still whole.
    Columns,
    /// Leases that were partly compacted because something rested on the rest, which may have changed.
    Kept {
        /// Number of the last lease that was examined.
        after: i64,
    },
}

/// Compacts some leases of a run.
#[derive(Debug)]
pub struct CompactLeases {
    /// Id of the run.
    pub run: String,
    /// Kind of leases to compact.
    pub goal: CompactionGoal,
}

/// Result of one compaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CompactionResult {
    /// Number of episodes in the leases, reported or not.
    pub episodes: i64,
    /// Number of the last lease that was examined, if any.
    pub last_lease: Option<i64>,
}

impl Change for CompactLeases {
    type Output = CompactionResult;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<CompactionResult, ServiceError> {
        let run = self.run.as_str();
        let mut rows = match self.goal {
            CompactionGoal::Groups => {
                retention::oldest_closed(&mut tx.conn, run, LeaseForm::Groups, MAX_LEASES).await?
            }
            CompactionGoal::Columns => {
                retention::oldest_closed(&mut tx.conn, run, LeaseForm::Columns, MAX_LEASES).await?
            }
            CompactionGoal::Kept { after } => {
                retention::partly_compacted(&mut tx.conn, run, after, MAX_LEASES).await?
            }
        };
        self.limit_rows(tx, &mut rows).await?;
        let last_lease = rows.last().map(|row| row.id);
        if rows.is_empty() {
            return Ok(CompactionResult { episodes: 0, last_lease });
        }
        let episodes: i64 = rows.iter().map(LeaseRow::episodes).sum();
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let evidence = MoveEvidenceSpans::load(tx, run, &ids).await?;
        let batch = CompactionBatch::load(tx, rows, &evidence).await?;
        let compacted = batch.leases.iter().map(|lease| lease.episodes().count() as u64).sum();
        batch.write(tx, run).await?;
        metrics::record_compacted(compacted);
        Ok(CompactionResult { episodes, last_lease })
    }
}

impl CompactLeases {
    /// Keeps the first leases whose episodes fit in one change, at least one.
    async fn limit_rows(&self, tx: &mut WriteTx, rows: &mut Vec<LeaseRow>) -> Result<(), StoreError> {
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let (stored, max_episodes) = match self.goal {
            // Most of these leases have few episodes left, and few of those are deleted.
            CompactionGoal::Kept { .. } => {
                (Some(retention::count_episodes(&mut tx.conn, &ids).await?), 4 * MAX_EPISODES)
            }
            CompactionGoal::Groups | CompactionGoal::Columns => (None, MAX_EPISODES),
        };
        let mut total = 0;
        rows.retain(|row| {
            let stored = stored.as_ref().map(|stored| stored.get(&row.id).copied().unwrap_or(0));
            let episodes = stored.unwrap_or_else(|| max_stored_episodes(row));
            let fits = total == 0 || total + episodes <= max_episodes;
            total += episodes;
            fits
        });
        Ok(())
    }
}

/// Returns an upper bound of the episodes of a lease that have rows.
fn max_stored_episodes(row: &LeaseRow) -> i64 {
    if row.is_columns() { row.episodes().min(MAX_EPISODES / 4) } else { row.episodes() }
}

/// A group to delete, except for episodes that are examples of failures: those are kept, and the group with them.
struct RemovableGroup {
    group: GroupRow,
    /// Numbers of the examples in the lease.
    examples: BTreeSet<i64>,
}

/// Leases that are compacted in one change.
#[derive(Default)]
struct CompactionBatch {
    leases: Vec<CompactedLease>,
    /// Groups that are deleted whole.
    groups: Vec<GroupKey>,
    /// Spans of episodes that are deleted.
    spans: Vec<EpisodeSpan>,
    /// Scenarios that only the deleted groups may refer to.
    scenarios: Vec<Vec<u8>>,
}

impl CompactionBatch {
    /// Loads the leases and decides what is deleted.
    async fn load(
        tx: &mut WriteTx,
        rows: Vec<LeaseRow>,
        evidence: &MoveEvidenceSpans,
    ) -> Result<Self, StoreError> {
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let examples = retention::examples(&mut tx.conn, &ids).await?;
        let mut reported = BTreeMap::<i64, Vec<EpisodeRow>>::new();
        for row in episodes::of_leases(&mut tx.conn, &ids).await? {
            reported.entry(row.lease).or_default().push(row);
        }
        let mut batch = Self::default();
        for row in rows {
            let size = row.group_size.max(1);
            let of_lease: BTreeSet<i64> =
                examples.iter().filter(|key| key.lease == row.id).map(|key| key.number).collect();
            let mut removable = Vec::new();
            for group in groups::of_lease(&mut tx.conn, row.id).await? {
                if !evidence.contain(&group) && !is_first_of_layout(tx, &row, &group).await? {
                    let first = group.number * size;
                    let examples = of_lease.range(first..first + size).copied().collect();
                    removable.push(RemovableGroup { group, examples });
                }
            }
            let episodes = reported.remove(&row.id).unwrap_or_default();
            batch.add_lease(tx, row, removable, episodes).await?;
        }
        Ok(batch)
    }

    /// Adds a lease with the groups that are deleted.
    async fn add_lease(
        &mut self,
        tx: &mut WriteTx,
        row: LeaseRow,
        removable: Vec<RemovableGroup>,
        episodes: Vec<EpisodeRow>,
    ) -> Result<(), StoreError> {
        let claim = match row.is_columns() {
            true => columns::claim(&mut tx.conn, row.id).await?,
            false => None,
        };
        let claim = claim.map(|claim| {
            let columns::ColumnClaimRow { state, episodes, failed, .. } = claim;
            CompactedClaim { state, episodes, failed }
        });
        let mut by_group = BTreeMap::<i64, Vec<CompactedEpisode>>::new();
        for episode in episodes {
            let group = episode.number / row.group_size.max(1);
            by_group.entry(group).or_default().push(compact_episode(&row, &episode));
        }
        let mut groups = Vec::new();
        for removable in removable {
            let episodes = by_group.remove(&removable.group.number).unwrap_or_default();
            groups.extend(self.add_group(&row, removable, episodes));
        }
        self.leases.push(CompactedLease { row, groups, claim });
        Ok(())
    }

    /// Adds a group. Returns its compacted form; `None` if examples keep all of its episodes.
    fn add_group(
        &mut self,
        row: &LeaseRow,
        RemovableGroup { group, examples }: RemovableGroup,
        mut episodes: Vec<CompactedEpisode>,
    ) -> Option<CompactedGroup> {
        let first = group.number * row.group_size;
        let mut from = first;
        for kept in examples.iter().copied().chain([first + row.group_size]) {
            if from < kept {
                self.spans.push(EpisodeSpan { lease: row.id, from, to: kept });
            }
            from = kept + 1;
        }
        if examples.is_empty() {
            self.groups.push(GroupKey { lease: row.id, number: group.number });
            if row.is_columns() || row.is_compacted {
                // The scenario of any other group also belongs to a proposal or to a layout.
                self.scenarios.push(group.scenario.clone());
            }
        }
        episodes.retain(|episode| !examples.contains(&episode.number));
        if episodes.is_empty() && !examples.is_empty() {
            return None;
        }
        Some(CompactedGroup {
            episodes,
            number: group.number,
            task: group.task,
            level: group.level,
            role: group.role,
            layout: group.layout,
            contested: group.is_contested,
        })
    }

    /// Writes the compacted leases and deletes what they replace.
    async fn write(self, tx: &mut WriteTx, run: &str) -> Result<(), StoreError> {
        let Self { leases, groups, spans, scenarios } = self;
        let now = tx.now;
        let conn = &mut tx.conn;
        let ids: Vec<i64> = leases.iter().map(|lease| lease.row.id).collect();
        // A lease that was partly compacted before is extended by the groups that it loses now.
        let (known, new): (Vec<_>, Vec<_>) = leases.into_iter().partition(|lease| lease.row.is_compacted);
        let known: Vec<_> = known.into_iter().filter(|lease| !lease.groups.is_empty()).collect();
        compacted_leases::insert(conn, run, &new, now).await?;
        compacted_leases::extend(conn, run, &known, now).await?;
        gc::delete_groups(conn, &groups, &spans).await?;
        gc::delete_leases(conn, &ids).await?;
        gc::delete_scenarios(conn, &scenarios).await
    }
}

/// Returns true if a group is the first that was rolled out on its layout.
async fn is_first_of_layout(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    group: &GroupRow,
) -> Result<bool, StoreError> {
    let Some(layout) = group.layout else { return Ok(false) };
    let key = GroupKey { lease: lease.id, number: group.number };
    Ok(retention::first_group_of_layout(&mut tx.conn, layout).await? == Some(key))
}

fn compact_episode(lease: &LeaseRow, row: &EpisodeRow) -> CompactedEpisode {
    CompactedEpisode {
        number: row.number,
        state: row.state,
        score: row.score,
        skill: row.skill,
        success: row.success,
        policy_version: row.policy_version,
        after_ms: row.at - lease.created_at,
    }
}
