//! Taking results: each episode once, by its replay, with the curriculum told when a group is whole.

use std::collections::{BTreeMap, BTreeSet};

use super::audit::{Audited, Found, Verdict, past};
use super::close::update_and_close;
use super::criticise::JOB;
use super::ended::Ended;
use super::evaluation::fill;
use super::receipt::Receipt;
use super::work::Work;
use super::{Change, Happening, TrainingError, columns};
use crate::counts;
use crate::ids::RunId;
use crate::store::brackets::{self, StoredFlown};
use crate::store::episodes::{self, Before, EpisodeRow, StoredLog};
use crate::store::groups::{self, GroupRow};
use crate::store::leases::{self, LeaseRow};
use crate::store::sums::{self, Sums};
use crate::store::{self, critiques, folds, runs, to_json, versions};

/// Takes audited results.
#[derive(Debug)]
pub struct Report {
    /// Of which run.
    pub run: RunId,
    /// The policy that flew them, where an episode does not say and other than the lease's.
    pub policy_version: Option<u32>,
    /// The results.
    pub results: Vec<Audited>,
    /// What was bracketed for them.
    pub found: Vec<Found>,
}

impl Change for Report {
    type Answer = (Vec<Receipt>, Ended);
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        for Found { group: (lease, number), scenario, bracket, contested } in &self.found {
            // It may have been folded since it was looked up.
            if groups::get(&mut work.conn, *lease, *number).await?.is_some() {
                brackets::insert(&mut work.conn, &[(scenario.id().0.as_slice(), bracket)]).await?;
                groups::set_contested(&mut work.conn, (*lease, *number), *contested).await?;
            }
        }
        let mut books = Books::open(work, &self.run, &self.results).await?;
        let mut receipts = Vec::with_capacity(self.results.len());
        for result in self.results {
            receipts.push(books.enter(work, self.policy_version, result).await?);
        }
        let ended = books.close(work, self.run.as_str()).await?;
        receipts.iter().for_each(|receipt| counts::result(receipt.status, receipt.code));
        Ok((receipts, ended))
    }
}

/// What one batch touches, read once and written once.
#[derive(Default)]
struct Books {
    /// Of this run.
    run: String,
    /// What was reported before, of what is reported now.
    before: BTreeMap<(i64, i64), Before>,
    /// What is new, with its action log: written when all has been entered.
    fresh: Vec<(EpisodeRow, Option<StoredLog>)>,
    leases: BTreeMap<i64, LeaseRow>,
    /// Groups of what is reported, until something of them counts.
    known: BTreeMap<(i64, i64), GroupRow>,
    groups: BTreeMap<(i64, i64), GroupRow>,
    sums: BTreeMap<sums::Key, Sums>,
    versions: versions::Fared,
    /// Indices of episodes that the critique has to look at, by lease and task.
    to_criticise: BTreeMap<(i64, String), Vec<i64>>,
    newest_policy: i64,
    /// Scores claimed of what is audited of columns.
    claimed: BTreeMap<(i64, i64), f64>,
    /// Leases of columns whose claim does not hold, and why.
    refuted: BTreeMap<i64, String>,
}

impl Books {
    /// Reads what these results are about: a few statements, however many they are.
    async fn open(work: &mut Work, run: &RunId, results: &[Audited]) -> Result<Self, TrainingError> {
        let mut books = Self { run: run.to_string(), ..Self::default() };
        let places: Vec<_> = results.iter().filter_map(|result| result.place).collect();
        for before in episodes::before(&mut work.conn, &places).await? {
            books.before.insert((before.lease, before.number), before);
        }
        let mut wanted: BTreeMap<i64, BTreeSet<i64>> = BTreeMap::new();
        for (lease, number) in &places {
            if let Some(lease) = books.lease(work, *lease).await? {
                wanted.entry(lease.id).or_default().insert(number / lease.group_size.max(1));
            }
        }
        if books.leases.values().any(LeaseRow::is_columns) {
            books.claimed = store::columns::scores(&mut work.conn, &places).await?;
        }
        for (lease, numbers) in wanted {
            let numbers: Vec<i64> = numbers.into_iter().collect();
            for group in groups::some(&mut work.conn, lease, &numbers).await? {
                books.known.insert((lease, group.number), group);
            }
        }
        Ok(books)
    }

