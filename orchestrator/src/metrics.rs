//! Metrics of the service: one function or type for each, so that names and labels are in one place. `docs/guides/operations.md` lists
//! them.

use std::time::Duration;

use api_types::{ReceiptStatus, RefusalCode};
use axum::http::{Method, StatusCode};
use curriculum::Mastery;
use job_queue::status::{QueueStatus, WorkerState};
use jobs::JobKind;
use metrics::{Unit, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram};
use serde::Serialize;
use store::alerts::AlertRule;

/// Event in the life of a lease: the `state` of its events, and the label of `sparring_leases_total`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LeaseEvent {
    /// The lease was created.
    Created,
    /// The client renewed the lease.
    Renewed,
    /// All groups of the lease are closed.
    Done,
    /// The client returned the lease.
    Released,
    /// The lease has expired.
    Expired,
}

impl LeaseEvent {
    /// All values, in the order of their declaration.
    pub const ALL: [Self; 5] = [Self::Created, Self::Renewed, Self::Done, Self::Released, Self::Expired];

    /// The word that events and metrics show.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Created => "created",
            Self::Renewed => "renewed",
            Self::Done => "done",
            Self::Released => "released",
            Self::Expired => "expired",
        }
    }
}

/// Describes all metrics, and registers counters at 0.
pub fn register() {
    describe_counter!("sparring_http_requests_total", "Responses, by method, route and status.");
    describe_histogram!(
        "sparring_http_request_seconds",
        Unit::Seconds,
        "Duration of requests in seconds, by route."
    );
    describe_counter!(
        "sparring_leases_total",
        "Lease events, by kind: created, renewed, done, released, expired."
    );
    describe_counter!("sparring_results_total", "Reported episodes, by status and code of their receipts.");
    describe_counter!("sparring_mismatches_total", "Audited episodes whose replay contradicts the claim.");
    describe_counter!("sparring_proposals_total", "Scenarios proposed, by strategy.");
    describe_counter!("sparring_moves_total", "Level moves, by task and direction.");
    describe_counter!("sparring_layouts_total", "Designed layouts, by the verdict of the gate.");
    describe_counter!("sparring_rollout_groups_total", "Groups that the server's workers pushed to a feed.");
    describe_counter!("sparring_compacted_episodes_total", "Episodes of compacted leases.");
    describe_counter!("sparring_commit_failures_total", "Commits that failed and were undone.");
    describe_histogram!(
        "sparring_commit_seconds",
        Unit::Seconds,
        "Duration of commits in seconds, including the sync to disk."
    );
    describe_histogram!("sparring_commit_changes", "Number of changes in a commit.");
    describe_gauge!("sparring_writable", "1 if the database could be written at the last check, else 0.");
    describe_gauge!("sparring_writer_queue", "Changes that wait for the writer, by queue.");
    describe_gauge!("sparring_critique_waiting", "Episodes that wait for their critique.");
    describe_gauge!("sparring_sessions", "Active sessions.");
    describe_gauge!("sparring_sessions_limit", "Maximum number of active sessions.");
    describe_gauge!("sparring_connections", "Open connections.");
    describe_gauge!("sparring_database_bytes", "Size of the database in bytes, by used and free pages.");
    describe_gauge!("sparring_level", "Current level, by run and task.");
    describe_gauge!(
        "sparring_mastery",
        "Mean of the posterior over success on contested scenarios at the current level, missing episodes counted as failures, by run \
         and task."
    );
    describe_gauge!(
        "sparring_mastery_low",
        "10 % quantile of the same posterior, missing episodes counted as failures, by run and task."
    );
    describe_gauge!(
        "sparring_mastery_high",
        "90 % quantile of the same posterior, missing episodes counted as successes, by run and task."
    );
    describe_gauge!(
        "sparring_missing_share",
        "Share of the outcomes behind the mastery that are missing, by run and task."
    );
    describe_gauge!("sparring_workers", "Busy workers, by job.");
    describe_operation();
    describe_gauge!("sparring_build_info", "Always 1; the label is the version of the server.");
    gauge!("sparring_build_info", "version" => env!("CARGO_PKG_VERSION")).set(1.0);
    register_zeros();
}

/// Describes the metrics of alerts, of feeds on NATS and of workers on other machines.
fn describe_operation() {
    describe_gauge!("sparring_alerts", "Alerts that last, by rule.");
    describe_counter!(
        "sparring_alert_messages_total",
        "Attempts to tell the webhook of an alert, by outcome: sent, failed."
    );
    describe_gauge!("sparring_feed_unpublished", "Groups of feeds on NATS that are not published yet.");
    describe_gauge!("sparring_remote_workers", "Workers on other machines, by state.");
    describe_gauge!("sparring_remote_degraded", "1 if --nats is set and no worker does jobs, else 0.");
    describe_gauge!("sparring_remote_jobs_waiting", "Jobs that were sent to workers and have no result yet.");
    describe_counter!("sparring_remote_jobs_total", "Jobs since the start, by where they were done.");
    describe_counter!("sparring_remote_kind_jobs_total", "Jobs that workers did since the start, by kind.");
    describe_counter!("sparring_remote_results_ignored_total", "Results of workers that were ignored.");
    describe_counter!("sparring_remote_verified_total", "Results of workers that the server recomputed.");
    describe_counter!("sparring_worker_jobs_total", "Accepted jobs, by worker.");
    describe_counter!("sparring_worker_errors_total", "Jobs that failed or had wrong results, by worker.");
}

