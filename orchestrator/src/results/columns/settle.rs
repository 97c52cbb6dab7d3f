//! Ends claims: a claim is accepted when every audited log replays as claimed, refused by the first log that does not, and unproven
//! when logs are missing.

use std::collections::BTreeMap;

use store::columns::{self, ClaimCounters, ClaimState, ColumnClaimRow, SeedRangeRow};
use store::critiques::{self, NewCritiqueJob};
use store::episodes::{self, FinishedEpisode};
use store::groups::{self, GroupRow, GroupState};
use store::history::VersionRange;
use store::keys::EpisodeSpan;
use store::leases::{self, LeaseRow, LeaseStatus};
use store::proposals::{self, LeasedProposal};
use store::run_warnings::{self, NewWarning, WarningKind};
use store::task_counters::{self, TaskCounters, TaskCountersKey};
use store::{from_json, to_u32, to_u64};

use crate::critiques::criticise::MAX_JOB_EPISODES;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::metrics::LeaseEvent;
use crate::results::close::close_groups;
use crate::results::columns::sample::take_sample;
use crate::results::observe::observe;
use crate::results::report_summary::ReportSummary;
use curriculum::{GroupOutcome, Proposal};

/// How a claim ends.
#[derive(Debug, Clone, Copy)]
struct Settlement<'a> {
    claim: &'a ColumnClaimRow,
    state: ClaimState,
    /// Reason of a refusal.
    reason: Option<&'a str>,
    /// Number of audited groups.
    audited: usize,
}

/// Ends a claim whose audited groups are complete: it is accepted and counted. Nothing happens while logs are due.
pub(crate) async fn settle(tx: &mut WriteTx, lease: &LeaseRow) -> Result<ReportSummary, ServiceError> {
    let Some(claim) = columns::claim(&mut tx.conn, lease.id).await? else {
        return Ok(ReportSummary::default());
    };
    let mut groups = groups::of_lease(&mut tx.conn, lease.id).await?;
    let is_due = groups.iter().any(|group| group.finished + group.failed < lease.group_size);
    if claim.state != ClaimState::Claimed || is_due {
        return Ok(ReportSummary::default());
    }
    let mut run = tx.run(&lease.run).await?;
    let newest = run.state.policy_version.max(claim.policy_version);
    run.set_policy_version(newest).await?;
    let max_staleness = run.state.settings.max_staleness;
    let is_stale = max_staleness.is_some_and(|max| newest - claim.policy_version > i64::from(max));
    let mut claimed: BTreeMap<String, i64> = BTreeMap::new();
    for range in columns::ranges(run.conn, lease.id).await? {
        let audited =
            groups.iter().filter(|group| range.holds(group.number)).map(|group| group.finished).sum();
        let SeedRangeRow { finished, failed, score_sum: score, .. } = range;
        let counters = ClaimCounters {
            episodes: finished,
            audited,
            failed,
            score_sum: score,
            ..ClaimCounters::default()
        };
        columns::add_counters(run.conn, &lease.run, &range.task, range.level, &counters).await?;
        let history = run.task_counts(&range.task);
        history.claimed_episodes += finished - audited; // audited episodes are counted below, by their replay
        history.add_level(range.level);
        history.add_versions(Some(VersionRange::of(claim.policy_version)));
        *claimed.entry(range.task).or_default() += finished - audited;
    }
    end(
        tx,
        lease,
        Settlement { claim: &claim, state: ClaimState::Accepted, reason: None, audited: groups.len() },
    )
    .await?;
    for group in groups.iter_mut().filter(|_| !is_stale) {
        (group.counted, group.counted_successes) = (group.finished, group.successes);
    }
    count_audited(tx, lease, &groups, &claimed).await?;
    tx.outbox.signal(Signal::Critique);
    close_groups(&mut tx.run(&lease.run).await?, lease, groups).await
}

