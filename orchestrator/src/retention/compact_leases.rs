//! Retention: what a run keeps whole is a ring. Older leases are folded: what their episodes came to stays, their actions and
//! scenarios go, but for those that a level move, a layout or a failure's example rests on.

use std::collections::{BTreeMap, BTreeSet};

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::metrics;
use crate::store::episodes::{self, EpisodeRow};
use crate::store::compacted_leases::{self, CompactedClaim, CompactedEpisode, CompactedGroup, CompactedLease};
use crate::store::groups::{self, ClosedGroupRow, GroupRole, GroupRow, GroupState};
use crate::store::keys::{EpisodeSpan, GroupKey};
use crate::store::leases::{LeaseForm, LeaseRow};
use crate::store::progress::{self, ProgressSpan};
use crate::store::retention::{self, ProposalSpan};
use crate::store::{StoreError, columns, curriculum, from_json, to_i64, gc, to_u64};
use ::curriculum::MoveEvidence;

/// Episodes folded in one change: what waits behind it waits a few milliseconds.
const EPISODES: i64 = 96;
/// Leases looked at in one change.
const LEASES: i64 = 32;
/// Proposals and events deleted in one change.
const SWEPT: i64 = 500;
/// Which leases are folded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompactionGoal {
    /// The oldest that are kept whole, and have groups.
    Groups,
    /// The oldest that are kept whole, and are columns.
    Columns,
    /// Those after this number that were folded but for what something rested on: it may rest on it no more.
    Kept {
        /// The number.
        after: i64,
    },
}

/// Folds some leases of a run.
#[derive(Debug)]
pub struct CompactLeases {
    /// The run.
    pub run: String,
    /// Which.
    pub which: CompactionGoal,
}

/// What was folded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Folded {
    /// Episodes that leases had, reported or not.
    pub episodes: i64,
    /// The last lease that was looked at, if any was.
    pub last: Option<i64>,
}

impl Change for CompactLeases {
    type Output = Folded;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<Folded, ServiceError> {
        let run = self.run.as_str();
        let mut rows = match self.which {
            CompactionGoal::Groups => retention::oldest_closed(&mut tx.conn, run, LeaseForm::Groups, LEASES).await?,
            CompactionGoal::Columns => retention::oldest_closed(&mut tx.conn, run, LeaseForm::Columns, LEASES).await?,
            CompactionGoal::Kept { after } => retention::partly_compacted(&mut tx.conn, run, after, LEASES).await?,
        };
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let (left, most) = match self.which {
            // Little is left of most of them, and little of that goes.
            CompactionGoal::Kept { .. } => (Some(retention::count_episodes(&mut tx.conn, &ids).await?), 4 * EPISODES),
            CompactionGoal::Groups | CompactionGoal::Columns => (None, EPISODES),
        };
        let mut together = 0;
        rows.retain(|row| {
            let left = left.as_ref().map(|left| left.get(&row.id).copied().unwrap_or(0));
            let weight = left.unwrap_or_else(|| weight(row));
            let fits = together == 0 || together + weight <= most;
            together += weight;
            fits
        });
        let last = rows.last().map(|row| row.id);
        if rows.is_empty() {
            return Ok(Folded { episodes: 0, last });
        }
        let episodes: i64 = rows.iter().map(LeaseRow::episodes).sum();
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let rests = Rests::of(tx, run, &ids).await?;
        let batch = Batch::read(tx, rows, &rests).await?;
        let gone = batch.leases.iter().map(|lease| lease.episodes().count() as u64).sum();
        batch.write(tx, run).await?;
        metrics::record_compacted(gone);
        Ok(Folded { episodes, last })
    }
}

/// Episodes that have rows, at most.
fn weight(row: &LeaseRow) -> i64 {
    if row.is_columns() { row.episodes().min(EPISODES / 4) } else { row.episodes() }
}

/// What level moves rest on, those that are yet to come among them: of each task those up to the first after the last proposal that
/// is asked about, since an outcome is evidence for the next move of its task or for none.
struct Rests {
    /// By task: from this seq of a proposal on, and before that one.
    spans: BTreeMap<String, Vec<(u64, u64)>>,
}