/// Registers counters at 0: a rate of a counter that is missing cannot be queried.
fn register_zeros() {
    for event in LeaseEvent::ALL {
        counter!("sparring_leases_total", "state" => event.as_str()).absolute(0);
    }
    for status in ReceiptStatus::ALL.iter().copied() {
        counter!("sparring_results_total", "status" => status.as_str(), "code" => "").absolute(0);
    }
    for outcome in ["sent", "failed"] {
        counter!("sparring_alert_messages_total", "outcome" => outcome).absolute(0);
    }
    counter!("sparring_mismatches_total").absolute(0);
    counter!("sparring_rollout_groups_total").absolute(0);
    counter!("sparring_compacted_episodes_total").absolute(0);
    counter!("sparring_commit_failures_total").absolute(0);
    gauge!("sparring_connections").increment(0.0);
}

/// Sets the numbers of alerts that last to those of these rules.
pub fn set_alerts(lasting: impl Iterator<Item = AlertRule>) {
    let rules: Vec<AlertRule> = lasting.collect();
    for rule in AlertRule::ALL {
        let count = rules.iter().filter(|other| *other == rule).count();
        gauge!("sparring_alerts", "rule" => rule.as_str()).set(count as f64);
    }
}

/// Counts an attempt to tell the webhook of an alert.
pub fn record_alert_message(is_sent: bool) {
    let outcome = if is_sent { "sent" } else { "failed" };
    counter!("sparring_alert_messages_total", "outcome" => outcome).increment(1);
}

/// Counts an HTTP request that was answered.
pub fn record_request(method: &Method, route: String, status: StatusCode, duration: Duration) {
    histogram!("sparring_http_request_seconds", "route" => route.clone()).record(duration);
    // Clients may send any method: unknown ones share a label.
    let method = match method.as_str() {
        known @ ("GET" | "HEAD" | "POST" | "PUT" | "DELETE" | "PATCH" | "OPTIONS") => known.to_owned(),
        _ => "other".to_owned(),
    };
    let status = status.as_str().to_owned();
    counter!("sparring_http_requests_total", "method" => method, "route" => route, "status" => status)
        .increment(1);
}

/// Counts an event of a lease.
pub fn record_lease(event: LeaseEvent) {
    counter!("sparring_leases_total", "state" => event.as_str()).increment(1);
}

/// Counts a reported episode, by the status and code of its receipt.
pub fn record_result(status: ReceiptStatus, code: Option<RefusalCode>) {
    counter!("sparring_results_total", "status" => status.as_str(), "code" => code.map_or("", RefusalCode::as_str)).increment(1);
    if code == Some(RefusalCode::ColumnsMismatch) {
        counter!("sparring_mismatches_total").increment(1);
    }
}

/// Counts proposals of a strategy.
pub fn record_proposals(strategy: String, count: u64) {
    counter!("sparring_proposals_total", "strategy" => strategy).increment(count);
}

/// Counts a level move of a task.
pub fn record_level_move(task: String, direction: String) {
    counter!("sparring_moves_total", "task" => task, "move" => direction).increment(1);
}

/// Counts designed layouts with one verdict of the gate.
pub fn record_layouts(verdict: &str, count: i64) {
    counter!("sparring_layouts_total", "verdict" => verdict.to_owned()).increment(count.unsigned_abs());
}

/// Counts a group that a worker pushed to a feed.
pub fn record_rollout_group() {
    counter!("sparring_rollout_groups_total").increment(1);
}

/// Counts episodes of compacted leases.
pub fn record_compacted(episodes: u64) {
    counter!("sparring_compacted_episodes_total").increment(episodes);
}

/// Counts a commit of `changes` changes, successful or not.
pub fn record_commit(changes: usize, duration: Duration, succeeded: bool) {
    histogram!("sparring_commit_changes").record(changes as f64);
    histogram!("sparring_commit_seconds").record(duration);
    if !succeeded {
        counter!("sparring_commit_failures_total").increment(1);
    }
}

/// Sets whether the database can be written.
pub fn set_writable(is_writable: bool) {
    gauge!("sparring_writable").set(f64::from(u8::from(is_writable)));
}

/// Sets how many changes wait for the writer.
pub fn set_writer_queue(urgent: usize, bulk: usize) {
    gauge!("sparring_writer_queue", "queue" => "urgent").set(urgent as f64);
    gauge!("sparring_writer_queue", "queue" => "bulk").set(bulk as f64);
}