/// Counts audited groups like any others, and enqueues their episodes for the critique. `claimed` has the other episodes of the
/// claim by task: a claim does not say how many steps they had, so the history counts as many as audited episodes had on average.
async fn count_audited(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    groups: &[GroupRow],
    claimed: &BTreeMap<String, i64>,
) -> Result<(), ServiceError> {
    let conn = &mut tx.conn;
    let mut steps: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
    let mut counters: BTreeMap<TaskCountersKey, TaskCounters> = BTreeMap::new();
    let mut episodes_of: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
    for group in groups {
        let from = group.number * lease.group_size;
        let span = EpisodeSpan { lease: lease.id, from, to: from + lease.group_size };
        let sum = counters.entry(TaskCountersKey::of(group)).or_default();
        for FinishedEpisode { success, skill, score, steps: taken, .. } in
            episodes::finished(conn, span).await?
        {
            steps.entry(&group.task).or_default().push(taken);
            sum.add(&TaskCounters {
                episodes: 1,
                successes: i64::from(success),
                score_sum: score,
                episodes_with_skill: i64::from(skill.is_some()),
                skill_sum: skill.unwrap_or(0.0),
                ..TaskCounters::default()
            });
        }
        sum.add(&TaskCounters { failed: group.failed, ..TaskCounters::default() });
        if group.finished > 0 {
            episodes_of.entry(&group.task).or_default().extend(span.from..span.to);
        }
    }
    add_counters(tx, lease, &counters).await?;
    for (task, steps) in steps {
        let (audited, all) = (steps.iter().sum::<i64>(), claimed.get(task).copied().unwrap_or(0));
        let of_claimed = all as f64 * (audited as f64 / steps.len() as f64);
        tx.task_counts(&lease.run, task).steps += audited + of_claimed.round() as i64;
    }
    let jobs = episodes_of.iter().flat_map(|(task, numbers)| {
        numbers.chunks(MAX_JOB_EPISODES).map(|numbers| NewCritiqueJob { task, lease: lease.id, numbers })
    });
    critiques::enqueue(&mut tx.conn, &lease.run, &jobs.collect::<Vec<_>>()).await?;
    Ok(())
}

/// Adds to the counters of tasks, and to their history.
async fn add_counters(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    counters: &BTreeMap<TaskCountersKey, TaskCounters>,
) -> Result<(), ServiceError> {
    task_counters::add(&mut tx.conn, &lease.run, counters).await?;
    for (key, sum) in counters {
        tx.task_counts(&lease.run, &key.task).add(sum, key.level);
    }
    Ok(())
}

/// Refuses a claim: nothing of it counts, and the run gets a warning.
pub(crate) async fn refuse(tx: &mut WriteTx, lease: &LeaseRow, reason: &str) -> Result<(), ServiceError> {
    let Some(claim) = columns::claim(&mut tx.conn, lease.id).await? else { return Ok(()) };
    if claim.state != ClaimState::Claimed {
        return Ok(());
    }
    let audited = discard_groups(tx, lease).await?;
    count_lost(tx, lease, |episodes| ClaimCounters { refused: episodes, ..ClaimCounters::default() }).await?;
    end(tx, lease, Settlement { claim: &claim, state: ClaimState::Refused, reason: Some(reason), audited })
        .await?;
    let message = format!("the claim of lease {} was refused: {reason}", lease.name());
    warn(tx, lease, WarningKind::RefusedClaim, &message).await
}

/// Ends a lease of columns that expired or was released: a claim that is not proven counts for nothing. The slots of the sample are
/// missing, whether the trainer saw which groups are audited or not.
pub(crate) async fn abandon(tx: &mut WriteTx, lease: &LeaseRow) -> Result<(), ServiceError> {
    match columns::claim(&mut tx.conn, lease.id).await? {
        Some(claim) if claim.state == ClaimState::Claimed => {
            let audited = discard_groups(tx, lease).await?;
            count_lost(tx, lease, |episodes| ClaimCounters {
                unproven: episodes,
                ..ClaimCounters::default()
            })
            .await?;
            columns::settle(&mut tx.conn, lease.id, ClaimState::Unproven, None).await?;
            emit(
                tx,
                lease,
                Settlement { claim: &claim, state: ClaimState::Unproven, reason: None, audited },
            )?;
            // A trainer that withholds audited logs leaves as plain a trace as one whose logs contradict its claim.
            let message =
                format!("lease {} ended before the trainer reported all audited logs", lease.name());
            warn(tx, lease, WarningKind::UnprovenClaim, &message).await
        }
        Some(_) => Ok(()),
        None => {
            let mut sample = take_sample(&mut tx.conn, lease, true).await?;
            sample.iter_mut().for_each(|group| group.state = GroupState::Lost);
            groups::insert(&mut tx.conn, lease.id, &sample).await?;
            lose_slots(tx, lease, &sample).await?;
            count_lost(tx, lease, |episodes| ClaimCounters { expired: episodes, ..ClaimCounters::default() })
                .await
        }
    }
}