impl Rests {
    async fn of(tx: &mut WriteTx, run: &str, leases: &[i64]) -> Result<Self, ServiceError> {
        let mut spans = BTreeMap::<String, Vec<(u64, u64)>>::new();
        for ProposalSpan { task, first, last } in retention::proposal_spans(&mut tx.conn, leases).await? {
            let mut before = 0;
            for moved in curriculum::moves_around(&mut tx.conn, run, &task, first, last).await? {
                let evidence: MoveEvidence = from_json("a move's evidence", &moved.evidence)?;
                let (begin, end) = (evidence.earliest_proposal().unwrap_or(before), to_u64(moved.seq));
                spans.entry(task.clone()).or_default().push((begin, end));
                before = end;
            }
        }
        let mind = tx.run(run).await?.state;
        for status in mind.curriculum.status() {
            if let Some(begin) = status.earliest_proposal {
                spans.entry(status.task).or_default().push((begin, u64::MAX));
            }
        }
        Ok(Self { spans })
    }

    /// Whether a move may rest on this group.
    fn on(&self, group: &GroupRow) -> bool {
        let Some(seq) = group.proposal.map(to_u64) else { return false };
        group.is_evidence
            && group.is_contested
            && matches!(group.role, GroupRole::Placement | GroupRole::Frontier)
            && self
                .spans
                .get(&group.task)
                .is_some_and(|spans| spans.iter().any(|(begin, end)| (*begin..*end).contains(&seq)))
    }
}

/// A group that goes, but for episodes that are shown as examples: those stay, and it with them.
struct Going {
    group: GroupRow,
    /// Their indices in the lease.
    shown: BTreeSet<i64>,
}

/// Leases that are folded together.
#[derive(Default)]
struct Batch {
    leases: Vec<CompactedLease>,
    /// Groups that go as wholes, by lease and number.
    groups: Vec<GroupKey>,
    /// Episodes that go, as spans.
    spans: Vec<EpisodeSpan>,
    /// Scenarios that nobody but those groups may refer to.
    scenarios: Vec<Vec<u8>>,
    /// Evidence of leases that are folded for the first time, by task.
    progress: BTreeMap<String, ProgressSpan>,
}

impl Batch {
    async fn read(tx: &mut WriteTx, rows: Vec<LeaseRow>, rests: &Rests) -> Result<Self, StoreError> {
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let examples = retention::examples(&mut tx.conn, &ids).await?;
        let mut reported = BTreeMap::<i64, Vec<EpisodeRow>>::new();
        for row in episodes::of_leases(&mut tx.conn, &ids).await? {
            reported.entry(row.lease).or_default().push(row);
        }
        let mut batch = Self::default();
        for row in rows {
            let size = row.group_size.max(1);
            let shown: BTreeSet<i64> =
                examples.iter().filter(|key| key.lease == row.id).map(|key| key.number).collect();
            let mut going = Vec::new();
            for ClosedGroupRow { row: group, closed_at } in groups::of_closed_lease(&mut tx.conn, row.id).await? {
                if !row.is_compacted {
                    batch.note(&group, closed_at);
                }
                if !rests.on(&group) && !first(tx, &row, &group).await? {
                    let first = group.number * size;
                    let shown = shown.range(first..first + size).copied().collect();
                    going.push(Going { group, shown });
                }
            }
            let episodes = reported.remove(&row.id).unwrap_or_default();
            batch.add(tx, row, going, episodes).await?;
        }
        Ok(batch)
    }

    /// Counts a group's part in success over time.
    fn note(&mut self, group: &GroupRow, closed_at: i64) {
        let counts = group.is_contested && group.is_evidence && group.finished > 0 && group.counts();
        if !counts || !matches!(group.state, GroupState::Complete | GroupState::Partial) {
            return;
        }
        let sum = group.successes as f64 / group.finished as f64;
        let of_group = ProgressSpan { at: closed_at, low: group.level, high: group.level, n: 1, sum };
        self.progress
            .entry(group.task.clone())
            .and_modify(|stretch| stretch.join(&of_group))
            .or_insert(of_group);
    }

