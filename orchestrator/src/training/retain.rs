//! Retention: what a run keeps whole is a ring. Older leases are folded: what their episodes came to stays, their actions and
//! scenarios go, but for those that a level move, a layout or a failure's example rests on.

use std::collections::{BTreeMap, BTreeSet};

use super::{Change, TrainingError, Work};
use crate::counts;
use crate::store::episodes::{self, EpisodeRow};
use crate::store::folds::{self, FoldedClaim, FoldedEpisode, FoldedGroup, FoldedLease, FoldedState};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{COLUMNS, GROUPS, LeaseRow};
use crate::store::progress::{self, Stretch};
use crate::store::retention::{self, Proposed};
use crate::store::{StoreError, columns, curriculum, from_json, signed, sweep, unsigned};
use ::curriculum::Evidence;

/// Episodes folded in one change: what waits behind it waits a few milliseconds.
const EPISODES: i64 = 96;
/// Leases looked at in one change.
const LEASES: i64 = 32;
/// Proposals and events deleted in one change.
const SWEPT: i64 = 500;
/// Which leases are folded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fold {
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
pub struct FoldLeases {
    /// The run.
    pub run: String,
    /// Which.
    pub which: Fold,
}

/// What was folded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Folded {
    /// Episodes that leases had, reported or not.
    pub episodes: i64,
    /// The last lease that was looked at, if any was.
    pub last: Option<i64>,
}

impl Change for FoldLeases {
    type Answer = Folded;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<Folded, TrainingError> {
        let run = self.run.as_str();
        let mut rows = match self.which {
            Fold::Groups => retention::oldest(&mut work.conn, run, GROUPS, LEASES).await?,
            Fold::Columns => retention::oldest(&mut work.conn, run, COLUMNS, LEASES).await?,
            Fold::Kept { after } => retention::kept(&mut work.conn, run, after, LEASES).await?,
        };
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let (left, most) = match self.which {
            // Little is left of most of them, and little of that goes.
            Fold::Kept { .. } => (Some(retention::left(&mut work.conn, &ids).await?), 4 * EPISODES),
            Fold::Groups | Fold::Columns => (None, EPISODES),
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
        let rests = Rests::of(work, run, &ids).await?;
        let batch = Batch::read(work, rows, &rests).await?;
        let gone = batch.leases.iter().map(|lease| lease.episodes().count() as u64).sum();
        batch.write(work, run).await?;
        counts::folded(gone);
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
    async fn of(work: &mut Work, run: &str, leases: &[i64]) -> Result<Self, TrainingError> {
        let mut spans = BTreeMap::<String, Vec<(u64, u64)>>::new();
        for Proposed { task, first, last } in retention::proposed(&mut work.conn, leases).await? {
            let mut before = 0;
            for moved in curriculum::moves_about(&mut work.conn, run, &task, (first, last)).await? {
                let evidence: Evidence = from_json("a move's evidence", &moved.evidence)?;
                let (begin, end) = (evidence.first().unwrap_or(before), unsigned(moved.seq));
                spans.entry(task.clone()).or_default().push((begin, end));
                before = end;
            }
        }
        let (mind, _) = work.mind(run).await?;
        for status in mind.curriculum.status() {
            if let Some(begin) = status.rests_on {
                spans.entry(status.task).or_default().push((begin, u64::MAX));
            }
        }
        Ok(Self { spans })
    }

    /// Whether a move may rest on this group.
    fn on(&self, group: &GroupRow) -> bool {
        let Some(seq) = group.proposal.map(unsigned) else { return false };
        group.evidence != 0
            && group.contested != 0
            && matches!(group.role.as_str(), "placement" | "frontier")
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
    leases: Vec<FoldedLease>,
    /// Groups that go as wholes, by lease and number.
    groups: Vec<(i64, i64)>,
    /// Episodes that go, as spans.
    spans: Vec<(i64, i64, i64)>,
    /// Scenarios that nobody but those groups may refer to.
    scenarios: Vec<Vec<u8>>,
    /// Evidence of leases that are folded for the first time, by task.
    progress: BTreeMap<String, Stretch>,
}

impl Batch {
    async fn read(work: &mut Work, rows: Vec<LeaseRow>, rests: &Rests) -> Result<Self, StoreError> {
        let ids: Vec<i64> = rows.iter().map(|row| row.id).collect();
        let examples = retention::examples(&mut work.conn, &ids).await?;
        let mut reported = BTreeMap::<i64, Vec<EpisodeRow>>::new();
        for row in episodes::of_leases(&mut work.conn, &ids).await? {
            reported.entry(row.lease).or_default().push(row);
        }
        let mut batch = Self::default();
        for row in rows {
            let size = row.group_size.max(1);
            let shown: BTreeSet<i64> =
                examples.iter().filter(|(lease, _)| *lease == row.id).map(|(_, number)| *number).collect();
            let mut going = Vec::new();
            for (group, closed_at) in groups::closed(&mut work.conn, row.id).await? {
                if row.folded == 0 {
                    batch.note(&group, closed_at);
                }
                if !rests.on(&group) && !first(work, &row, &group).await? {
                    let first = group.number * size;
                    let shown = shown.range(first..first + size).copied().collect();
                    going.push(Going { group, shown });
                }
            }
            let episodes = reported.remove(&row.id).unwrap_or_default();
            batch.add(work, row, going, episodes).await?;
        }
        Ok(batch)
    }

    /// Counts a group's part in success over time.
    fn note(&mut self, group: &GroupRow, closed_at: i64) {
        let counts = group.contested != 0 && group.evidence != 0 && group.finished > 0 && group.counts();
        if !counts || !matches!(group.state.as_str(), "complete" | "partial") {
            return;
        }
        let sum = group.successes as f64 / group.finished as f64;
        let of_group = Stretch { at: closed_at, low: group.level, high: group.level, n: 1, sum };
        self.progress
            .entry(group.task.clone())
            .and_modify(|stretch| stretch.join(&of_group))
            .or_insert(of_group);
    }

    async fn add(
        &mut self,
        work: &mut Work,
        row: LeaseRow,
        going: Vec<Going>,
        episodes: Vec<EpisodeRow>,
    ) -> Result<(), StoreError> {
        let claim = match row.is_columns() {
            true => columns::claim(&mut work.conn, row.id).await?,
            false => None,
        };
        let claim = claim.map(|claim| {
            let columns::ClaimRow { state, episodes, failed, .. } = claim;
            FoldedClaim { state, episodes, failed }
        });
        let mut of_group = BTreeMap::<i64, Vec<FoldedEpisode>>::new();
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
                    self.spans.push((row.id, from, stays));
                }
                from = stays + 1;
            }
            if shown.is_empty() {
                self.groups.push((row.id, group.number));
                if row.is_columns() || row.folded != 0 {
                    // Of others a proposal is there, too, that has the scenario, or a layout.
                    self.scenarios.push(group.scenario.clone());
                }
            }
            let mut episodes = of_group.remove(&group.number).unwrap_or_default();
            episodes.retain(|episode| !shown.contains(&episode.number));
            if episodes.is_empty() && !shown.is_empty() {
                continue; // nothing of it goes
            }
            groups.push(FoldedGroup {
                episodes,
                number: group.number,
                task: group.task,
                level: group.level,
                role: group.role,
                layout: group.layout,
                contested: group.contested != 0,
            });
        }
        self.leases.push(FoldedLease { row, groups, claim });
        Ok(())
    }

