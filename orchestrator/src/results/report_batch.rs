//! The rows that one report touches: read once, changed in memory, and written once.

use std::collections::{BTreeMap, BTreeSet};

use api_types::{ReceiptStatus, RefusalCode, ResultReceipt};
use store::critiques::{self, NewCritiqueJob};
use store::episodes::{self, EpisodeRow, EpisodeState, ReportedResult, StoredLog};
use store::groups::{self, GroupRow, GroupState};
use store::history::{HistoryBucket, VersionRange};
use store::ids::RunId;
use store::keys::{EpisodeKey, GroupKey};
use store::leases::{self, LeaseRow, Purpose};
use store::policy_versions::{self, VersionCounters, VersionKey};
use store::task_counters::{self, TaskCounters};
use store::{compacted_leases, to_u32};

use crate::critiques::criticise::MAX_JOB_EPISODES;
use crate::engine::error::ServiceError;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::evaluations::store_results;
use crate::results::audit_outcome::{AuditOutcome, AuditedEpisode};
use crate::results::close::update_and_close;
use crate::results::columns::check::{AuditCheck, check_episode};
use crate::results::columns::settle;
use crate::results::episode_row::{duplicate_receipt, episode_row, result_digest};
use crate::results::receipt::{refused_receipt, unstored_receipt};
use crate::results::refusal::Refusal;
use crate::results::report_summary::ReportSummary;
use crate::results::stalled::{close_stalled, end_if_done};
use crate::runs::version_step::check_version_step;

/// Rows that the episodes of one report touch.
#[derive(Default)]
pub(crate) struct ReportBatch {
    /// Id of the run.
    run: String,
    /// Earlier results of the reported episodes.
    earlier: BTreeMap<EpisodeKey, ReportedResult>,
    /// New results with their action logs, to be written at the end.
    new: Vec<(EpisodeRow, Option<StoredLog>)>,
    leases: BTreeMap<i64, LeaseRow>,
    /// Groups of the reported episodes that are unchanged so far.
    unchanged: BTreeMap<GroupKey, GroupRow>,
    /// Groups that a reported episode changed.
    changed: BTreeMap<GroupKey, GroupRow>,
    sums: BTreeMap<task_counters::TaskCountersKey, TaskCounters>,
    versions: BTreeMap<VersionKey, VersionCounters>,
    /// Durations, steps and policy versions of the counted episodes, by task.
    history: BTreeMap<String, HistoryBucket>,
    /// Numbers of the episodes to criticise, by lease and task.
    to_criticise: BTreeMap<(i64, String), Vec<i64>>,
    newest_policy: i64,
    /// Scores that columns claim for the reported episodes.
    claimed_scores: BTreeMap<EpisodeKey, f64>,
    /// Leases of columns whose claim a replay contradicts, with the reason.
    refuted: BTreeMap<i64, String>,
}

impl ReportBatch {
    /// Reads the rows of the reported episodes, in a number of statements that does not depend on their number.
    pub(crate) async fn open(
        tx: &mut WriteTx,
        run: &RunId,
        reported: &[AuditedEpisode],
    ) -> Result<Self, ServiceError> {
        let mut batch = Self { run: run.to_string(), ..Self::default() };
        let keys: Vec<EpisodeKey> = reported.iter().filter_map(|episode| episode.key).collect();
        for earlier in episodes::reported_among(&mut tx.conn, &keys).await? {
            let key = EpisodeKey { lease: earlier.lease, number: earlier.number };
            batch.earlier.insert(key, earlier);
        }
        let mut needed: BTreeMap<i64, BTreeSet<i64>> = BTreeMap::new();
        for key in &keys {
            if let Some(lease) = batch.lease(tx, key.lease).await? {
                needed.entry(lease.id).or_default().insert(group_key(&lease, key.number).number);
            }
        }
        if batch.leases.values().any(LeaseRow::is_columns) {
            batch.claimed_scores = store::columns::scores(&mut tx.conn, &keys).await?;
        }
        for (lease, numbers) in needed {
            let numbers: Vec<i64> = numbers.into_iter().collect();
            for group in groups::get_many(&mut tx.conn, lease, &numbers).await? {
                batch.unchanged.insert(GroupKey { lease, number: group.number }, group);
            }
        }
        Ok(batch)
    }