    async fn enter(
        &mut self,
        work: &mut Work,
        batch_version: Option<u32>,
        result: Audited,
    ) -> Result<Receipt, TrainingError> {
        let Audited { episode, place, policy_version, metrics, verdict } = result;
        let Some((lease_id, number)) = place else { return Ok(Receipt::without(episode, verdict)) };
        if matches!(verdict, Verdict::Refused { .. } | Verdict::Known { .. }) {
            return Ok(Receipt::without(episode, verdict));
        }
        let digest = digest(&verdict);
        if let Some(before) = self.before.get(&(lease_id, number)) {
            return Ok(again(episode, before, &digest));
        }
        let Some(lease) = self.lease(work, lease_id).await?.filter(|lease| self.keeps(lease, number)) else {
            // It was folded since it was looked up.
            let folded = folds::get(&mut work.conn, &self.run, lease_id).await?;
            return Ok(Receipt::without(episode, past(folded.as_ref(), number)));
        };
        let late = lease.status != "active" || lease.expires_at <= work.now;
        let version = policy_version.or(batch_version).map_or(lease.policy_version, i64::from);
        if version != lease.policy_version && fill::is_of_one(work, &lease, number).await? {
            let why = format!("its evaluation is of version {}, and this of {version}", lease.policy_version);
            return Ok(Receipt::refused(episode, "other_version", why));
        }
        let row = row(lease_id, number, late, &verdict, digest, version, metrics, work.now)?;
        let status = match (late, lease.is_columns()) {
            (true, _) => Ok("late"),
            (false, false) => Ok(self.count(work, &lease, &row).await?),
            (false, true) => match self.compare(&lease, &row)? {
                columns::Check::Fine => Ok("audited"),
                columns::Check::Failed => Ok("failed"),
                columns::Check::Differs(why) => Err(why),
            },
        };
        let receipt = match status {
            Ok(status) => Receipt {
                episode,
                status,
                code: None,
                detail: None,
                score: row.score,
                skill: row.skill,
                success: row.success.map(|s| s != 0),
            },
            Err(why) => {
                self.refuted.entry(lease.id).or_insert_with(|| format!("{episode}: {why}"));
                Receipt { score: row.score, ..Receipt::refused(episode, "not_as_claimed", why) }
            }
        };
        self.keep(row, verdict);
        Ok(receipt)
    }

    /// Notes what is new, to be written with the rest, and told apart from what comes after it.
    fn keep(&mut self, row: EpisodeRow, verdict: Verdict) {
        let EpisodeRow { lease, number, score, skill, success, .. } = row;
        let before = Before { lease, number, digest: row.digest.clone(), score, skill, success };
        self.before.insert((lease, number), before);
        let log = if let Verdict::Flown { log, .. } = verdict { Some(log) } else { None };
        self.fresh.push((row, log));
    }

    /// A lease; none that was folded and is gone.
    async fn lease(&mut self, work: &mut Work, id: i64) -> Result<Option<LeaseRow>, TrainingError> {
        if let Some(row) = self.leases.get(&id) {
            return Ok(Some(row.clone()));
        }
        let row = leases::get(&mut work.conn, id).await?;
        if let Some(row) = &row {
            self.leases.insert(id, row.clone());
        }
        Ok(row)
    }

    /// Whether an episode that was not reported yet can be: its group is there, and was not folded around what rests on it.
    fn keeps(&self, lease: &LeaseRow, number: i64) -> bool {
        let key = (lease.id, number / lease.group_size.max(1));
        lease.folded == 0 && (self.known.contains_key(&key) || self.groups.contains_key(&key))
    }

    /// The group of an episode, to count into.
    fn group(&mut self, lease: &LeaseRow, number: i64) -> Result<&mut GroupRow, TrainingError> {
        let key = (lease.id, number / lease.group_size.max(1));
        if let Some(group) = self.known.remove(&key) {
            self.groups.insert(key, group);
        }
        let found = self.groups.get_mut(&key);
        found.ok_or_else(|| TrainingError::UnknownLease(lease.id.to_string()))
    }

    /// Compares an audited episode with what its columns claim; it is counted when all that is audited is in.
    fn compare(&mut self, lease: &LeaseRow, row: &EpisodeRow) -> Result<columns::Check, TrainingError> {
        let claimed = self.claimed.get(&(row.lease, row.number)).copied();
        let group = self.group(lease, row.number)?;
        let check = columns::check(claimed, group, row);
        if check == columns::Check::Fine {
            group.finished += 1;
            group.successes += row.success.unwrap_or(0);
        }
        Ok(check)
    }