    async fn add(
        &mut self,
        tx: &mut WriteTx,
        row: LeaseRow,
        going: Vec<Going>,
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
        let mut of_group = BTreeMap::<i64, Vec<CompactedEpisode>>::new();
        for episode in episodes {
            let group = episode.number / row.group_size.max(1);
            of_group.entry(group).or_default().push(folded_episode(&row, &episode));
        }
        let mut groups = Vec::new();
        for Going { group, shown } in going {
            let first = group.number * row.group_size;
            let mut from = first;
            for stays in shown.iter().copied().chain([first + row.group_size]) {
                if from < stays {
                    self.spans.push(EpisodeSpan { lease: row.id, from, to: stays });
                }
                from = stays + 1;
            }
            if shown.is_empty() {
                self.groups.push(GroupKey { lease: row.id, number: group.number });
                if row.is_columns() || row.is_compacted {
                    // Of others a proposal is there, too, that has the scenario, or a layout.
                    self.scenarios.push(group.scenario.clone());
                }
            }
            let mut episodes = of_group.remove(&group.number).unwrap_or_default();
            episodes.retain(|episode| !shown.contains(&episode.number));
            if episodes.is_empty() && !shown.is_empty() {
                continue; // nothing of it goes
            }
            groups.push(CompactedGroup {
                episodes,
                number: group.number,
                task: group.task,
                level: group.level,
                role: group.role,
                layout: group.layout,
                contested: group.is_contested,
            });
        }
        self.leases.push(CompactedLease { row, groups, claim });
        Ok(())
    }

    async fn write(self, tx: &mut WriteTx, run: &str) -> Result<(), StoreError> {
        let Self { leases, groups, spans, scenarios, progress } = self;
        let now = tx.now;
        let conn = &mut tx.conn;
        let ids: Vec<i64> = leases.iter().map(|lease| lease.row.id).collect();
        // One that was folded before is there already, but for the groups that it loses now.
        let (known, new): (Vec<_>, Vec<_>) = leases.into_iter().partition(|lease| lease.row.is_compacted);
        let known: Vec<_> = known.into_iter().filter(|lease| !lease.groups.is_empty()).collect();
        compacted_leases::insert(conn, run, &new, now).await?;
        compacted_leases::extend(conn, run, &known, now).await?;
        for (task, stretch) in &progress {
            progress::add_compacted(conn, run, task, stretch).await?;
        }
        gc::delete_groups(conn, &groups, &spans).await?;
        gc::delete_leases(conn, &ids).await?;
        gc::delete_scenarios(conn, &scenarios).await
    }
}

/// Whether a group is the first that was flown on its layout.
async fn first(tx: &mut WriteTx, lease: &LeaseRow, group: &GroupRow) -> Result<bool, StoreError> {
    let Some(layout) = group.layout else { return Ok(false) };
    let key = GroupKey { lease: lease.id, number: group.number };
    Ok(retention::first_group_of_layout(&mut tx.conn, layout).await? == Some(key))
}

fn folded_episode(lease: &LeaseRow, row: &EpisodeRow) -> CompactedEpisode {
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

/// Deletes proposals that nothing that is kept whole comes from, with the scenarios they alone refer to, and events of the
/// curriculum that are behind its snapshots.
#[derive(Debug)]
pub struct CollectGarbage {
    /// The run.
    pub run: String,
    /// The seq before which nothing is wanted any more.
    pub before: i64,
}

impl Change for CollectGarbage {
    /// Whether there may be more.
    type Output = bool;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<bool, ServiceError> {
        let RunTx { state: mind, conn, .. } = tx.run(&self.run).await?;
        // What the curriculum may want again stays.
        let held: Vec<i64> = mind.curriculum.retained_proposals().into_iter().map(to_i64).collect();
        let gone = gc::delete_proposals(conn, &self.run, self.before, &held, SWEPT).await?;
        let more = gone.len() as i64 == SWEPT;
        let scenarios: Vec<Vec<u8>> = gone.into_iter().flatten().collect();
        gc::delete_scenarios(conn, &scenarios).await?;
        let events = gc::delete_events(conn, &self.run, self.before, SWEPT).await?;
        Ok(more || events as i64 == SWEPT)
    }
}