    /// Adds a reported episode and returns its receipt.
    pub(crate) async fn add(
        &mut self,
        tx: &mut WriteTx,
        batch_version: Option<u32>,
        reported: AuditedEpisode,
    ) -> Result<ResultReceipt, ServiceError> {
        let AuditedEpisode { episode, key, policy_version, metrics, is_in_session, outcome } = reported;
        let Some(key) = key else { return Ok(unstored_receipt(episode, outcome)) };
        if matches!(outcome, AuditOutcome::Refused(_) | AuditOutcome::Known { .. }) {
            return Ok(unstored_receipt(episode, outcome));
        }
        let digest = result_digest(&outcome);
        if let Some(earlier) = self.earlier.get(&key) {
            return Ok(duplicate_receipt(episode, earlier, &digest));
        }
        let lease = self.lease(tx, key.lease).await?;
        let Some(lease) = lease.filter(|lease| self.accepts(lease, key.number)) else {
            // The lease was compacted after the lookup.
            let compacted = compacted_leases::get(&mut tx.conn, &self.run, key.lease).await?;
            return Ok(unstored_receipt(episode, AuditOutcome::of_compacted(compacted.as_ref(), key.number)));
        };
        let version = policy_version.or(batch_version).map_or(lease.policy_version, i64::from);
        if let Some(refusal) = self.refusal(tx, &lease, key.number, version).await? {
            return Ok(refused_receipt(episode, refusal));
        }
        let clock = tx.run(&lease.run).await?.lease_clock();
        let is_late = !lease.is_active() || lease.expires_at <= clock || self.is_closed(&lease, key.number);
        let row = EpisodeRow {
            policy_version: version,
            metrics,
            ..episode_row(key, &outcome, is_late, digest, tx.now)?
        };
        let status = match (is_late, lease.is_columns()) {
            (true, _) => Ok(ReceiptStatus::Late),
            (false, false) => {
                if is_in_session {
                    self.group(&lease, key.number)?.abandoned += 1;
                }
                Ok(self.count(tx, &lease, &row, &outcome).await?)
            }
            (false, true) => match self.compare(&lease, &row)? {
                AuditCheck::Agrees => Ok(ReceiptStatus::Audited),
                AuditCheck::Failed => Ok(ReceiptStatus::Failed),
                AuditCheck::Differs(why) => Err(why),
            },
        };
        let receipt = match status {
            Ok(status) => ResultReceipt {
                episode,
                status,
                code: None,
                detail: None,
                score: row.score,
                skill: row.skill,
                success: row.success,
            },
            Err(why) => {
                self.refuted.entry(lease.id).or_insert_with(|| format!("{episode}: {why}"));
                let refusal = Refusal::new(RefusalCode::ColumnsMismatch, why);
                ResultReceipt { score: row.score, ..refused_receipt(episode, refusal) }
            }
        };
        self.keep(row, outcome);
        Ok(receipt)
    }

    /// Returns why a result cannot be stored: its scenario is not disclosed, or it may not have this policy version.
    async fn refusal(
        &self,
        tx: &mut WriteTx,
        lease: &LeaseRow,
        number: i64,
        version: i64,
    ) -> Result<Option<Refusal>, ServiceError> {
        if self.is_undisclosed(lease, number) {
            let detail = "its group was not begun; begin the group first".to_owned();
            return Ok(Some(Refusal::new(RefusalCode::NotBegun, detail)));
        }
        refuse_version(tx, lease, number, version).await
    }

    /// Keeps a new result until the end of the report. A later report of the same episode is then a duplicate.
    fn keep(&mut self, row: EpisodeRow, outcome: AuditOutcome) {
        let EpisodeRow { lease, number, score, skill, success, .. } = row;
        let earlier = ReportedResult { lease, number, digest: row.digest.clone(), score, skill, success };
        self.earlier.insert(EpisodeKey { lease, number }, earlier);
        let log = if let AuditOutcome::Replayed(replayed) = outcome { Some(replayed.log) } else { None };
        self.new.push((row, log));
    }

    /// Returns the row of a lease; `None` if the lease was compacted and deleted.
    async fn lease(&mut self, tx: &mut WriteTx, id: i64) -> Result<Option<LeaseRow>, ServiceError> {
        if let Some(row) = self.leases.get(&id) {
            return Ok(Some(row.clone()));
        }
        let row = leases::get(&mut tx.conn, id).await?;
        if let Some(row) = &row {
            self.leases.insert(id, row.clone());
        }
        Ok(row)
    }

