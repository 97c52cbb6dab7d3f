//! The circuit breaker: after repeated failures nobody asks for a while, then one call is let through to see.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use super::LlmError;

/// Calls that fail in a row before it opens.
pub(super) const OPENS_AFTER: u32 = 3;
/// The first pause; it doubles with every try that fails, to the longest.
const PAUSE: Duration = Duration::from_secs(30);
const LONGEST: Duration = Duration::from_secs(15 * 60);

#[derive(Debug, Default)]
struct State {
    failures: u32,
    why: Option<LlmError>,
    /// Open until then, and the pause that leads there.
    until: Option<(Instant, Duration)>,
    /// One call is under way to see whether it may close.
    trying: bool,
}

/// Whether calls are let through.
#[derive(Debug, Clone, Default)]
pub(super) struct Breaker(Arc<Mutex<State>>);

/// A call that is let through. Dropped without a result (nobody waits for it any more) it says nothing about the endpoint.
#[derive(Debug)]
pub(super) struct Pass {
    breaker: Breaker,
    /// It is the one call that tries.
    pub(super) tries: bool,
}

/// What a breaker shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shown {
    pub(super) word: &'static str,
    pub(super) failures: u32,
    pub(super) retry_in: Option<Duration>,
}

impl Breaker {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a call through, or says for how long not.
    pub(super) fn pass(&self) -> Result<Pass, LlmError> {
        let mut state = self.state();
        let Some((until, pause)) = state.until else {
            return Ok(Pass { breaker: self.clone(), tries: false });
        };
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() && !state.trying {
            state.trying = true;
            return Ok(Pass { breaker: self.clone(), tries: true });
        }
        let why = state.why.as_ref().map_or_else(String::new, ToString::to_string);
        Err(LlmError::Open { retry_in: if left.is_zero() { pause } else { left }, why })
    }

    pub(super) fn shown(&self) -> Shown {
        let state = self.state();
        let left = state.until.map(|(until, _)| until.saturating_duration_since(Instant::now()));
        let word = match left {
            None => "closed",
            Some(left) if left.is_zero() || state.trying => "half_open",
            Some(_) => "open",
        };
        Shown { word, failures: state.failures, retry_in: left }
    }

    /// Why it is open.
    pub(super) fn why(&self) -> Option<String> {
        let state = self.state();
        state.until.and(state.why.as_ref()).map(ToString::to_string)
    }
}

impl Pass {
    /// The call succeeded.
    pub(super) fn good(self) {
        *self.breaker.state() = State::default();
    }

    /// The call failed.
    pub(super) fn bad(self, error: &LlmError) {
        let mut state = self.breaker.state();
        state.failures = state.failures.saturating_add(1);
        state.why = Some(error.clone());
        if self.tries || (state.until.is_none() && state.failures >= OPENS_AFTER) {
            let pause = state.until.map_or(PAUSE, |(_, pause)| (2 * pause).min(LONGEST));
            // Where the endpoint itself says for how long, there is no use in asking earlier.
            let asked = match error {
                LlmError::RateLimited { retry_after: Some(after) } => (*after).min(LONGEST),
                _ => Duration::ZERO,
            };
            state.until = Some((Instant::now() + pause.max(asked), pause));
        }
    }
}

impl Drop for Pass {
    fn drop(&mut self) {
        if self.tries {
            self.breaker.state().trying = false;
        }
    }
}
