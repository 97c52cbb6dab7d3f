//! Estimates of the time that jobs take on this machine. A job that is cheaper to do than to send stays here.

use std::collections::HashMap;
use std::time::Duration;

use jobs::{JobKind, JobPayload};
use parking_lot::Mutex;

/// Weight of a new measurement.
const WEIGHT: f64 = 0.2;
/// Largest number of tasks that are remembered.
const MAX_TASKS: usize = 1_000;

/// Mean time of an item in seconds, by kind and task.
#[derive(Debug, Default)]
pub(super) struct CostEstimates(Mutex<HashMap<(JobKind, String), f64>>);

impl CostEstimates {
    /// Adds a measurement of a job that ran on `threads` threads.
    pub(super) fn add(&self, job: &JobPayload, threads: usize, duration: Duration) {
        let items = job.len();
        if items == 0 {
            return;
        }
        let parallel = if job.kind() == JobKind::Prepare { 1 } else { threads.min(items).max(1) };
        let seconds = duration.as_secs_f64() * parallel as f64 / items as f64;
        let mut known = self.0.lock();
        let key = (job.kind(), job.task().to_owned());
        if known.len() >= MAX_TASKS && !known.contains_key(&key) {
            known.clear();
        }
        let mean = known.entry(key).or_insert(seconds);
        *mean += WEIGHT * (seconds - *mean);
    }

    /// Returns the expected time of a job on one thread; `None` if no job of its kind and task was measured.
    pub(super) fn of(&self, job: &JobPayload) -> Option<Duration> {
        let known = self.0.lock();
        let seconds = known.get(&(job.kind(), job.task().to_owned()))?;
        Duration::try_from_secs_f64(seconds * job.len() as f64).ok()
    }
}
