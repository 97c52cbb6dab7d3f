//! Conditions of alerts: which rules hold for which runs now.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

use api_types::{ComparisonEstimates, Estimate, SuiteSection};
use clock::Millis;
use job_queue::JobQueue;
use sqlx::SqliteConnection;
use store::StoreError;
use store::alert_conditions::{self as conditions, SuccessiveEvaluations};
use store::alerts::{AlertRow, AlertRule, NewAlert};

use super::lost_workers::{ALL_WORKERS, LostWorkers};
use super::rules::AlertRules;
use crate::disk_space::free_bytes;
use crate::engine::error::ServiceError;
use crate::evaluations::read::{LoadedEvaluation, compare_sides, load_evaluation};

/// Time after which a run without results counts as ended.
const ENDED_AFTER_MS: Millis = 24 * 3_600_000;
/// Time over which missing episodes are counted.
const MISSING_WINDOW_MS: Millis = 15 * 60_000;
/// Least number of ended episodes of a task in that time.
const MIN_ENDED: i64 = 20;
/// Events that are older do not begin an alert, so that a new server does not report those of the past.
const EVENT_AGE_MS: Millis = 3_600_000;
/// Largest number of events of one kind in a check.
const MAX_EVENTS: i64 = 100;
/// Part of its limit below which a share, or above whose inverse a free space, ends its alert: one that is near the limit does not
/// begin and end again and again.
const END_AT: f64 = 0.8;

/// Finds the conditions that hold.
#[derive(Debug)]
pub(crate) struct ConditionReader {
    /// Rules that are on.
    pub(crate) rules: AlertRules,
    /// Folder of the database.
    pub(crate) folder: PathBuf,
    /// Queue that knows the workers on other machines.
    pub(crate) queue: Arc<dyn JobQueue>,
    lost_workers: LostWorkers,
    /// Comparisons of evaluations so far, by the later one, with the message if it is worse.
    compared: HashMap<i64, Option<String>>,
}

/// Alerts that last, by their keys.
pub(crate) type LastingAlerts = BTreeMap<AlertKey, i64>;

/// Key of an alert that lasts: no two such alerts have the same.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct AlertKey {
    /// Rule of the alert.
    pub(crate) rule: AlertRule,
    run: Option<String>,
    subject: String,
}

impl AlertKey {
    /// Key of a stored alert.
    pub(crate) fn of_row(row: &AlertRow) -> Self {
        Self { rule: row.rule, run: row.run.clone(), subject: row.subject.clone() }
    }

    /// Key of an alert that is to be stored.
    pub(crate) fn of(alert: &NewAlert) -> Self {
        Self { rule: alert.rule, run: alert.run.clone(), subject: alert.subject.clone() }
    }
}

/// Returns an alert of a run.
fn alert_of_run(rule: AlertRule, run: &str, subject: String, message: String) -> NewAlert {
    NewAlert { rule, run: Some(run.to_owned()), subject, message, is_event: false }
}

impl ConditionReader {
    /// Creates a reader that has compared no evaluations yet.
    pub(crate) fn new(rules: AlertRules, folder: PathBuf, queue: Arc<dyn JobQueue>) -> Self {
        Self { rules, folder, queue, lost_workers: LostWorkers::default(), compared: HashMap::new() }
    }

    /// Returns the alerts whose conditions hold, and the events of the last hour.
    pub(crate) async fn read(
        &mut self,
        conn: &mut SqliteConnection,
        lasting: &LastingAlerts,
        now: Millis,
    ) -> Result<Vec<NewAlert>, ServiceError> {
        let mut alerts = self.stalled_runs(conn, now).await?;
        alerts.extend(self.missing_shares(conn, lasting, now).await?);
        alerts.extend(self.low_disk(lasting));
        if self.rules.worker_lost {
            let all = AlertKey { rule: AlertRule::WorkerLost, run: None, subject: ALL_WORKERS.to_owned() };
            alerts.extend(self.lost_workers.find(&self.queue.status(), lasting.contains_key(&all)));
        }
        if self.rules.level_down {
            alerts.extend(level_drops(conn, now).await?);
        }
        if self.rules.evaluation_worse {
            alerts.extend(self.worse_evaluations(conn, now).await?);
        }
        Ok(alerts)
    }

    /// Returns the runs that had results within a day, but not lately.
    async fn stalled_runs(
        &self,
        conn: &mut SqliteConnection,
        now: Millis,
    ) -> Result<Vec<NewAlert>, StoreError> {
        let Some(after) = self.rules.no_results else { return Ok(Vec::new()) };
        let latest = now - i64::try_from(after.as_millis()).unwrap_or(i64::MAX);
        let runs = conditions::active_runs(conn, now - ENDED_AFTER_MS).await?;
        let stalled = runs.into_iter().filter(|run| run.last_results_at < latest);
        let minutes = after.as_secs() / 60;
        let message = format!("no results for {minutes} minutes; archive or pause a run that has ended");
        Ok(stalled
            .map(|run| alert_of_run(AlertRule::NoResults, &run.run, String::new(), message.clone()))
            .collect())
    }

