//! What becomes of a claim: accepted when all that is audited replayed as claimed, refused by the first log that did not, unproven
//! when logs never came.

use std::collections::BTreeMap;

use super::claim::episodes;
use super::{Columns, MOST_SCORE_GAP};
use crate::store::columns::{self, ClaimRow, ClaimedSums, RangeRow};
use crate::store::episodes::{EpisodeRow, Fared};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{self, LeaseRow};
use crate::store::sums::{self, Sums};
use crate::store::{self, critiques, marks, runs};
use crate::training::close::close_groups;
use crate::training::criticise::JOB;
use crate::training::ended::Ended;
use crate::training::{Happening, TrainingError, Work};

/// What columns come to, range by range: finished, failed, and the sum of the scores of those that finished.
#[derive(Debug)]
pub(super) struct ByRange(Vec<(i64, (i64, i64, f64))>);

pub(super) fn sums<'a>(
    columns: &Columns,
    ranges: impl Iterator<Item = &'a RangeRow>,
    group_size: usize,
) -> ByRange {
    let of = |range: &RangeRow| {
        let (mut finished, mut failed, mut score) = (0, 0, 0.0);
        for at in episodes(range, group_size) {
            if columns.has_failed(at) {
                failed += 1;
            } else {
                finished += 1;
                score += f64::from(columns.scores[at]);
            }
        }
        (range.number, (finished, failed, score))
    };
    ByRange(ranges.map(of).collect())
}

impl ByRange {
    pub(super) async fn keep(&self, work: &mut Work, lease: &LeaseRow) -> Result<(), TrainingError> {
        for (number, sums) in &self.0 {
            columns::set_range_sums(&mut work.conn, (lease.id, *number), *sums).await?;
        }
        Ok(())
    }
}

/// Whether an audited episode is what was claimed of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::training) enum Check {
    /// It is.
    Fine,
    /// It failed, as is claimed: no log of it is due.
    Failed,
    /// It is not: a sentence.
    Differs(String),
}

/// Compares an audited episode with the score claimed of it, if one is.
pub(in crate::training) fn check(claimed: Option<f64>, group: &GroupRow, row: &EpisodeRow) -> Check {
    let (claimed, score) = match (claimed, row.score) {
        (Some(claimed), Some(score)) => (claimed, score),
        (None, None) => return Check::Failed,
        (Some(_), None) => {
            return Check::Differs("it is reported as failed, and was claimed as finished".to_owned());
        }
        (None, Some(_)) => {
            return Check::Differs("it is reported as flown, and was claimed as failed".to_owned());
        }
    };
    let range = env_core::task(&group.task).map_or(1.0, |task| {
        let range = task.score_range();
        range.max - range.min
    });
    if (score - claimed).abs() <= MOST_SCORE_GAP * range {
        Check::Fine
    } else {
        Check::Differs(format!("its log replays to {score:.6}, and {claimed:.6} was claimed"))
    }
}

/// Ends a claim whose audited groups are all in: refused where a log says otherwise, else accepted and counted. Nothing
/// happens while logs are still due.
pub(in crate::training) async fn settle(work: &mut Work, lease: &LeaseRow) -> Result<Ended, TrainingError> {
    let Some(claim) = columns::claim(&mut work.conn, lease.id).await? else { return Ok(Ended::default()) };
    let mut groups = groups::of_lease(&mut work.conn, lease.id).await?;
    if claim.state != "claimed" || groups.iter().any(|group| group.finished + group.failed < lease.group_size)
    {
        return Ok(Ended::default());
    }
    let (mind, conn) = work.mind(&lease.run).await?;
    let newest = mind.policy_version.max(claim.policy_version);
    mind.policy_version = newest;
    runs::set_policy_version(conn, &lease.run, newest).await?;
    let stale =
        mind.settings.max_staleness.is_some_and(|most| newest - claim.policy_version > i64::from(most));
    for range in columns::ranges(conn, lease.id).await? {
        let RangeRow { finished, failed, score, first, groups: many, .. } = range;
        let of_it = |group: &&GroupRow| (first..first + many).contains(&group.number);
        let audited = groups.iter().filter(of_it).map(|group| group.finished).sum();
        let sums = ClaimedSums { episodes: finished, audited, failed, score, ..ClaimedSums::default() };
        columns::add_sums(&mut work.conn, &lease.run, (&range.task, range.level), &sums).await?;
        let part = work.count(&lease.run, &range.task);
        part.claimed += finished - audited; // what was audited counts below as what it came to
        part.at_level(range.level);
    }
    end(work, lease, (&claim, "accepted", None), groups.len()).await?;
    for group in &mut groups {
        group.evidence = i64::from(group.evidence != 0 && !stale);
    }
    count(work, lease, &groups).await?;
    work.wake_critique();
    close_groups(work, lease, groups).await
}

