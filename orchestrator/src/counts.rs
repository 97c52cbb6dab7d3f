//! What is counted: one function for each thing, so that names and labels stand in one place. docs/operations.md lists them.

use std::time::Duration;

use axum::http::{Method, StatusCode};
use metrics::{Unit, counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram};

/// Says what each name means.
pub fn describe() {
    describe_counter!("sparring_http_requests_total", "Requests answered, by method, route and status.");
    describe_histogram!("sparring_http_request_seconds", Unit::Seconds, "How long requests took, by route.");
    describe_counter!(
        "sparring_leases_total",
        "Leases by what became of them: taken, done, released, expired."
    );
    describe_counter!("sparring_results_total", "Reported episodes by what became of them.");
    describe_counter!(
        "sparring_mismatches_total",
        "Audited episodes that did not replay to what was claimed."
    );
    describe_counter!("sparring_proposals_total", "Scenarios proposed, by strategy.");
    describe_counter!("sparring_moves_total", "Level moves, by task and direction.");
    describe_counter!("sparring_layouts_total", "Layouts, by what the gate said of them.");
    describe_counter!("sparring_rollout_groups_total", "Groups that workers flew and pushed to a feed.");
    describe_counter!("sparring_folded_episodes_total", "Episodes folded, past what their run keeps whole.");
    describe_counter!("sparring_commit_failures_total", "Commits that failed; nothing of them was kept.");
    describe_histogram!("sparring_commit_seconds", Unit::Seconds, "How long commits took, to the disk.");
    describe_histogram!("sparring_commit_changes", "Changes that were committed together.");
    describe_gauge!("sparring_writable", "1 where the database could be written when this was asked for.");
    describe_gauge!("sparring_writer_queue", "Changes that wait for the writer, by queue.");
    describe_gauge!("sparring_critique_waiting", "Episodes that wait for their critique.");
    describe_gauge!("sparring_sessions", "Sessions that fly on the server.");
    describe_gauge!("sparring_sessions_limit", "Sessions that may.");
    describe_gauge!("sparring_connections", "Connections that are open.");
    describe_gauge!("sparring_database_bytes", "The database, by what is used and what is free in it.");
    describe_gauge!("sparring_level", "The level of a task of a run.");
    describe_gauge!(
        "sparring_mastery",
        "Mean of the posterior over success on contested scenarios at that level."
    );
    describe_gauge!("sparring_workers", "Workers that are busy, by job.");
    describe_gauge!("sparring_build_info", "1, with the version.");
    gauge!("sparring_build_info", "version" => env!("CARGO_PKG_VERSION")).set(1.0);
    begin();
}

/// What has not happened yet is 0, not missing: a rate of it can be asked for from the start.
fn begin() {
    for state in ["taken", "done", "released", "expired"] {
        counter!("sparring_leases_total", "state" => state).absolute(0);
    }
    for status in ["counted", "duplicate", "rejected"] {
        counter!("sparring_results_total", "status" => status, "code" => "").absolute(0);
    }
    counter!("sparring_mismatches_total").absolute(0);
    counter!("sparring_rollout_groups_total").absolute(0);
    counter!("sparring_folded_episodes_total").absolute(0);
    counter!("sparring_commit_failures_total").absolute(0);
    gauge!("sparring_connections").increment(0.0);
}

/// A request was answered.
pub fn request(method: &Method, route: String, status: StatusCode, took: Duration) {
    histogram!("sparring_http_request_seconds", "route" => route.clone()).record(took);
    // A method that nobody knows is whatever somebody writes.
    let method = match method.as_str() {
        known @ ("GET" | "HEAD" | "POST" | "PUT" | "DELETE" | "PATCH" | "OPTIONS") => known.to_owned(),
        _ => "other".to_owned(),
    };
    let status = status.as_str().to_owned();
    counter!("sparring_http_requests_total", "method" => method, "route" => route, "status" => status)
        .increment(1);
}

/// A lease came to something.
pub fn lease(state: &str) {
    counter!("sparring_leases_total", "state" => state.to_owned()).increment(1);
}

/// An episode was reported.
pub fn result(status: &'static str, code: Option<&'static str>) {
    counter!("sparring_results_total", "status" => status, "code" => code.unwrap_or("")).increment(1);
    if code == Some("not_as_claimed") {
        counter!("sparring_mismatches_total").increment(1);
    }
}

/// A strategy proposed.
pub fn proposals(strategy: String, count: u64) {
    counter!("sparring_proposals_total", "strategy" => strategy).increment(count);
}

/// A level moved.
pub fn level_move(task: String, way: String) {
    counter!("sparring_moves_total", "task" => task, "move" => way).increment(1);
}

/// The gate spoke.
pub fn layouts(verdict: &str, count: i64) {
    counter!("sparring_layouts_total", "verdict" => verdict.to_owned()).increment(count.unsigned_abs());
}

/// A group was flown and pushed.
pub fn rollout_group() {
    counter!("sparring_rollout_groups_total").increment(1);
}

/// Episodes were folded.
pub fn folded(episodes: u64) {
    counter!("sparring_folded_episodes_total").increment(episodes);
}

/// A batch of changes was committed, or could not be.
pub fn commit(changes: usize, took: Duration, stands: bool) {
    histogram!("sparring_commit_changes").record(changes as f64);
    histogram!("sparring_commit_seconds").record(took);
    if !stands {
        counter!("sparring_commit_failures_total").increment(1);
    }
}

/// Whether the database can be written.
pub fn writable(can: bool) {
    gauge!("sparring_writable").set(f64::from(u8::from(can)));
}

/// What waits for the writer.
pub fn waiting(urgent: usize, bulk: usize) {
    gauge!("sparring_writer_queue", "queue" => "urgent").set(urgent as f64);
    gauge!("sparring_writer_queue", "queue" => "bulk").set(bulk as f64);
}

/// What waits for the critique.
pub fn critiques(episodes: i64) {
    gauge!("sparring_critique_waiting").set(episodes as f64);
}

/// Sessions that fly, and that may.
pub fn sessions(active: usize, most: usize) {
    gauge!("sparring_sessions").set(active as f64);
    gauge!("sparring_sessions_limit").set(most as f64);
}

/// A connection is open as long as this lives.
#[derive(Debug)]
pub struct Connected(());

impl Connected {
    /// One more.
    #[must_use]
    pub fn begin() -> Self {
        gauge!("sparring_connections").increment(1.0);
        Self(())
    }
}

impl Drop for Connected {
    fn drop(&mut self) {
        gauge!("sparring_connections").decrement(1.0);
    }
}

/// The database's size.
pub fn database(bytes: i64, free: i64) {
    gauge!("sparring_database_bytes", "pages" => "used").set((bytes - free) as f64);
    gauge!("sparring_database_bytes", "pages" => "free").set(free as f64);
}

/// Where a task of a run stands.
pub fn standing(run: &str, task: &str, level: Option<u32>, mastery: Option<f64>) {
    let labels = [("run", run.to_owned()), ("task", task.to_owned())];
    if let Some(level) = level {
        gauge!("sparring_level", &labels).set(f64::from(level));
    }
    if let Some(mastery) = mastery {
        gauge!("sparring_mastery", &labels).set(mastery);
    }
}

/// A worker is busy as long as this lives.
#[derive(Debug)]
pub struct Busy(&'static str);

impl Busy {
    /// One of this job.
    #[must_use]
    pub fn with(job: &'static str) -> Self {
        gauge!("sparring_workers", "job" => job).increment(1.0);
        Self(job)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        gauge!("sparring_workers", "job" => self.0).decrement(1.0);
    }
}
