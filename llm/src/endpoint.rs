//! [`Endpoint`]: backend, budget and metrics of one endpoint. Sends a call in one or more attempts, each under a budget
//! reservation of its own.

use backon::Retryable;
use tokio::sync::Mutex;
use tokio::time::Instant;

use crate::budget::{Budget, Reservation};
use crate::call::ChatCall;
use crate::chat::estimate_tokens;
use crate::health::CallMetrics;
use crate::{ChatBackend, ChatRequest, ChatResponse, LlmConfig, LlmError, TokenUsage, retry};

/// Upper bound of reported token counts that are accepted: no model reads or writes as many in one call.
const MAX_REPORTED_TOKENS: u64 = 10_000_000;

/// Backend, budget and metrics of one endpoint.
pub(crate) struct Endpoint {
    pub(crate) config: LlmConfig,
    pub(crate) backend: Box<dyn ChatBackend>,
    pub(crate) budget: Budget,
    pub(crate) metrics: CallMetrics,
}

impl Endpoint {
    /// Reserves the most that one attempt of a call can cost.
    ///
    /// # Errors
    /// Returns [`LlmError::Budget`] if a budget does not cover it.
    pub(crate) fn reserve(&self, call: &ChatCall<'_>) -> Result<Reservation, LlmError> {
        self.budget.reserve(&self.config, call.run, call.request.estimate_tokens())
    }

    /// Sends a call until it succeeds, its error is final, or retries or time run out. Adds the usage of all attempts to
    /// `usage`. If `may_retry` is false (a trial of the circuit breaker), the call is sent once.
    ///
    /// # Errors
    /// Returns the error of the last attempt that was sent.
    pub(crate) async fn send(
        &self,
        call: &ChatCall<'_>,
        reservation: Reservation,
        may_retry: bool,
        usage: &mut TokenUsage,
    ) -> Result<ChatResponse, LlmError> {
        let attempts = &Mutex::new(Attempts {
            endpoint: self,
            call,
            started: Instant::now(),
            // One more than there are attempts, to try another response format; the first call of all may need four
            // requests to learn what the endpoint accepts.
            requests_left: self.config.retries.max(2).saturating_add(2),
            reservation: Some(reservation),
            last_error: None,
            usage,
        });
        (|| async { attempts.lock().await.send_once().await })
            .retry(retry::backoff(&self.config))
            .when(|failed: &FailedAttempt| may_retry && failed.can_be_repeated)
            .adjust(|failed, pause| {
                let pause = retry::extend_pause(&failed.error, pause?)?;
                (!call.is_due_within(pause)).then_some(pause)
            })
            .notify(|failed, pause| {
                let (error, pause_ms) = (&failed.error, pause.as_millis());
                tracing::debug!(run = call.run, %error, pause_ms, "A call of the language model is retried.");
                self.metrics.record_retry();
            })
            .await
            .map_err(|failed| failed.error)
    }
}

/// State of a call across its attempts.
struct Attempts<'a> {
    endpoint: &'a Endpoint,
    call: &'a ChatCall<'a>,
    started: Instant,
    requests_left: u32,
    /// Reservation of the next attempt; later attempts make their own, since one that broke off may have cost.
    reservation: Option<Reservation>,
    last_error: Option<LlmError>,
    usage: &'a mut TokenUsage,
}

/// Failure of one attempt.
struct FailedAttempt {
    error: LlmError,
    can_be_repeated: bool,
}

impl Attempts<'_> {
    async fn send_once(&mut self) -> Result<ChatResponse, FailedAttempt> {
        let Self { endpoint, call, .. } = *self;
        let reservation = match self.reservation.take().map_or_else(|| endpoint.reserve(call), Ok) {
            Ok(reservation) => reservation,
            // The failure of the last attempt says more than the budget.
            Err(budget) => {
                let error = self.last_error.take().unwrap_or(budget);
                return Err(FailedAttempt { error, can_be_repeated: false });
            }
        };
        let sending = endpoint.backend.send(call.request, &mut self.requests_left);
        let result = call.before_deadline(self.started, sending).await;
        let usage = usage_of(&endpoint.config, call.request, &result);
        self.usage.add(usage);
        reservation.settle(usage.into());
        result.map_err(|error| {
            self.last_error = Some(error.clone());
            let can_be_repeated = error.is_transient() && self.requests_left > 0;
            FailedAttempt { error, can_be_repeated }
        })
    }
}

/// Returns the usage of one attempt: as reported if that is plausible, else as estimated from the lengths.
fn usage_of(
    config: &LlmConfig,
    request: &ChatRequest,
    result: &Result<ChatResponse, LlmError>,
) -> TokenUsage {
    let (reported_in, reported_out, text) = match result {
        Ok(response) => (response.tokens_in, response.tokens_out, response.text.as_str()),
        Err(LlmError::InvalidResponse { tokens_in, tokens_out, .. }) => (*tokens_in, *tokens_out, ""),
        Err(error) if error.may_be_billed() => (None, None, ""),
        Err(_) => return TokenUsage::default(),
    };
    let tokens_in = plausible_tokens(reported_in, request.estimate_tokens(), 0);
    // A model that reasons writes more tokens than the answer shows, but no more than the limit.
    let tokens_out = plausible_tokens(reported_out, estimate_tokens(text), request.max_tokens.into());
    TokenUsage { tokens_in, tokens_out, cost: config.cost(tokens_in, tokens_out) }
}

/// Returns a reported token count, limited to ten times the estimate plus 1000, or to `allowed` if that is more. Returns
/// the estimate if nothing was reported.
fn plausible_tokens(reported: Option<u64>, estimate: u64, allowed: u64) -> u64 {
    let max = estimate.saturating_mul(10).saturating_add(1_000).max(allowed).min(MAX_REPORTED_TOKENS);
    reported.unwrap_or(estimate).min(max)
}