    /// True if a first result of the episode can be stored: its group exists, and its lease is not compacted.
    fn accepts(&self, lease: &LeaseRow, number: i64) -> bool {
        let key = group_key(lease, number);
        !lease.is_compacted && (self.unchanged.contains_key(&key) || self.changed.contains_key(&key))
    }

    /// Returns the group of an episode as it is in this report.
    fn known_group(&self, lease: &LeaseRow, number: i64) -> Option<&GroupRow> {
        let key = group_key(lease, number);
        self.changed.get(&key).or_else(|| self.unchanged.get(&key))
    }

    /// True if the trainer has not received the scenario of an episode.
    fn is_undisclosed(&self, lease: &LeaseRow, number: i64) -> bool {
        self.known_group(lease, number).is_some_and(|group| !group.is_disclosed)
    }

    /// True if the group of an episode was closed while its lease goes on: later results did not wait for it.
    fn is_closed(&self, lease: &LeaseRow, number: i64) -> bool {
        self.known_group(lease, number).is_some_and(|group| group.state != GroupState::Open)
    }

    /// Returns the group of an episode, to be changed.
    fn group(&mut self, lease: &LeaseRow, number: i64) -> Result<&mut GroupRow, ServiceError> {
        let key = group_key(lease, number);
        if let Some(group) = self.unchanged.remove(&key) {
            self.changed.insert(key, group);
        }
        let found = self.changed.get_mut(&key);
        found.ok_or_else(|| ServiceError::UnknownLease(lease.id.to_string()))
    }

    /// Compares an audited episode with the claim of its columns. It counts once all audited episodes are in.
    fn compare(&mut self, lease: &LeaseRow, row: &EpisodeRow) -> Result<AuditCheck, ServiceError> {
        let claimed = self.claimed_scores.get(&row.key()).copied();
        let group = self.group(lease, row.number)?;
        let check = check_episode(claimed, group, row);
        if check == AuditCheck::Agrees {
            group.finished += 1;
            group.successes += i64::from(row.success == Some(true));
        }
        Ok(check)
    }

    /// Counts an episode into its group, the counters of its task and the history.
    async fn count(
        &mut self,
        tx: &mut WriteTx,
        lease: &LeaseRow,
        row: &EpisodeRow,
        outcome: &AuditOutcome,
    ) -> Result<ReceiptStatus, ServiceError> {
        let state = tx.run(&lease.run).await?.state;
        let newest = state.policy_version.max(self.newest_policy).max(row.policy_version);
        let max_staleness = state.settings.max_staleness;
        let group = self.group(lease, row.number)?;
        let is_counted = group.is_training_or_probe();
        let is_stale = max_staleness.is_some_and(|max| newest - row.policy_version > i64::from(max));
        let is_failed = row.state == EpisodeState::Failed;
        let sums = if is_failed {
            group.failed += 1;
            TaskCounters { failed: 1, ..TaskCounters::default() }
        } else {
            let successes = i64::from(row.success == Some(true));
            group.finished += 1;
            group.successes += successes;
            if !is_stale {
                group.counted += 1;
                group.counted_successes += successes;
            }
            TaskCounters {
                episodes: 1,
                successes,
                score_sum: row.score.unwrap_or(0.0),
                episodes_with_skill: i64::from(row.skill.is_some()),
                skill_sum: row.skill.unwrap_or(0.0),
                ..TaskCounters::default()
            }
        };
        let key = task_counters::TaskCountersKey::of(group);
        let is_evidence = group.is_mastery_evidence() && !is_stale;
        // An evaluation changes nothing, its task's counters included.
        if is_counted {
            if row.state == EpisodeState::Finished {
                let version = VersionKey { version: row.policy_version, task: key.task.clone() };
                let version = self.versions.entry(version).or_default();
                version.episodes += 1;
                version.successes += sums.successes;
                version.score_sum += sums.score_sum;
                let history = self.history.entry(key.task.clone()).or_default();
                history.steps += outcome.steps();
                history.add_versions(Some(VersionRange::of(row.policy_version)));
                if let Some(time_s) = outcome.time_s() {
                    history.durations.add(time_s);
                }
                self.to_criticise.entry((lease.id, key.task.clone())).or_default().push(row.number);
            }
            self.newest_policy = newest;
            self.sums.entry(key).or_default().add(&sums);
        }
        Ok(match (is_failed, is_evidence) {
            (true, _) => ReceiptStatus::Failed,
            (false, true) => ReceiptStatus::Counted,
            (false, false) => ReceiptStatus::Stored,
        })
    }