    /// Counts an episode into its group and the sums; the receipt's word.
    async fn count(
        &mut self,
        work: &mut Work,
        lease: &LeaseRow,
        row: &EpisodeRow,
    ) -> Result<&'static str, TrainingError> {
        let (mind, _) = work.mind(&lease.run).await?;
        let newest = mind.policy_version.max(self.newest_policy).max(row.policy_version);
        let max_staleness = mind.settings.max_staleness;
        let group = self.group(lease, row.number)?;
        let counts = group.counts();
        let stale = max_staleness.is_some_and(|most| newest - row.policy_version > i64::from(most));
        let mut sums = Sums::default();
        if row.state == "failed" {
            group.failed += 1;
            sums.failed = 1;
        } else {
            group.finished += 1;
            group.successes += row.success.unwrap_or(0);
            group.evidence = i64::from(group.evidence != 0 && !stale);
            sums = Sums {
                episodes: 1,
                successes: row.success.unwrap_or(0),
                score: row.score.unwrap_or(0.0),
                skilled: i64::from(row.skill.is_some()),
                skill: row.skill.unwrap_or(0.0),
                ..sums
            };
        }
        let (key, evidence) = (sums::Key::of(group), group.evidence != 0);
        // An evaluation moves nothing, plain sums included.
        if counts {
            if row.state == "finished" {
                let fared = self.versions.entry((row.policy_version, key.task.clone())).or_default();
                *fared = (fared.0 + 1, fared.1 + sums.successes, fared.2 + sums.score);
            }
            self.newest_policy = newest;
            if row.state == "finished" {
                self.to_criticise.entry((lease.id, key.task.clone())).or_default().push(row.number);
            }
            self.sums.entry(key).or_default().add(&sums);
        }
        Ok(match (row.state.as_str(), evidence) {
            ("failed", _) => "failed",
            (_, true) => "counted",
            (_, false) => "stored",
        })
    }

    /// Writes groups and sums, closes groups that are whole and leases that are done.
    async fn close(self, work: &mut Work, run: &str) -> Result<Ended, TrainingError> {
        let mut ended = Ended::default();
        episodes::insert(&mut work.conn, &self.fresh).await?;
        sums::add(&mut work.conn, run, &self.sums).await?;
        for (key, sums) in &self.sums {
            work.count(run, &key.task).add(sums, key.level);
        }
        versions::add(&mut work.conn, run, &self.versions, work.now).await?;
        let jobs = self.to_criticise.iter().flat_map(|((lease, task), numbers)| {
            numbers.chunks(JOB).map(move |numbers| (task.as_str(), *lease, numbers))
        });
        let jobs: Vec<_> = jobs.collect();
        if !jobs.is_empty() {
            critiques::enqueue(&mut work.conn, run, &jobs).await?;
            work.wake_critique();
        }
        let (mind, conn) = work.mind(run).await?;
        if self.newest_policy > mind.policy_version {
            mind.policy_version = self.newest_policy;
            runs::set_policy_version(conn, run, self.newest_policy).await?;
        }
        let mut groups: BTreeMap<i64, Vec<GroupRow>> = BTreeMap::new();
        for ((lease, _), group) in self.groups {
            groups.entry(lease).or_default().push(group);
        }
        for (lease_id, groups) in groups {
            let Some(lease) = self.leases.get(&lease_id) else { continue };
            // What is audited ends when all of it is in.
            let whole =
                |group: &GroupRow| !lease.is_columns() && group.finished + group.failed >= lease.group_size;
            let (whole, open): (Vec<_>, Vec<_>) = groups.into_iter().partition(whole);
            ended.add(update_and_close(work, lease, (open, whole)).await?);
        }
        for lease in self.leases.values().filter(|lease| lease.is_columns() && lease.status == "active") {
            match self.refuted.get(&lease.id) {
                Some(why) => columns::refuse(work, lease, why).await?,
                None => ended.add(columns::settle(work, lease).await?),
            }
        }
        for lease in self.leases.values().filter(|lease| !lease.is_columns()) {
            if lease.status == "active" && leases::end_if_done(&mut work.conn, lease.id).await? {
                work.tell(&lease.run, &Happening::lease(lease, "done"))?;
            }
        }
        Ok(ended)
    }
}

#[expect(clippy::too_many_arguments, reason = "the columns of one row, gathered in one place")]
fn row(
    lease: i64,
    number: i64,
    late: bool,
    verdict: &Verdict,
    digest: Vec<u8>,
    policy_version: i64,
    metrics: Option<String>,
    at: i64,
) -> Result<EpisodeRow, TrainingError> {
    let mut row = EpisodeRow {
        lease,
        number,
        state: if late { "late" } else { "finished" }.to_owned(),
        digest,
        score: None,
        success: None,
        skill: None,
        floor: None,
        reference: None,
        planner: None,
        flown: None,
        policy_version,
        reason: None,
        metrics,
        at,
    };
    match verdict {
        Verdict::Flown { flown, skill, success, floor, reference, planner, .. } => {
            row.score = Some(flown.score);
            row.success = Some(i64::from(*success));
            row.skill = *skill;
            row.floor = Some(*floor);
            row.reference = Some(*reference);
            row.planner = Some(i64::from(*planner));
            row.flown = Some(to_json(&StoredFlown::from(*flown))?);
        }
        Verdict::Failed(reason) => {
            row.state = if late { "late" } else { "failed" }.to_owned();
            row.reason = Some(reason.clone());
        }
        Verdict::Refused { .. } | Verdict::Known { .. } => {}
    }
    Ok(row)
}

fn again(episode: String, before: &Before, digest: &[u8]) -> Receipt {
    if before.digest == digest {
        Receipt {
            episode,
            status: "duplicate",
            code: None,
            detail: None,
            score: before.score,
            skill: before.skill,
            success: before.success.map(|s| s != 0),
        }
    } else {
        Receipt::refused(
            episode,
            "conflict",
            "it was reported before, and differently; the first report stands".to_owned(),
        )
    }
}

/// What tells a repeat from a contradiction: the log, or the reason of the failure.
fn digest(verdict: &Verdict) -> Vec<u8> {
    let digest = match verdict {
        Verdict::Flown { log, .. } => log.digest,
        Verdict::Failed(reason) => store::digest(reason.as_bytes()),
        Verdict::Refused { detail, .. } => store::digest(detail.as_bytes()),
        Verdict::Known { .. } => store::digest(&[]),
    };
    digest.to_vec()
}
