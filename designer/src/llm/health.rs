//! How the endpoint does, for people.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::time::Instant;

use super::{LlmError, Spent};

/// Latencies remembered.
const REMEMBERED: usize = 256;

/// How the endpoint does. Nothing in it is secret.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Health {
    /// The endpoint's host.
    pub host: String,
    /// The model.
    pub model: String,
    /// The circuit breaker: `closed` (calls are made), `open` (none is), `half_open` (one is, to see).
    pub breaker: &'static str,
    /// Why it is open.
    pub why: Option<String>,
    /// Seconds until it is tried again.
    pub retry_in_s: Option<f64>,
    /// Calls that failed in a row.
    pub failures_in_a_row: u32,
    /// How answers are held to a schema, as learned: `json_schema`, `json_object` or `text`.
    pub mode: &'static str,
    /// What was spent today (UTC).
    pub today: Spent,
    /// Tokens that may be spent in a day.
    pub tokens_per_day: Option<u64>,
    /// What a day may cost.
    pub cost_per_day: Option<f64>,
    /// Tokens that a run may use.
    pub tokens_per_run: Option<u64>,
    /// Calls made since the start, further tries not counted.
    pub calls: u64,
    /// Those that failed.
    pub failed: u64,
    /// Further tries.
    pub retries: u64,
    /// The last failure, and how many seconds ago it was.
    pub last_error: Option<LastError>,
    /// How long calls took that succeeded.
    pub latency: Option<Latency>,
}

/// The last failure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LastError {
    /// The word it is counted by.
    pub kind: &'static str,
    /// In a sentence.
    pub words: String,
    /// When, milliseconds since 1970 UTC.
    pub at_ms: i64,
}

/// How long calls took that succeeded: the last 256 of them, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Latency {
    /// The newest.
    pub last_s: f64,
    /// The median.
    pub median_s: f64,
    /// 95 % took no longer.
    pub p95_s: f64,
}

#[derive(Debug, Default)]
struct Counts {
    calls: u64,
    failed: u64,
    retries: u64,
    last: Option<LastError>,
    latencies: VecDeque<f64>,
    answered: Option<Instant>,
}

/// Counts what happens.
#[derive(Debug, Default)]
pub(super) struct Meter(Mutex<Counts>);

/// What was counted.
pub(super) struct Counted {
    pub(super) calls: u64,
    pub(super) failed: u64,
    pub(super) retries: u64,
    pub(super) last: Option<LastError>,
    pub(super) latency: Option<Latency>,
}

impl Meter {
    fn counts(&self) -> MutexGuard<'_, Counts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn retried(&self) {
        self.counts().retries += 1;
    }

    pub(super) fn ended(&self, result: Result<Duration, &LlmError>, at_ms: i64) {
        let mut counts = self.counts();
        counts.calls += 1;
        match result {
            Ok(took) => {
                counts.answered = Some(Instant::now());
                if counts.latencies.len() == REMEMBERED {
                    counts.latencies.pop_front();
                }
                counts.latencies.push_back(took.as_secs_f64());
            }
            Err(error) => {
                counts.failed += 1;
                counts.last = Some(LastError { kind: error.word(), words: error.to_string(), at_ms });
            }
        }
    }

    /// Whether a call succeeded within so long a time before now.
    pub(super) fn answered_within(&self, time: Duration) -> bool {
        self.counts().answered.is_some_and(|at| at.elapsed() <= time)
    }

    pub(super) fn read(&self) -> Counted {
        let counts = self.counts();
        let mut sorted: Vec<f64> = counts.latencies.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: usize| sorted.get((sorted.len() * share / 100).min(sorted.len().saturating_sub(1)));
        let latency = counts.latencies.back().zip(at(50)).zip(at(95)).map(|((last, median), p95)| Latency {
            last_s: *last,
            median_s: *median,
            p95_s: *p95,
        });
        Counted {
            calls: counts.calls,
            failed: counts.failed,
            retries: counts.retries,
            last: counts.last.clone(),
            latency,
        }
    }
}
