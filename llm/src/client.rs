//! [`LlmClient`]: one endpoint that all runs of a server share. It limits concurrency, reserves budget, respects the circuit
//! breaker, and records the health of the endpoint.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::Instant;

use crate::breaker::Breaker;
use crate::budget::Budget;
use crate::call::ChatCall;
use crate::endpoint::Endpoint;
use crate::health::CallMetrics;
use crate::{ChatBackend, ChatResponse, Health, LlmConfig, LlmError, OpenAi, Spending, TokenUsage};

/// Client of one endpoint. Clones share all state.
#[derive(Clone)]
pub struct LlmClient(Arc<ClientState>);

/// State that all clones of a client share.
struct ClientState {
    endpoint: Endpoint,
    concurrency: Semaphore,
    breaker: Breaker,
}

impl std::fmt::Debug for LlmClient {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LlmClient").field("config", self.config()).finish_non_exhaustive()
    }
}

impl LlmClient {
    /// Creates a client of an OpenAI-compatible endpoint. Sends nothing yet.
    ///
    /// # Errors
    /// Returns [`LlmError::Config`] if a setting is invalid.
    pub fn new(config: LlmConfig) -> Result<Self, LlmError> {
        let backend = OpenAi::new(&config)?;
        Self::with_backend(config, Box::new(backend))
    }

    /// Creates a client of an endpoint with another API.
    ///
    /// # Errors
    /// Returns [`LlmError::Config`] if a setting is invalid.
    pub fn with_backend(config: LlmConfig, backend: Box<dyn ChatBackend>) -> Result<Self, LlmError> {
        config.validate()?;
        let concurrency = Semaphore::new(config.concurrency.min(Semaphore::MAX_PERMITS));
        Ok(Self(Arc::new(ClientState {
            endpoint: Endpoint {
                config,
                backend,
                budget: Budget::default(),
                metrics: CallMetrics::default(),
            },
            concurrency,
            breaker: Breaker::default(),
        })))
    }

    /// Returns the configuration of the client.
    #[must_use]
    pub fn config(&self) -> &LlmConfig {
        &self.0.endpoint.config
    }

    /// Adds the spending of a run on a day (days since 1970 UTC) before this process started, so that budgets survive restarts.
    /// Call it once for each run and day on record.
    pub fn restore_spending(&self, run: &str, spending: Spending, day: i64) {
        let Endpoint { budget, config, .. } = &self.0.endpoint;
        budget.restore(run, spending, day, config.clock.day());
    }

    /// Returns the total spending of a run.
    #[must_use]
    pub fn spending(&self, run: &str) -> Spending {
        self.0.endpoint.budget.spent_by_run(run)
    }

    /// Returns the health of the endpoint.
    #[must_use]
    pub fn health(&self) -> Health {
        let Endpoint { config, backend, budget, metrics } = &self.0.endpoint;
        let (breaker, metrics) = (self.0.breaker.status(), metrics.snapshot());
        let host = config.completions_url().ok().and_then(|url| url.host_str().map(str::to_owned));
        Health {
            host: host.unwrap_or_default(),
            model: config.model.clone(),
            breaker: breaker.state,
            breaker_error: breaker.reason,
            retry_in_s: breaker.retry_in.map(|left| left.as_secs_f64()),
            consecutive_failures: breaker.failures_in_a_row,
            response_format: backend.response_format(),
            today: budget.spent_today(config.clock.day()),
            tokens_per_day: config.tokens_per_day,
            cost_per_day: config.cost_per_day,
            tokens_per_run: config.tokens_per_run,
            calls: metrics.calls,
            failed: metrics.failed,
            retries: metrics.retries,
            last_error: metrics.last_error,
            latency: metrics.latency,
        }
    }

    /// Returns true if a call succeeded within the last [`LlmConfig::timeout`]. A call that times out then does so because of
    /// its request, not because the endpoint is down.
    #[must_use]
    pub fn is_responsive(&self) -> bool {
        let Endpoint { config, metrics, .. } = &self.0.endpoint;
        metrics.has_succeeded_within(config.timeout)
    }

    /// Sends a request: waits for a free slot, retries transient failures, and accounts for the cost. Adds the usage of all
    /// attempts, also failed ones, to `usage`.
    ///
    /// # Errors
    /// Returns the error of the last attempt, [`LlmError::Budget`] or [`LlmError::CircuitOpen`] if no request was sent, or
    /// [`LlmError::Timeout`] at the deadline of the call.
    pub async fn complete(
        &self,
        call: &ChatCall<'_>,
        usage: &mut TokenUsage,
    ) -> Result<ChatResponse, LlmError> {
        let ClientState { endpoint, concurrency, breaker } = &*self.0;
        let started = Instant::now();
        // The semaphore is never closed; if it were, only the concurrency limit would be lost.
        let _slot = call.before_deadline(started, async { Ok(concurrency.acquire().await.ok()) }).await?;
        let reservation = endpoint.reserve(call)?;
        let permit = match breaker.acquire() {
            Ok(permit) => permit,
            Err(open) => {
                reservation.settle(Spending::default());
                return Err(open);
            }
        };
        let started = Instant::now();
        let result = endpoint.send(call, reservation, !permit.is_trial(), usage).await;
        match &result {
            Ok(_) => {
                permit.record_success();
                endpoint.metrics.record_success(started.elapsed());
            }
            Err(error) => {
                tracing::warn!(run = call.run, kind = error.kind(), %error, "A call of the language model failed.");
                endpoint.metrics.record_failure(error, endpoint.config.clock.now_ms());
                // A caller's deadline is not the endpoint's failure.
                if !(matches!(error, LlmError::Timeout { .. }) && call.is_due_within(Duration::ZERO)) {
                    permit.record_failure(error);
                }
            }
        }
        result
    }
}
