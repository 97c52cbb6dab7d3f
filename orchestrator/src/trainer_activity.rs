//! What trainers did in the last minutes: their requests, the time that they waited for leases, and the episodes that they reported.
//! The numbers are in memory and begin anew with the server.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use moka::sync::Cache;
use parking_lot::Mutex;

/// Time over which activity is summed.
pub const WINDOW: Duration = Duration::from_mins(5);
/// Duration of a bucket of the window.
const BUCKET: Duration = Duration::from_secs(10);
/// Time after which a trainer without requests is forgotten.
const FORGET_AFTER: Duration = Duration::from_hours(1);
/// Largest number of trainers that are remembered.
const MAX_TRAINERS: u64 = 4_096;
/// Longest name that a trainer gives itself, in characters.
pub const MAX_NAME_CHARS: usize = 64;

/// Identity of a trainer in a run.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct TrainerKey {
    /// Id of the run.
    pub run: String,
    /// Token or address; none on a server that does not distinguish its clients.
    pub client: Option<Arc<str>>,
    /// Name that the trainer gives itself, such as `host:pid`.
    pub name: Option<String>,
}

/// Request of a trainer that was answered.
#[derive(Debug, Clone, Copy)]
pub struct TrainerRequest {
    /// Time until the answer.
    pub duration: Duration,
    /// True if it asked for a lease.
    pub is_lease: bool,
    /// True if it was refused or failed.
    pub is_error: bool,
    /// Leases and episodes in the answer.
    pub work: TrainerWork,
}

/// Leases that a trainer received, or episodes that it reported, by one request.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TrainerWork {
    /// Number of received leases.
    pub leases: u64,
    /// Number of reported episodes.
    pub episodes: u64,
    /// Version of the trainer's policy; none if the request did not say.
    pub policy_version: Option<i64>,
}

/// Activity of a trainer in the window.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainerSummary {
    /// Identity of the trainer.
    pub key: TrainerKey,
    /// Time since its latest request.
    pub idle: Duration,
    /// Time that the sums cover: the window, or less for a trainer that came later.
    pub covered: Duration,
    /// Number of all requests.
    pub requests: u64,
    /// Number of these that were refused or failed.
    pub errors: u64,
    /// Number of leases that it received.
    pub leases: u64,
    /// Time that it waited for leases.
    pub lease_wait: Duration,
    /// Number of reported episodes.
    pub episodes: u64,
    /// Newest version of its policy; none if it did not say.
    pub policy_version: Option<i64>,
}

/// Activity of all trainers.
#[derive(Debug)]
pub struct TrainerActivity {
    trainers: Cache<TrainerKey, Arc<Mutex<Activity>>>,
    started: Instant,
}

#[derive(Debug)]
struct Activity {
    first: Duration,
    last: Duration,
    policy_version: Option<i64>,
    buckets: VecDeque<Bucket>,
}

#[derive(Debug, Default)]
struct Bucket {
    /// Number of the bucket since the start.
    number: u64,
    requests: u64,
    errors: u64,
    leases: u64,
    lease_wait: Duration,
    episodes: u64,
}

impl Default for TrainerActivity {
    fn default() -> Self {
        let trainers = Cache::builder().max_capacity(MAX_TRAINERS).time_to_idle(FORGET_AFTER).build();
        Self { trainers, started: Instant::now() }
    }
}

impl TrainerActivity {
    /// Records a request that was answered now.
    pub fn record(&self, key: TrainerKey, request: TrainerRequest) {
        self.record_at(key, request, self.started.elapsed());
    }

    fn record_at(&self, key: TrainerKey, request: TrainerRequest, at: Duration) {
        let begun = at.saturating_sub(request.duration);
        let new = || {
            Arc::new(Mutex::new(Activity {
                first: begun,
                last: at,
                policy_version: None,
                buckets: VecDeque::new(),
            }))
        };
        self.trainers.get_with(key, new).lock().add(request, at);
    }

    /// Returns the activity of the trainers of a run, the latest first.
    #[must_use]
    pub fn of_run(&self, run: &str) -> Vec<TrainerSummary> {
        self.of_run_at(run, self.started.elapsed())
    }

    fn of_run_at(&self, run: &str, now: Duration) -> Vec<TrainerSummary> {
        let of_run = self.trainers.iter().filter(|(key, _)| key.run == run);
        let mut found: Vec<TrainerSummary> =
            of_run.map(|(key, activity)| activity.lock().summarize((*key).clone(), now)).collect();
        found.sort_by(|a, b| a.idle.cmp(&b.idle).then_with(|| a.key.name.cmp(&b.key.name)));
        found
    }
}