/// Adds a warning to the run, and emits it.
async fn warn(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    kind: WarningKind,
    message: &str,
) -> Result<(), ServiceError> {
    let warning = NewWarning { run: &lease.run, kind, lease: Some(lease.id), message };
    run_warnings::insert(&mut tx.conn, &warning, tx.now).await?;
    tx.emit(&lease.run, &RunEvent::Warning { task: None, message })
}

/// Closes the audited groups without counting them, and returns their number. Their slots are missing.
async fn discard_groups(tx: &mut WriteTx, lease: &LeaseRow) -> Result<usize, ServiceError> {
    let mut groups = groups::of_lease(&mut tx.conn, lease.id).await?;
    groups.iter_mut().for_each(|group| group.state = GroupState::Lost);
    groups::update(&mut tx.conn, lease.id, &groups, tx.now).await?;
    lose_slots(tx, lease, &groups).await?;
    Ok(groups.len())
}

/// Counts the episodes of audited groups without results as expired, and passes their slots to the curriculum.
async fn lose_slots(tx: &mut WriteTx, lease: &LeaseRow, groups: &[GroupRow]) -> Result<(), ServiceError> {
    let mut counters: BTreeMap<TaskCountersKey, TaskCounters> = BTreeMap::new();
    for group in groups {
        let expired = TaskCounters { expired: lease.group_size, ..TaskCounters::default() };
        counters.entry(TaskCountersKey::of(group)).or_default().add(&expired);
    }
    add_counters(tx, lease, &counters).await?;
    let mut run = tx.run(&lease.run).await?;
    let seqs: Vec<i64> = groups.iter().filter_map(|group| group.proposal).collect();
    for LeasedProposal { seq, body, .. } in proposals::get_many(run.conn, &lease.run, &seqs).await? {
        let proposal: Proposal = from_json("a proposal", &body)?;
        for group in groups.iter().filter(|group| group.is_slot && group.proposal == Some(seq)) {
            observe(&mut run, GroupOutcome::missing(to_u64(seq), to_u32(group.number), &proposal)).await?;
        }
    }
    Ok(())
}

/// Counts the episodes of each range that count for nothing.
async fn count_lost(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    counters: impl Fn(i64) -> ClaimCounters,
) -> Result<(), ServiceError> {
    for range in columns::ranges(&mut tx.conn, lease.id).await? {
        let lost = counters(range.groups * lease.group_size);
        columns::add_counters(&mut tx.conn, &lease.run, &range.task, range.level, &lost).await?;
    }
    Ok(())
}

/// Stores and emits the end of a claim, and ends its lease.
async fn end(tx: &mut WriteTx, lease: &LeaseRow, settlement: Settlement<'_>) -> Result<(), ServiceError> {
    columns::settle(&mut tx.conn, lease.id, settlement.state, settlement.reason).await?;
    leases::set_status(&mut tx.conn, lease.id, LeaseStatus::Done).await?;
    emit(tx, lease, settlement)?;
    tx.emit(&lease.run, &RunEvent::lease(lease, LeaseEvent::Done))
}

fn emit(tx: &mut WriteTx, lease: &LeaseRow, settlement: Settlement<'_>) -> Result<(), ServiceError> {
    let Settlement { claim, state, reason, audited } = settlement;
    let event = RunEvent::Claim {
        lease: lease.name(),
        state,
        episodes: claim.episodes,
        failed: claim.failed,
        audited: audited as i64,
        reason,
    };
    tx.emit(&lease.run, &event)
}
