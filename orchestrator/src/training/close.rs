//! A group's end: what it says to the curriculum, and what becomes of its scenario.

use std::collections::BTreeMap;

use super::work::Work;
use super::{Happening, TrainingError, design, queue};
use crate::curriculum::{GroupOutcome, Move, Proposal};
use crate::store::groups::{self, Closing, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::sums::{self, Sums};
use crate::store::{from_json, proposals, small, unsigned};

/// How often a scenario is offered: one that makes every trainer fall over must not come back for ever.
const MOST_ATTEMPTS: i64 = 3;

/// Closes groups of a lease: complete if every episode came back, else partial if enough did, else lost and offered again.
pub(super) async fn close_groups(
    work: &mut Work,
    lease: &LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<Vec<Move>, TrainingError> {
    update_and_close(work, lease, (Vec::new(), groups)).await
}

/// Writes groups that go on, and closes others.
pub(super) async fn update_and_close(
    work: &mut Work,
    lease: &LeaseRow,
    (mut rows, mut groups): (Vec<GroupRow>, Vec<GroupRow>),
) -> Result<Vec<Move>, TrainingError> {
    let now = work.now;
    let (mind, conn) = work.mind(&lease.run).await?;
    let least = i64::from(mind.settings.enough(small(lease.group_size)));
    for group in &mut groups {
        group.state = match (group.finished >= least, group.finished == lease.group_size) {
            (_, true) => "complete",
            (true, false) => "partial",
            (false, false) => "lost",
        }
        .to_owned();
    }
    rows.extend(groups.iter().cloned());
    groups::update(conn, lease.id, &rows, now).await?;
    if groups.is_empty() {
        return Ok(Vec::new());
    }
    let numbers: Vec<i64> = groups.iter().map(|group| group.number).collect();
    let closing = groups::closing(conn, lease, &numbers).await?;
    let closing: BTreeMap<i64, Closing> = closing.into_iter().map(|c| (c.number, c)).collect();
    let mut moves = Vec::new();
    for group in &groups {
        let Some(closing) = closing.get(&group.number) else { continue }; // cannot be: it is in the store
        moves.extend(close_group(work, lease, (group, group.finished >= least, closing)).await?);
    }
    Ok(moves)
}

/// Closes a group; whether enough of it finished to count.
async fn close_group(
    work: &mut Work,
    lease: &LeaseRow,
    (group, enough, closing): (&GroupRow, bool, &Closing),
) -> Result<Vec<Move>, TrainingError> {
    let expired = (lease.group_size - group.finished - group.failed).max(0);
    work.tell(&lease.run, &Happening::group(lease, group, expired))?;
    let (mind, conn) = work.mind(&lease.run).await?;
    if expired > 0 && group.counts() {
        let lost = Sums { expired, ..Sums::default() };
        sums::add(conn, &lease.run, &BTreeMap::from([(sums::Key::of(group), lost)])).await?;
    }
    let Some(seq) = group.proposal else {
        return match group.layout {
            Some(_) => design::outcome::take(work, lease, group, (enough, expired)).await,
            None => Ok(Vec::new()), // an evaluation
        };
    };
    let Some(body) = &closing.body else { return Ok(Vec::new()) };
    let proposal: Proposal = from_json("a proposal", body)?;
    let current = mind.curriculum.is_current(unsigned(seq), &proposal);
    let epoch = proposal.epoch;
    let outcome = GroupOutcome {
        proposal: unsigned(seq),
        task: proposal.task,
        level: proposal.level,
        epoch,
        role: proposal.role,
        contested: group.contested != 0,
        // Too few siblings say nothing about the scenario, but that the others were lost is said.
        finished: if enough { small(group.finished) } else { 0 },
        successes: if enough { small(group.successes) } else { 0 },
        failed: small(group.failed),
        expired: small(expired),
        evidence: group.evidence != 0,
        mean_score: closing.score.unwrap_or(0.0),
        mean_skill: closing.skill,
    };
    if !enough && current {
        proposals::offer_again(conn, &lease.run, seq, MOST_ATTEMPTS).await?;
    }
    observe(work, &lease.run, outcome).await
}

/// Tells the curriculum, and drops what a move made stale.
pub(super) async fn observe(
    work: &mut Work,
    run: &str,
    outcome: GroupOutcome,
) -> Result<Vec<Move>, TrainingError> {
    let now = work.now;
    let (mind, conn) = work.mind(run).await?;
    let before = mind.curriculum.status();
    let moves = mind.observe(conn, outcome, now).await?;
    let after = mind.curriculum.status();
    for moved in &moves {
        work.tell(run, &Happening::Move(moved))?;
    }
    for status in &after {
        // Their words have counts in them: what is told is that there is one more.
        let known =
            before.iter().find(|known| known.task == status.task).map_or(0, |known| known.warnings.len());
        for words in status.warnings.iter().skip(known) {
            work.tell(run, &Happening::Health { task: Some(&status.task), words })?;
        }
    }
    if !before.iter().map(|status| status.epoch).eq(after.iter().map(|status| status.epoch)) {
        queue::refresh(work, run).await?;
    }
    Ok(moves)
}
