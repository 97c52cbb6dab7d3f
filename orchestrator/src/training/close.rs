//! A group's end: what it says to the curriculum, and what becomes of its scenario.

use super::writer::Work;
use super::{Happening, TrainingError, design, queue};
use crate::curriculum::{GroupOutcome, Move, Proposal};
use crate::store::leases::{GroupRow, LeaseRow};
use crate::store::sums::{self, Sums};
use crate::store::{episodes, from_json, leases, proposals, small, unsigned};

/// How often a scenario is offered: one that makes every trainer fall over must not come back for ever.
const MOST_ATTEMPTS: i64 = 3;

/// Closes groups of a lease: complete if every episode came back, else partial if enough did, else lost and offered again.
pub(super) async fn close_groups(
    work: &mut Work,
    lease: &LeaseRow,
    mut groups: Vec<GroupRow>,
) -> Result<Vec<Move>, TrainingError> {
    if groups.is_empty() {
        return Ok(Vec::new());
    }
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
    leases::update_groups(conn, lease.id, &groups, Some(now)).await?;
    let numbers: Vec<i64> = groups.iter().map(|group| group.number).collect();
    let means = episodes::group_means(conn, (lease.id, lease.group_size), &numbers).await?;
    let proposed: Vec<i64> = groups.iter().filter_map(|group| group.proposal).collect();
    let bodies = proposals::bodies(conn, &lease.run, &proposed).await?;
    let mut moves = Vec::new();
    for group in &groups {
        let body = group.proposal.and_then(|seq| bodies.get(&seq));
        let means = means.get(&group.number).copied();
        let closing = Closing { group, enough: group.finished >= least, body, means };
        moves.extend(close_group(work, lease, closing).await?);
    }
    Ok(moves)
}

/// A group that ends.
struct Closing<'a> {
    group: &'a GroupRow,
    /// Whether it counts.
    enough: bool,
    /// Its proposal, as JSON.
    body: Option<&'a String>,
    /// Means of score and skill, if anything finished.
    means: Option<(f64, Option<f64>)>,
}

async fn close_group(
    work: &mut Work,
    lease: &LeaseRow,
    Closing { group, enough, body, means }: Closing<'_>,
) -> Result<Vec<Move>, TrainingError> {
    let expired = (lease.group_size - group.finished - group.failed).max(0);
    work.tell(&lease.run, &Happening::group(lease, group, expired))?;
    let (mind, conn) = work.mind(&lease.run).await?;
    if expired > 0 && group.counts() {
        let lost = Sums { expired, ..Sums::default() };
        sums::add(conn, &lease.run, &sums::Key::of(group), &lost).await?;
    }
    let Some(seq) = group.proposal else {
        return match group.layout {
            Some(_) => design::outcome::take(work, lease, group, (enough, expired)).await,
            None => Ok(Vec::new()), // an evaluation
        };
    };
    let Some(body) = body else { return Ok(Vec::new()) };
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
        mean_score: means.map_or(0.0, |(score, _)| score),
        mean_skill: means.and_then(|(_, skill)| skill),
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