    /// Returns the tasks of which too many episodes are missing.
    async fn missing_shares(
        &self,
        conn: &mut SqliteConnection,
        lasting: &LastingAlerts,
        now: Millis,
    ) -> Result<Vec<NewAlert>, StoreError> {
        let Some(limit) = self.rules.missing_share else { return Ok(Vec::new()) };
        let mut alerts = Vec::new();
        for active in conditions::active_runs(conn, now - MISSING_WINDOW_MS).await? {
            for ended in conditions::ended_episodes(conn, &active.run, now - MISSING_WINDOW_MS).await? {
                let all = ended.finished + ended.missing;
                let share = ended.missing as f64 / all.max(1) as f64;
                let percent = 100.0 * share;
                let message =
                    format!("{percent:.0} % of the latest {all} episodes of {} are missing", ended.task);
                let alert = alert_of_run(AlertRule::MissingShare, &active.run, ended.task, message);
                let is_lasting = lasting.contains_key(&AlertKey::of(&alert));
                if all >= MIN_ENDED && share > if is_lasting { END_AT * limit } else { limit } {
                    alerts.push(alert);
                }
            }
        }
        Ok(alerts)
    }

    /// Returns an alert if the disk of the database is nearly full.
    fn low_disk(&self, lasting: &LastingAlerts) -> Option<NewAlert> {
        let limit = self.rules.low_disk? as f64;
        let free = free_bytes(&self.folder)? as f64;
        let mib = |bytes: f64| bytes / f64::from(1 << 20);
        let alert = NewAlert {
            rule: AlertRule::LowDisk,
            run: None,
            subject: String::new(),
            message: format!("the disk of the database has {:.0} MiB left", mib(free)),
            is_event: false,
        };
        let is_lasting = lasting.contains_key(&AlertKey::of(&alert));
        (free < if is_lasting { limit / END_AT } else { limit }).then_some(alert)
    }

    /// Returns the evaluations of policy versions that are worse than those of the version before.
    async fn worse_evaluations(
        &mut self,
        conn: &mut SqliteConnection,
        now: Millis,
    ) -> Result<Vec<NewAlert>, ServiceError> {
        let recent = conditions::successive_evaluations(conn, now - EVENT_AGE_MS, MAX_EVENTS).await?;
        self.compared.retain(|newer, _| recent.iter().any(|pair| pair.newer == *newer));
        let mut alerts = Vec::new();
        for SuccessiveEvaluations { newer, older, run } in recent {
            let message = match self.compared.get(&newer) {
                Some(known) => known.clone(),
                None => {
                    let sides = (load_evaluation(conn, newer).await?, load_evaluation(conn, older).await?);
                    let found = tokio::task::spawn_blocking(move || worse_message(sides.0, sides.1)).await;
                    let found = found.unwrap_or(None); // evaluations whose comparison panics are not compared again
                    self.compared.insert(newer, found.clone());
                    found
                }
            };
            if let Some(message) = message {
                let subject = format!("eval-{newer}");
                let alert = alert_of_run(AlertRule::EvaluationWorse, &run, subject, message);
                alerts.push(NewAlert { is_event: true, ..alert });
            }
        }
        Ok(alerts)
    }
}

/// Returns the moves down of the last hour.
async fn level_drops(conn: &mut SqliteConnection, now: Millis) -> Result<Vec<NewAlert>, StoreError> {
    let drops = conditions::level_drops(conn, now - EVENT_AGE_MS, MAX_EVENTS).await?;
    let alert = |drop: conditions::LevelDrop| {
        let from = drop.from_level.map_or_else(String::new, |level| format!(" from level {level}"));
        let message = format!("{} went down{from} to level {}", drop.task, drop.to_level);
        let subject = format!("{} after outcome {}", drop.task, drop.seq);
        NewAlert { is_event: true, ..alert_of_run(AlertRule::LevelDown, &drop.run, subject, message) }
    };
    Ok(drops.into_iter().map(alert).collect())
}

/// Returns the message about an evaluation whose score is lower than that of the older one, with an interval below 0; `None` if
/// it is not, or if they cannot be compared.
fn worse_message(newer: LoadedEvaluation, older: LoadedEvaluation) -> Option<String> {
    let (newer_id, older_id) = (newer.row.id, older.row.id);
    let compared = compare_sides(&[newer], &[older]).ok()?;
    let rows = compared.report.comparisons.into_iter().filter(|row| row.part == SuiteSection::All);
    let worse = |row: ComparisonEstimates| row.comparison.score.map(|score| (row.task, score));
    let (task, Estimate { mean, low, high, .. }) = rows
        .filter_map(worse)
        .filter(|(_, score)| score.high < 0.0)
        .min_by(|a, b| a.1.high.total_cmp(&b.1.high))?;
    let of = if task == "all" { "all tasks".to_owned() } else { task };
    Some(format!(
        "eval-{newer_id} is worse than eval-{older_id} of an earlier policy version: its score on {of} differs by {mean:.3} \
         [{low:.3}, {high:.3}]"
    ))
}
