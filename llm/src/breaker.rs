//! Circuit breaker: after repeated failures calls are rejected for a while, then one trial call is let through.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::time::Instant;

use crate::LlmError;

/// Consecutive failures that open the breaker.
const FAILURES_TO_OPEN: u32 = 3;
/// First open period. It doubles with each failed trial, up to [`MAX_OPEN_PERIOD`].
const FIRST_OPEN_PERIOD: Duration = Duration::from_secs(30);
const MAX_OPEN_PERIOD: Duration = Duration::from_secs(15 * 60);

/// State of a circuit breaker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BreakerState {
    /// Calls are sent to the endpoint.
    Closed,
    /// Calls are rejected without a request.
    Open,
    /// One trial call is allowed or running.
    HalfOpen,
}

/// Circuit breaker of one endpoint. Clones share its state.
#[derive(Debug, Clone, Default)]
pub(crate) struct Breaker(Arc<Mutex<Failures>>);

#[derive(Debug, Default)]
struct Failures {
    in_a_row: u32,
    last_error: Option<LlmError>,
    open: Option<OpenPeriod>,
    /// True while a trial call is running.
    is_on_trial: bool,
}

#[derive(Debug, Clone, Copy)]
struct OpenPeriod {
    until: Instant,
    length: Duration,
}

impl OpenPeriod {
    fn time_left(self) -> Duration {
        self.until.saturating_duration_since(Instant::now())
    }
}

/// Permission for one call. If it is dropped without a result (the caller was cancelled), the breaker does not change.
#[derive(Debug)]
pub(crate) struct Permit {
    breaker: Breaker,
    is_trial: bool,
}

/// Snapshot of a breaker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BreakerStatus {
    pub(crate) state: BreakerState,
    pub(crate) failures_in_a_row: u32,
    /// Time until the next trial call; `None` if closed.
    pub(crate) retry_in: Option<Duration>,
    /// Message of the last failure; `None` if closed.
    pub(crate) reason: Option<String>,
}

impl Breaker {
    /// Returns the permission for one call.
    ///
    /// # Errors
    /// Returns [`LlmError::CircuitOpen`] while the breaker is open or a trial call is running.
    pub(crate) fn acquire(&self) -> Result<Permit, LlmError> {
        let mut failures = self.lock();
        let Some(open) = failures.open else {
            return Ok(Permit { breaker: self.clone(), is_trial: false });
        };
        let time_left = open.time_left();
        if time_left.is_zero() && !failures.is_on_trial {
            failures.is_on_trial = true;
            return Ok(Permit { breaker: self.clone(), is_trial: true });
        }
        let last_error = failures.last_error.as_ref().map_or_else(String::new, ToString::to_string);
        let retry_in = if time_left.is_zero() { open.length } else { time_left };
        Err(LlmError::CircuitOpen { retry_in, last_error })
    }

    pub(crate) fn status(&self) -> BreakerStatus {
        let failures = self.lock();
        let retry_in = failures.open.map(OpenPeriod::time_left);
        let state = match retry_in {
            None => BreakerState::Closed,
            Some(time_left) if time_left.is_zero() || failures.is_on_trial => BreakerState::HalfOpen,
            Some(_) => BreakerState::Open,
        };
        let reason = failures.open.and(failures.last_error.as_ref()).map(ToString::to_string);
        BreakerStatus { state, failures_in_a_row: failures.in_a_row, retry_in, reason }
    }

    fn lock(&self) -> MutexGuard<'_, Failures> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Permit {
    /// Returns true for the trial call of a half-open breaker.
    pub(crate) const fn is_trial(&self) -> bool {
        self.is_trial
    }

    /// Records that the call succeeded, which closes the breaker.
    pub(crate) fn record_success(self) {
        *self.breaker.lock() = Failures::default();
    }

    /// Records that the call failed. Opens the breaker after a failed trial or the third failure in a row.
    pub(crate) fn record_failure(self, error: &LlmError) {
        let mut failures = self.breaker.lock();
        failures.in_a_row = failures.in_a_row.saturating_add(1);
        failures.last_error = Some(error.clone());
        if self.is_trial || (failures.open.is_none() && failures.in_a_row >= FAILURES_TO_OPEN) {
            let length =
                failures.open.map_or(FIRST_OPEN_PERIOD, |open| (2 * open.length).min(MAX_OPEN_PERIOD));
            // Respect the endpoint's own `Retry-After`.
            let requested = match error {
                LlmError::RateLimited { retry_after: Some(after) } => (*after).min(MAX_OPEN_PERIOD),
                _ => Duration::ZERO,
            };
            failures.open = Some(OpenPeriod { until: Instant::now() + length.max(requested), length });
        }
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        if self.is_trial {
            self.breaker.lock().is_on_trial = false;
        }
    }
}
