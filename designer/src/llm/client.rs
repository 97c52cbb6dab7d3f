//! One endpoint as all runs of a server share it: how many ask at once, when to try again, when not to ask at all, and
//! what it may cost.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::Instant;

use super::breaker::Breaker;
use super::budget::{Budget, Reservation};
use super::chat::{Ask, Chat, Reply, guess_tokens};
use super::health::{Health, Meter};
use super::{LlmConfig, LlmDesigner, LlmError, OpenAi, Spent, retry};

/// An endpoint. Clones share it.
#[derive(Clone)]
pub struct Llm(Arc<Shared>);

struct Shared {
    config: LlmConfig,
    chat: Box<dyn Chat>,
    turns: Semaphore,
    breaker: Breaker,
    budget: Budget,
    meter: Meter,
    tries: AtomicU64,
}

/// An answer, with what it took.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answered {
    pub(super) reply: Reply,
    pub(super) tokens_in: u64,
    pub(super) tokens_out: u64,
    pub(super) cost: f64,
}

impl std::fmt::Debug for Llm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Llm").field("config", &self.0.config).finish_non_exhaustive()
    }
}

impl Llm {
    /// An OpenAI-compatible endpoint. Nothing is sent yet.
    ///
    /// # Errors
    /// A setting that cannot be.
    pub fn new(config: LlmConfig) -> Result<Self, LlmError> {
        let chat = OpenAi::new(&config)?;
        Self::with(config, Box::new(chat))
    }

    /// An endpoint of another API.
    ///
    /// # Errors
    /// A setting that cannot be.
    pub fn with(config: LlmConfig, chat: Box<dyn Chat>) -> Result<Self, LlmError> {
        config.check()?;
        let turns = Semaphore::new(config.concurrency.min(Semaphore::MAX_PERMITS));
        Ok(Self(Arc::new(Shared {
            config,
            chat,
            turns,
            breaker: Breaker::default(),
            budget: Budget::default(),
            meter: Meter::default(),
            tries: AtomicU64::new(0),
        })))
    }

    /// A run's designer.
    #[must_use]
    pub fn designer(&self, run: &str) -> LlmDesigner {
        LlmDesigner::new(self.clone(), run)
    }

    /// What it was set up with.
    #[must_use]
    pub fn config(&self) -> &LlmConfig {
        &self.0.config
    }

    /// Counts what a run spent on a day (days since 1970 UTC) before this process began. Called once for every run and day
    /// there is a record of: budgets survive restarts.
    pub fn restore(&self, run: &str, tokens: u64, cost: f64, day: i64) {
        self.0.budget.restore(run, Spent { tokens, cost }, day, self.0.config.clock.day());
    }

    /// What a run has spent in all.
    #[must_use]
    pub fn spent(&self, run: &str) -> Spent {
        self.0.budget.run(run)
    }

    /// How it does.
    #[must_use]
    pub fn health(&self) -> Health {
        let Shared { config, chat, breaker, budget, meter, .. } = &*self.0;
        let (shown, counted) = (breaker.shown(), meter.read());
        let host = config.endpoint().ok().and_then(|url| url.host_str().map(str::to_owned));
        Health {
            host: host.unwrap_or_default(),
            model: config.model.clone(),
            breaker: shown.word,
            why: breaker.why(),
            retry_in_s: shown.retry_in.map(|left| left.as_secs_f64()),
            failures_in_a_row: shown.failures,
            mode: chat.mode(),
            today: budget.today(config.clock.day()),
            tokens_per_day: config.tokens_per_day,
            cost_per_day: config.cost_per_day,
            tokens_per_run: config.tokens_per_run,
            calls: counted.calls,
            failed: counted.failed,
            retries: counted.retries,
            last_error: counted.last,
            latency: counted.latency,
        }
    }

    /// Asks, for a run: waits for its turn, tries again where that helps, and keeps the books.
    pub(super) async fn ask(&self, run: &str, ask: &Ask) -> Result<Answered, LlmError> {
        let shared = &*self.0;
        // The semaphore is never closed; were it, waiting in line would be all that is lost.
        let _turn = shared.turns.acquire().await.ok();
        let reservation = shared.budget.reserve(&shared.config, run, ask.guess_tokens())?;
        let pass = match shared.breaker.pass() {
            Ok(pass) => pass,
            Err(open) => {
                reservation.settle(Spent::default());
                return Err(open);
            }
        };
        let begun = Instant::now();
        let result = self.tried(ask, run, !pass.tries).await;
        let now = shared.config.clock.now_ms();
        match result {
            Ok(reply) => {
                pass.good();
                shared.meter.ended(Ok(begun.elapsed()), now);
                Ok(self.paid(reservation, ask, reply))
            }
            Err(error) => {
                tracing::warn!(run, kind = error.word(), %error, "a call of the language model failed");
                shared.meter.ended(Err(&error), now);
                pass.bad(&error);
                if error.may_cost() {
                    reservation.settle_as_sent();
                } else {
                    reservation.settle(Spent::default());
                }
                Err(error)
            }
        }
    }

    async fn tried(&self, ask: &Ask, run: &str, again: bool) -> Result<Reply, LlmError> {
        let shared = &*self.0;
        for number in 1.. {
            let error = match shared.chat.ask(ask).await {
                Ok(reply) => return Ok(reply),
                Err(error) => error,
            };
            let pause = retry::pause(&shared.config, &error, number, self.chance(run));
            match pause.filter(|_| again) {
                None => return Err(error),
                Some(pause) => {
                    tracing::debug!(run, %error, pause_ms = pause.as_millis(), "the language model is asked again");
                    shared.meter.retried();
                    tokio::time::sleep(pause).await;
                }
            }
        }
        Err(LlmError::Timeout { after: Duration::ZERO }) // retries are fewer than u32 holds
    }

    /// What jitter is made of: a hash of when and who. Nothing that is stored follows from it.
    fn chance(&self, run: &str) -> f64 {
        let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 jitter");
        hasher.update(&self.0.config.clock.now_ms().to_le_bytes());
        hasher.update(&self.0.tries.fetch_add(1, Ordering::Relaxed).to_le_bytes());
        hasher.update(run.as_bytes());
        let mut bits = [0; 4];
        hasher.finalize_xof().fill(&mut bits);
        f64::from(u32::from_le_bytes(bits)) / (f64::from(u32::MAX) + 1.0)
    }

    fn paid(&self, reservation: Reservation, ask: &Ask, reply: Reply) -> Answered {
        let tokens_in = reply.tokens_in.unwrap_or_else(|| ask.guess_tokens());
        let tokens_out = reply.tokens_out.unwrap_or_else(|| guess_tokens(&reply.text));
        let cost = self.0.config.cost(tokens_in, tokens_out);
        reservation.settle(Spent { tokens: tokens_in.saturating_add(tokens_out), cost });
        Answered { reply, tokens_in, tokens_out, cost }
    }
}