/// Sets how many episodes wait for their critique.
pub fn set_critique_waiting(episodes: i64) {
    gauge!("sparring_critique_waiting").set(episodes as f64);
}

/// Sets how many sessions are active, and how many may be.
pub fn set_sessions(active: usize, limit: usize) {
    gauge!("sparring_sessions").set(active as f64);
    gauge!("sparring_sessions_limit").set(limit as f64);
}

/// Sets the size of the database's pages, bytes.
pub fn set_database_bytes(all: i64, free: i64) {
    gauge!("sparring_database_bytes", "pages" => "used").set((all - free) as f64);
    gauge!("sparring_database_bytes", "pages" => "free").set(free as f64);
}

/// Sets level and mastery of a task of a run.
pub fn set_task(run: &str, task: &str, level: Option<u32>, mastery: Option<&Mastery>) {
    let labels = [("run", run.to_owned()), ("task", task.to_owned())];
    if let Some(level) = level {
        gauge!("sparring_level", &labels).set(f64::from(level));
    }
    if let Some(mastery) = mastery {
        gauge!("sparring_mastery", &labels).set(mastery.mean);
        gauge!("sparring_mastery_low", &labels).set(mastery.q10);
        gauge!("sparring_mastery_high", &labels).set(mastery.q90);
        gauge!("sparring_missing_share", &labels).set(mastery.missing);
    }
}

/// Counts an open connection while it lives.
#[derive(Debug)]
pub struct ConnectionGuard(());

impl ConnectionGuard {
    /// Counts one more open connection.
    #[must_use]
    pub fn new() -> Self {
        gauge!("sparring_connections").increment(1.0);
        Self(())
    }
}

impl Default for ConnectionGuard {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        gauge!("sparring_connections").decrement(1.0);
    }
}

/// Counts a busy worker while it lives.
#[derive(Debug)]
pub struct BusyGuard(&'static str);

impl BusyGuard {
    /// Counts one worker of this job.
    #[must_use]
    pub fn new(job: &'static str) -> Self {
        gauge!("sparring_workers", "job" => job).increment(1.0);
        Self(job)
    }
}

impl Drop for BusyGuard {
    fn drop(&mut self) {
        gauge!("sparring_workers", "job" => self.0).decrement(1.0);
    }
}

/// Sets the metrics of workers on other machines; nothing is set for a server without them.
pub fn set_remote_workers(status: &QueueStatus) {
    let QueueStatus { is_distributed: true, degraded, waiting, workers, counters } = status else { return };
    gauge!("sparring_remote_jobs_waiting").set(*waiting as f64);
    gauge!("sparring_remote_degraded").set(f64::from(u8::from(degraded.is_some())));
    for state in [WorkerState::Active, WorkerState::Stalled, WorkerState::Refused, WorkerState::Expelled] {
        let count = workers.iter().filter(|worker| worker.state == state).count();
        gauge!("sparring_remote_workers", "state" => state.as_str()).set(count as f64);
    }
    for (place, count) in [("worker", counters.done_remotely), ("server", counters.done_locally)] {
        counter!("sparring_remote_jobs_total", "place" => place).absolute(count);
    }
    for (kind, count) in JobKind::ALL.into_iter().zip(counters.done_by_kind) {
        counter!("sparring_remote_kind_jobs_total", "kind" => kind.as_str()).absolute(count);
    }
    counter!("sparring_remote_results_ignored_total").absolute(counters.ignored_results);
    counter!("sparring_remote_verified_total").absolute(counters.verified_items);
    for worker in workers {
        counter!("sparring_worker_jobs_total", "worker" => worker.id.clone()).absolute(worker.jobs);
        counter!("sparring_worker_errors_total", "worker" => worker.id.clone()).absolute(worker.errors);
    }
}

/// Sets the number of groups that wait to be published on NATS.
pub fn set_unpublished_groups(groups: usize) {
    gauge!("sparring_feed_unpublished").set(groups as f64);
}

#[cfg(test)]
mod tests {
    use metrics_exporter_prometheus::PrometheusBuilder;

    use super::*;

    #[test]
    fn every_label_of_results_and_leases_starts_at_zero() {
        let recorder = PrometheusBuilder::new().build_recorder();
        metrics::with_local_recorder(&recorder, register);
        let rendered = recorder.handle().render();
        let count = |name: &str| rendered.lines().filter(|line| line.starts_with(name)).count();
        for status in ReceiptStatus::ALL.iter().copied() {
            let line = format!("sparring_results_total{{status=\"{}\",code=\"\"}} 0", status.as_str());
            assert!(rendered.lines().any(|shown| shown == line), "{line} is missing in\n{rendered}");
        }
        assert_eq!(count("sparring_results_total{"), ReceiptStatus::ALL.len());
        assert_eq!(count("sparring_leases_total{"), LeaseEvent::ALL.len());
    }
}