    /// Writes everything, closes groups that are whole, and ends leases that are done.
    pub(crate) async fn finish(self, tx: &mut WriteTx) -> Result<ReportSummary, ServiceError> {
        self.write_results(tx).await?;
        let mut groups: BTreeMap<i64, Vec<GroupRow>> = BTreeMap::new();
        for (key, group) in self.changed {
            groups.entry(key.lease).or_default().push(group);
        }
        let mut summary = ReportSummary::default();
        for (lease_id, groups) in groups {
            let Some(lease) = self.leases.get(&lease_id) else { continue };
            // Audited groups of columns close together, once all of them are in.
            let is_whole =
                |group: &GroupRow| !lease.is_columns() && group.finished + group.failed >= lease.group_size;
            let (whole, open): (Vec<_>, Vec<_>) = groups.into_iter().partition(is_whole);
            let mut run = tx.run(&lease.run).await?;
            summary.add(update_and_close(&mut run, lease, open, whole).await?);
        }
        for lease in self.leases.values().filter(|lease| lease.is_columns() && lease.is_active()) {
            match self.refuted.get(&lease.id) {
                Some(why) => settle::refuse(tx, lease, why).await?,
                None => summary.add(settle::settle(tx, lease).await?),
            }
        }
        for lease in self.leases.values().filter(|lease| !lease.is_columns()) {
            end_if_done(tx, lease).await?;
        }
        summary.add(close_stalled(tx, &self.run).await?);
        Ok(summary)
    }

    /// Writes the new results and counters, and enqueues episodes for their critique.
    async fn write_results(&self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let run = self.run.as_str();
        episodes::insert(&mut tx.conn, &self.new).await?;
        task_counters::add(&mut tx.conn, run, &self.sums).await?;
        for (key, sums) in &self.sums {
            tx.task_counts(run, &key.task).add(sums, key.level);
        }
        for (task, part) in &self.history {
            tx.task_counts(run, task).join(part);
        }
        policy_versions::add(&mut tx.conn, run, &self.versions, tx.now).await?;
        let jobs = self.to_criticise.iter().flat_map(|((lease, task), numbers)| {
            numbers.chunks(MAX_JOB_EPISODES).map(move |numbers| NewCritiqueJob {
                task,
                lease: *lease,
                numbers,
            })
        });
        let jobs: Vec<_> = jobs.collect();
        if !jobs.is_empty() {
            critiques::enqueue(&mut tx.conn, run, &jobs).await?;
            tx.outbox.signal(Signal::Critique);
        }
        let mut run = tx.run(run).await?;
        if self.newest_policy > run.state.policy_version {
            run.set_policy_version(self.newest_policy).await?;
        }
        Ok(())
    }
}

/// Key of the group of an episode.
fn group_key(lease: &LeaseRow, number: i64) -> GroupKey {
    GroupKey { lease: lease.id, number: number / lease.group_size.max(1) }
}

/// Returns why a result of an episode may not have a policy version: it is not that of the evaluation, or far above the newest.
async fn refuse_version(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    number: i64,
    version: i64,
) -> Result<Option<Refusal>, ServiceError> {
    if lease.purpose != Purpose::Eval {
        let newest = tx.run(&lease.run).await?.state.policy_version;
        let checked = check_version_step("policy_version", to_u32(version), newest);
        return Ok(checked.err().map(|error| Refusal::new(RefusalCode::InvalidResult, error.to_string())));
    }
    if version == lease.policy_version || !store_results::is_evaluation_episode(tx, lease, number).await? {
        return Ok(None);
    }
    let wanted = lease.policy_version;
    let detail = format!("the policy version must be {wanted}, that of the evaluation, got {version}");
    Ok(Some(Refusal::new(RefusalCode::VersionMismatch, detail)))
}
