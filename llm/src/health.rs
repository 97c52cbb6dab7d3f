//! Health of an endpoint: counters and latencies of its calls, for operators.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::time::Instant;

use crate::{BreakerState, LlmError, ResponseFormat, Spending};

/// Number of successful calls in the latency summary.
const LATENCY_WINDOW: usize = 256;

/// Health of an endpoint. Contains no secrets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Health {
    /// Host of the endpoint.
    pub host: String,
    /// Name of the model.
    pub model: String,
    /// State of the circuit breaker.
    pub breaker: BreakerState,
    /// Message of the failure that opened the breaker; `None` if closed.
    pub breaker_error: Option<String>,
    /// Seconds until the next trial call; `None` if the breaker is closed.
    pub retry_in_s: Option<f64>,
    /// Number of consecutive failed calls.
    pub consecutive_failures: u32,
    /// Response format that the endpoint is known to accept.
    pub response_format: ResponseFormat,
    /// Spending of today (UTC).
    pub today: Spending,
    /// Token limit per day; `None` is unlimited.
    pub tokens_per_day: Option<u64>,
    /// Cost limit per day; `None` is unlimited.
    pub cost_per_day: Option<f64>,
    /// Token limit per run; `None` is unlimited.
    pub tokens_per_run: Option<u64>,
    /// Calls since the start of the process. Retries are not counted.
    pub calls: u64,
    /// Failed calls among `calls`.
    pub failed: u64,
    /// Retries since the start of the process.
    pub retries: u64,
    /// Most recent failure; `None` before the first.
    pub last_error: Option<LastError>,
    /// Latencies of the last 256 successful calls.
    pub latency: Option<LatencySummary>,
}

/// Most recent failure of an endpoint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LastError {
    /// Kind of the error, see [`LlmError::kind`].
    pub kind: &'static str,
    /// Message of the error.
    pub message: String,
    /// Time of the failure, in milliseconds since 1970 UTC.
    pub at_ms: i64,
}

/// Latencies of the last 256 successful calls, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LatencySummary {
    /// Latency of the most recent call.
    pub last_s: f64,
    /// Median over the window.
    pub median_s: f64,
    /// 95th percentile over the window.
    pub p95_s: f64,
}

/// Collects counters and latencies of calls.
#[derive(Debug, Default)]
pub(crate) struct CallMetrics(Mutex<CallCounters>);

#[derive(Debug, Default)]
struct CallCounters {
    calls: u64,
    failed: u64,
    retries: u64,
    last_error: Option<LastError>,
    latencies_s: VecDeque<f64>,
    last_success: Option<Instant>,
}

/// Values of [`CallMetrics`] at one moment.
pub(crate) struct MetricsSnapshot {
    pub(crate) calls: u64,
    pub(crate) failed: u64,
    pub(crate) retries: u64,
    pub(crate) last_error: Option<LastError>,
    pub(crate) latency: Option<LatencySummary>,
}

impl CallMetrics {
    pub(crate) fn record_retry(&self) {
        self.lock().retries += 1;
    }

    pub(crate) fn record_success(&self, latency: Duration) {
        let mut counters = self.lock();
        counters.calls += 1;
        counters.last_success = Some(Instant::now());
        if counters.latencies_s.len() == LATENCY_WINDOW {
            counters.latencies_s.pop_front();
        }
        counters.latencies_s.push_back(latency.as_secs_f64());
    }

    /// Records a failed call at `at_ms`, in milliseconds since 1970 UTC.
    pub(crate) fn record_failure(&self, error: &LlmError, at_ms: i64) {
        let mut counters = self.lock();
        counters.calls += 1;
        counters.failed += 1;
        counters.last_error = Some(LastError { kind: error.kind(), message: error.to_string(), at_ms });
    }

    /// Returns true if a call succeeded within `period` before now.
    pub(crate) fn has_succeeded_within(&self, period: Duration) -> bool {
        self.lock().last_success.is_some_and(|at| at.elapsed() <= period)
    }

    pub(crate) fn snapshot(&self) -> MetricsSnapshot {
        let counters = self.lock();
        let mut sorted: Vec<f64> = counters.latencies_s.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let percentile =
            |percent: usize| sorted.get((sorted.len() * percent / 100).min(sorted.len().saturating_sub(1)));
        let latency =
            counters.latencies_s.back().zip(percentile(50)).zip(percentile(95)).map(
                |((last, median), p95)| LatencySummary { last_s: *last, median_s: *median, p95_s: *p95 },
            );
        MetricsSnapshot {
            calls: counters.calls,
            failed: counters.failed,
            retries: counters.retries,
            last_error: counters.last_error.clone(),
            latency,
        }
    }

    fn lock(&self) -> MutexGuard<'_, CallCounters> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