/// Number of the bucket of a time.
fn bucket_of(at: Duration) -> u64 {
    at.as_secs() / BUCKET.as_secs()
}

/// Number of the first bucket of the window that ends at a time.
fn first_bucket(now: Duration) -> u64 {
    (bucket_of(now) + 1).saturating_sub(WINDOW.as_secs() / BUCKET.as_secs())
}

impl Activity {
    fn add(&mut self, request: TrainerRequest, at: Duration) {
        let number = bucket_of(at);
        self.buckets.retain(|bucket| bucket.number >= first_bucket(at));
        if self.buckets.back().is_none_or(|bucket| bucket.number < number) {
            self.buckets.push_back(Bucket { number, ..Bucket::default() });
        }
        if let Some(bucket) = self.buckets.back_mut() {
            bucket.requests += 1;
            bucket.errors += u64::from(request.is_error);
            bucket.leases += request.work.leases;
            bucket.episodes += request.work.episodes;
            bucket.lease_wait += if request.is_lease { request.duration } else { Duration::ZERO };
        }
        self.last = self.last.max(at);
        self.policy_version = self.policy_version.max(request.work.policy_version);
    }

    fn summarize(&self, key: TrainerKey, now: Duration) -> TrainerSummary {
        let begin = Duration::from_secs(first_bucket(now) * BUCKET.as_secs());
        let mut summary = TrainerSummary {
            key,
            idle: now.saturating_sub(self.last),
            covered: now.saturating_sub(begin.max(self.first)),
            requests: 0,
            errors: 0,
            leases: 0,
            lease_wait: Duration::ZERO,
            episodes: 0,
            policy_version: self.policy_version,
        };
        for bucket in self.buckets.iter().filter(|bucket| bucket.number >= first_bucket(now)) {
            summary.requests += bucket.requests;
            summary.errors += bucket.errors;
            summary.leases += bucket.leases;
            summary.lease_wait += bucket.lease_wait;
            summary.episodes += bucket.episodes;
        }
        summary
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: fn(u64) -> Duration = Duration::from_secs;

    fn key(run: &str, name: &str) -> TrainerKey {
        TrainerKey { run: run.to_owned(), client: None, name: Some(name.to_owned()) }
    }

    fn lease(seconds: u64, version: i64) -> TrainerRequest {
        let work = TrainerWork { leases: 1, policy_version: Some(version), ..TrainerWork::default() };
        TrainerRequest { duration: S(seconds), is_lease: true, is_error: false, work }
    }

    fn report(episodes: u64, is_error: bool) -> TrainerRequest {
        let work = TrainerWork { episodes, ..TrainerWork::default() };
        TrainerRequest { duration: S(1), is_lease: false, is_error, work }
    }

    #[test]
    fn activity_is_summed_over_the_time_since_the_first_request() {
        let activity = TrainerActivity::default();
        activity.record_at(key("r", "a"), lease(2, 4), S(12));
        activity.record_at(key("r", "a"), report(5, false), S(15));
        activity.record_at(key("r", "a"), report(0, true), S(31));
        activity.record_at(key("other", "a"), report(7, false), S(31));
        let [summary] = &activity.of_run_at("r", S(40))[..] else { panic!("one trainer") };
        assert_eq!((summary.requests, summary.errors, summary.leases, summary.episodes), (3, 1, 1, 5));
        assert_eq!((summary.lease_wait, summary.covered, summary.idle), (S(2), S(30), S(9)));
        assert_eq!(summary.policy_version, Some(4));
    }

    #[test]
    fn old_activity_leaves_the_window() {
        let activity = TrainerActivity::default();
        activity.record_at(key("r", "a"), report(5, false), S(5));
        activity.record_at(key("r", "b"), report(1, false), S(200));
        activity.record_at(key("r", "a"), report(2, false), S(305));
        let [latest, older] = &activity.of_run_at("r", S(309))[..] else { panic!("two trainers") };
        assert_eq!((latest.key.name.as_deref(), latest.episodes), (Some("a"), 2));
        assert_eq!((older.key.name.as_deref(), older.episodes), (Some("b"), 1));
        assert_eq!(latest.covered, S(299));
        assert_eq!(activity.of_run_at("r", S(900))[0].requests, 0);
    }
}