    async fn write(self, work: &mut Work, run: &str) -> Result<(), StoreError> {
        let Self { leases, groups, spans, scenarios, progress } = self;
        let now = work.now;
        let conn = &mut work.conn;
        let ids: Vec<i64> = leases.iter().map(|lease| lease.row.id).collect();
        // One that was folded before is there already, but for the groups that it loses now.
        let (known, new): (Vec<_>, Vec<_>) = leases.into_iter().partition(|lease| lease.row.folded != 0);
        let known: Vec<_> = known.into_iter().filter(|lease| !lease.groups.is_empty()).collect();
        folds::insert(conn, run, &new, now).await?;
        folds::extend(conn, run, &known, now).await?;
        for (task, stretch) in &progress {
            progress::add_folded(conn, run, task, stretch).await?;
        }
        sweep::delete_groups(conn, &groups, &spans).await?;
        sweep::delete_leases(conn, &ids).await?;
        sweep::delete_scenarios(conn, &scenarios).await
    }
}

/// Whether a group is the first that was flown on its layout.
async fn first(work: &mut Work, lease: &LeaseRow, group: &GroupRow) -> Result<bool, StoreError> {
    let Some(layout) = group.layout else { return Ok(false) };
    Ok(retention::first_of_layout(&mut work.conn, layout).await? == Some((lease.id, group.number)))
}

fn folded_episode(lease: &LeaseRow, row: &EpisodeRow) -> FoldedEpisode {
    FoldedEpisode {
        number: row.number,
        state: FoldedState::of(&row.state),
        score: row.score,
        skill: row.skill,
        success: row.success.map(|success| success != 0),
        policy_version: row.policy_version,
        after_ms: row.at - lease.created_at,
    }
}

/// Deletes proposals that nothing that is kept whole comes from, with the scenarios they alone refer to, and events of the
/// curriculum that are behind its snapshots.
#[derive(Debug)]
pub struct Sweep {
    /// The run.
    pub run: String,
    /// The seq before which nothing is wanted any more.
    pub before: i64,
}

impl Change for Sweep {
    /// Whether there may be more.
    type Answer = bool;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<bool, TrainingError> {
        let (mind, conn) = work.mind(&self.run).await?;
        // What the curriculum may want again stays.
        let held: Vec<i64> = mind.curriculum.held().into_iter().map(signed).collect();
        let gone = sweep::delete_proposals(conn, &self.run, self.before, (&held, SWEPT)).await?;
        let more = gone.len() as i64 == SWEPT;
        let scenarios: Vec<Vec<u8>> = gone.into_iter().flatten().collect();
        sweep::delete_scenarios(conn, &scenarios).await?;
        let events = sweep::delete_events(conn, &self.run, self.before, SWEPT).await?;
        Ok(more || events as i64 == SWEPT)
    }
}
