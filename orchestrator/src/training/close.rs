//! A group's end: what it says to the curriculum, and what becomes of its scenario.

use std::collections::BTreeMap;

use env_core::bracket;

use super::ended::{Ended, GroupEnd};
use super::sets::Sets;
use super::work::Work;
use super::{Happening, TrainingError, design, evaluation, queue, refill};
use crate::store::closings::{self, GroupSums};
use crate::store::groups::{self, Closing, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::sums::{self, Sums};
use crate::store::{from_json, proposals, small, unsigned};
use curriculum::{GroupOutcome, Move, Proposal, Signals};

/// How often a scenario is offered: one that makes every trainer fall over must not come back for ever.
const MOST_ATTEMPTS: i64 = 3;

/// Closes groups of a lease: complete if every episode came back, else partial if enough did, else lost and offered again.
pub(super) async fn close_groups(
    work: &mut Work,
    lease: &LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<Ended, TrainingError> {
    update_and_close(work, lease, (Vec::new(), groups)).await
}

/// Writes groups that go on, and closes others.
pub(super) async fn update_and_close(
    work: &mut Work,
    lease: &LeaseRow,
    (mut rows, mut groups): (Vec<GroupRow>, Vec<GroupRow>),
) -> Result<Ended, TrainingError> {
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
    let (mut ended, mut sums) = (Ended::default(), Vec::new());
    if groups.is_empty() {
        return Ok(ended);
    }
    let numbers: Vec<i64> = groups.iter().map(|group| group.number).collect();
    let closing = groups::closing(conn, lease, &numbers).await?;
    let closing: BTreeMap<i64, Closing> = closing.into_iter().map(|c| (c.number, c)).collect();
    for group in &groups {
        let Some(closing) = closing.get(&group.number) else { continue }; // cannot be: it is in the store
        let (end, moves) = close_group(work, lease, (group, group.finished >= least, closing)).await?;
        if lease.group_size > 1 && group.counts() {
            sums.push(part(group, &end));
        }
        ended.moves.extend(moves);
        ended.groups.push(end);
    }
    closings::add(&mut work.conn, &lease.run, &sums).await?;
    if !lease.is_columns() {
        let flat = ended.groups.iter().filter(|end| end.zero_variance == Some(true)).count();
        if flat > 0 {
            ended.refills = refill::owe(work, lease, flat as i64).await?;
        }
    } else {
        ended.groups.clear();
    }
    Ok(ended)
}

/// What a group came to.
fn group_end(lease: &LeaseRow, group: &GroupRow, closing: &Closing) -> GroupEnd {
    let flat = closing.lowest.zip(closing.highest).map(|(lowest, highest)| highest <= lowest);
    GroupEnd {
        lease: lease.name(),
        group: group.number,
        state: group.state.clone(),
        finished: group.finished,
        failed: group.failed,
        expired: (lease.group_size - group.finished - group.failed).max(0),
        successes: group.successes,
        mean_score: closing.score,
        zero_variance: flat.filter(|_| group.finished > 1),
    }
}

/// Closes a group; whether enough of it finished to count.
async fn close_group(
    work: &mut Work,
    lease: &LeaseRow,
    (group, enough, closing): (&GroupRow, bool, &Closing),
) -> Result<(GroupEnd, Vec<Move>), TrainingError> {
    let end = group_end(lease, group, closing);
    let expired = end.expired;
    work.tell(&lease.run, &Happening::group(lease, group, expired))?;
    if expired > 0 && group.counts() {
        let lost = Sums { expired, ..Sums::default() };
        work.count(&lease.run, &group.task).add(&lost, group.level);
        sums::add(&mut work.conn, &lease.run, &BTreeMap::from([(sums::Key::of(group), lost)])).await?;
    }
    let panel = panel(work, (lease, group), enough).await?;
    if enough && group.counts() {
        remember(work, (lease, group), &end, panel);
    }
    let Some(seq) = group.proposal else {
        let moves = match group.layout {
            Some(_) => design::outcome::take(work, lease, group, (enough, expired)).await?,
            None => {
                evaluation::fill::take(work, lease, group).await?;
                Vec::new()
            }
        };
        return Ok((end, moves));
    };
    let Some(body) = &closing.body else { return Ok((end, Vec::new())) };
    let proposal: Proposal = from_json("a proposal", body)?;
    if enough && group.counts() {
        work.count(&lease.run, &group.task).note(&proposal.params);
    }
    let (mind, conn) = work.mind(&lease.run).await?;
    let current = mind.curriculum.is_current(unsigned(seq), &proposal);
    let outcome = GroupOutcome {
        proposal: unsigned(seq),
        level: proposal.level,
        epoch: proposal.epoch,
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
        source: proposal.source,
        params: if proposal.level.is_none() { proposal.params } else { Vec::new() },
        signals: Signals {
            regret: closing.regret,
            panel: panel.filter(|_| mind.settings.curriculum.wants_panel()),
            positive_value_loss: closing.positive_value_loss,
            max_mc: closing.max_mc,
        },
        task: proposal.task,
    };
    if !enough && current {
        proposals::offer_again(conn, &lease.run, seq, MOST_ATTEMPTS).await?;
    }
    Ok((end, observe(work, &lease.run, outcome).await?))
}

/// How many groups of a transaction and task are looked at for what blind plans do on their scenarios, where only history wants it: it takes
/// reading them.
const PANELS: i64 = 2;

/// Whether the success of a group on a contested scenario counts: of a layout, which is shown again and again, that is up to the designs.
const fn is_proof(group: &GroupRow) -> bool {
    group.contested != 0 && group.evidence != 0 && group.finished > 0 && group.layout.is_none()
}

/// The share of blind plans that succeed on a group's scenario, where somebody wants it: the curriculum, or history of some.
async fn panel(
    work: &mut Work,
    (lease, group): (&LeaseRow, &GroupRow),
    enough: bool,
) -> Result<Option<f64>, TrainingError> {
    let shown = enough && group.counts() && is_proof(group) && work.panels(&lease.run, &group.task) < PANELS;
    let (mind, conn) = work.mind(&lease.run).await?;
    let wanted = group.proposal.is_some() && mind.settings.curriculum.wants_panel();
    if !shown && !wanted {
        return Ok(None);
    }
    let sets = Sets::of(conn, &[&group.scenario]).await?;
    let (scenario, bracket) = sets.get(&group.scenario, true)?;
    Ok(bracket.map(|bracket| bracket::panel_share(scenario, bracket)))
}

/// Adds a group to the history of its run.
fn remember(work: &mut Work, (lease, group): (&LeaseRow, &GroupRow), end: &GroupEnd, panel: Option<f64>) {
    let part = work.count(&lease.run, &group.task);
    if lease.group_size > 1 {
        part.groups += 1;
        part.flat += i64::from(end.zero_variance == Some(true));
    }
    if is_proof(group) {
        part.contested += 1;
        part.solved += group.successes as f64 / group.finished as f64;
        if let Some(share) = panel {
            part.panels += 1;
            part.panel += share;
        }
    }
}

/// A group's part in how groups of several episodes end.
fn part(group: &GroupRow, end: &GroupEnd) -> GroupSums {
    let of = |state: &str| i64::from(group.state == state);
    GroupSums {
        task: group.task.clone(),
        level: group.level.unwrap_or(-1),
        complete: of("complete"),
        partial: of("partial"),
        lost: of("lost"),
        flat: i64::from(group.state != "lost" && end.zero_variance == Some(true)),
    }
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
    for job in mind.curriculum.jobs() {
        tokio::task::spawn_blocking(move || job.run());
    }
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
