//! A group's end: what it says to the curriculum, and what becomes of its scenario.

use super::writer::Work;
use super::{Happening, TrainingError, design, queue};
use crate::curriculum::{GroupOutcome, Move, Proposal};
use crate::store::leases::{GroupRow, LeaseRow};
use crate::store::sums::{self, Sums};
use crate::store::{episodes, from_json, leases, proposals, small, unsigned};

/// How often a scenario is offered: one that makes every trainer fall over must not come back for ever.
const MOST_ATTEMPTS: i64 = 3;

/// Closes a group: complete if every episode came back, else partial if enough did, else lost and offered again.
pub(super) async fn close_group(
    work: &mut Work,
    lease: &LeaseRow,
    mut group: GroupRow,
) -> Result<Vec<Move>, TrainingError> {
    let now = work.now;
    let (mind, conn) = work.mind(&lease.run).await?;
    let expired = (lease.group_size - group.finished - group.failed).max(0);
    let enough = group.finished >= i64::from(mind.settings.enough(small(lease.group_size)));
    group.state = match (enough, group.finished == lease.group_size) {
        (_, true) => "complete",
        (true, false) => "partial",
        (false, false) => "lost",
    }
    .to_owned();
    leases::update_group(conn, lease.id, &group, Some(now)).await?;
    work.tell(&lease.run, &Happening::group(lease, &group, expired))?;
    let (mind, conn) = work.mind(&lease.run).await?;
    if expired > 0 && group.counts() {
        let lost = Sums { expired, ..Sums::default() };
        sums::add(conn, &lease.run, &sums::Key::of(&group), &lost).await?;
    }
    let Some(seq) = group.proposal else {
        return match group.layout {
            Some(_) => design::outcome::take(work, lease, &group, (enough, expired)).await,
            None => Ok(Vec::new()), // an evaluation
        };
    };
    let body = proposals::body(conn, &lease.run, seq).await?;
    let Some(body) = body else { return Ok(Vec::new()) };
    let proposal: Proposal = from_json("a proposal", &body)?;
    let current = mind.curriculum.is_current(unsigned(seq), &proposal);
    let first = group.number * lease.group_size;
    let (score, skill) = episodes::group_means(conn, lease.id, first, first + lease.group_size).await?;
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
        mean_score: score.unwrap_or(0.0),
        mean_skill: skill,
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