/// Counts audited groups as any other: plain sums, and what is to be criticised.
async fn count(work: &mut Work, lease: &LeaseRow, groups: &[GroupRow]) -> Result<(), TrainingError> {
    let conn = &mut work.conn;
    let (mut sums, mut jobs): (BTreeMap<sums::Key, Sums>, BTreeMap<&str, Vec<i64>>) = Default::default();
    for group in groups {
        let first = group.number * lease.group_size;
        let episodes = first..first + lease.group_size;
        let into = sums.entry(sums::Key::of(group)).or_default();
        for fared in store::episodes::of_group(conn, lease.id, episodes.start, episodes.end).await? {
            let Fared { success, skill, score, .. } = fared;
            into.add(&Sums {
                episodes: 1,
                successes: i64::from(success),
                score,
                skilled: i64::from(skill.is_some()),
                skill: skill.unwrap_or(0.0),
                ..Sums::default()
            });
        }
        jobs.entry(&group.task).or_default().extend(episodes);
    }
    sums::add(conn, &lease.run, &sums).await?;
    for (key, sums) in &sums {
        work.count(&lease.run, &key.task).add(sums, key.level);
    }
    let jobs =
        jobs.iter().flat_map(|(task, numbers)| numbers.chunks(JOB).map(|part| (*task, lease.id, part)));
    critiques::enqueue(&mut work.conn, &lease.run, &jobs.collect::<Vec<_>>()).await?;
    Ok(())
}

/// Refuses a claim: nothing of it counts, and the run is marked.
pub(in crate::training) async fn refuse(
    work: &mut Work,
    lease: &LeaseRow,
    why: &str,
) -> Result<(), TrainingError> {
    let Some(claim) = columns::claim(&mut work.conn, lease.id).await? else { return Ok(()) };
    if claim.state != "claimed" {
        return Ok(());
    }
    let groups = give_up(work, lease).await?;
    let lost = |episodes| ClaimedSums { refused: episodes, ..ClaimedSums::default() };
    add_lost(work, lease, lost).await?;
    end(work, lease, (&claim, "refused", Some(why)), groups).await?;
    let words = format!("the columns of lease {} were refused: {why}", lease.name());
    mark(work, lease, "refused_claim", &words).await
}

/// Marks the run, and tells who listens.
async fn mark(work: &mut Work, lease: &LeaseRow, kind: &str, words: &str) -> Result<(), TrainingError> {
    marks::insert(&mut work.conn, &lease.run, (kind, Some(lease.id), words), work.now).await?;
    work.tell(&lease.run, &Happening::Health { task: None, words })
}

/// Ends a lease whose time is over, or that was given back: what was claimed and not proven counts for nothing.
pub(in crate::training) async fn abandon(work: &mut Work, lease: &LeaseRow) -> Result<(), TrainingError> {
    match columns::claim(&mut work.conn, lease.id).await? {
        Some(claim) if claim.state == "claimed" => {
            let groups = give_up(work, lease).await?;
            add_lost(work, lease, |episodes| ClaimedSums { unproven: episodes, ..ClaimedSums::default() })
                .await?;
            columns::settle(&mut work.conn, lease.id, "unproven", None).await?;
            tell(work, lease, (&claim, "unproven", None), groups).await?;
            // Who sees what is audited and keeps it back leaves as plain a trace as who is found out.
            let words = format!("of what lease {} claims, logs that were due did not come", lease.name());
            mark(work, lease, "unproven_claim", &words).await
        }
        Some(_) => Ok(()),
        None => {
            add_lost(work, lease, |episodes| ClaimedSums { expired: episodes, ..ClaimedSums::default() })
                .await
        }
    }
}

/// Closes audited groups that count for nothing; how many there were.
async fn give_up(work: &mut Work, lease: &LeaseRow) -> Result<usize, TrainingError> {
    let mut groups = groups::of_lease(&mut work.conn, lease.id).await?;
    for group in &mut groups {
        (group.state, group.evidence) = ("lost".to_owned(), 0);
    }
    groups::update(&mut work.conn, lease.id, &groups, work.now).await?;
    Ok(groups.len())
}

async fn add_lost(
    work: &mut Work,
    lease: &LeaseRow,
    sums: impl Fn(i64) -> ClaimedSums,
) -> Result<(), TrainingError> {
    for range in columns::ranges(&mut work.conn, lease.id).await? {
        let sums = sums(range.groups * lease.group_size);
        columns::add_sums(&mut work.conn, &lease.run, (&range.task, range.level), &sums).await?;
    }
    Ok(())
}

/// Writes and tells what became of a claim, and ends its lease.
async fn end(
    work: &mut Work,
    lease: &LeaseRow,
    (claim, state, why): (&ClaimRow, &str, Option<&str>),
    audited: usize,
) -> Result<(), TrainingError> {
    columns::settle(&mut work.conn, lease.id, state, why).await?;
    leases::set_status(&mut work.conn, lease.id, "done").await?;
    tell(work, lease, (claim, state, why), audited).await?;
    work.tell(&lease.run, &Happening::lease(lease, "done"))
}

async fn tell(
    work: &mut Work,
    lease: &LeaseRow,
    (claim, state, why): (&ClaimRow, &str, Option<&str>),
    audited: usize,
) -> Result<(), TrainingError> {
    let told = Happening::Claim {
        lease: lease.name(),
        state,
        episodes: claim.episodes,
        failed: claim.failed,
        audited: audited as i64,
        why,
    };
    work.tell(&lease.run, &told)
}
