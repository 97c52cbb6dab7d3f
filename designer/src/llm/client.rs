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

/// The most tokens that are believed, whatever an endpoint says: no model reads or writes as many in one call.
const BELIEVED: u64 = 10_000_000;

/// One call.
#[derive(Debug, Clone, Copy)]
pub struct Call<'a> {
    /// For which run.
    pub run: &'a str,
    /// What is asked.
    pub ask: &'a Ask,
    /// When nobody waits for it any more.
    pub until: Option<Instant>,
}

impl Call<'_> {
    /// Whether it is too late for it, after another such while.
    fn over(&self, after: Duration) -> bool {
        self.until.is_some_and(|until| until.saturating_duration_since(Instant::now()) <= after)
    }
}

/// What calls came to.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bill {
    /// Tokens that the model read.
    pub tokens_in: u64,
    /// Tokens that it wrote.
    pub tokens_out: u64,
    /// What that cost, in the currency of the config's prices.
    pub cost: f64,
}

impl Bill {
    /// Adds what another call came to.
    pub fn add(&mut self, other: Self) {
        self.tokens_in = self.tokens_in.saturating_add(other.tokens_in);
        self.tokens_out = self.tokens_out.saturating_add(other.tokens_out);
        self.cost += other.cost;
    }

    const fn spent(&self) -> Spent {
        Spent { tokens: self.tokens_in.saturating_add(self.tokens_out), cost: self.cost }
    }
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

    /// Whether it answered anybody within the time that a call may take: then it is there, and a call that is late is late
    /// by what was asked.
    #[must_use]
    pub fn answers(&self) -> bool {
        self.0.meter.answered_within(self.0.config.timeout)
    }

    /// Asks: waits for its turn, tries again where that helps, and keeps the books. What it came to, tries that failed
    /// included, is added to the bill.
    ///
    /// # Errors
    /// What kept the endpoint from answering, once nothing more is tried.
    pub async fn ask(&self, call: &Call<'_>, bill: &mut Bill) -> Result<Reply, LlmError> {
        let shared = &*self.0;
        let begun = Instant::now();
        // The semaphore is never closed; were it, waiting in line would be all that is lost.
        let _turn = in_time(call, begun, async { Ok(shared.turns.acquire().await.ok()) }).await?;
        let reservation = self.reserve(call)?;
        let pass = match shared.breaker.pass() {
            Ok(pass) => pass,
            Err(open) => {
                reservation.settle(Spent::default());
                return Err(open);
            }
        };
        let begun = Instant::now();
        let result = self.tried(call, reservation, !pass.tries, bill).await;
        let now = shared.config.clock.now_ms();
        match &result {
            Ok(_) => {
                pass.good();
                shared.meter.ended(Ok(begun.elapsed()), now);
            }
            Err(error) => {
                tracing::warn!(run = call.run, kind = error.word(), %error, "a call of the language model failed");
                shared.meter.ended(Err(error), now);
                // That nobody had more time says nothing about the endpoint.
                if !(matches!(error, LlmError::Timeout { .. }) && call.over(Duration::ZERO)) {
                    pass.bad(error);
                }
            }
        }
        result
    }

    fn reserve(&self, call: &Call<'_>) -> Result<Reservation, LlmError> {
        self.0.budget.reserve(&self.0.config, call.run, call.ask.guess_tokens())
    }

    async fn tried(
        &self,
        call: &Call<'_>,
        mut reservation: Reservation,
        again: bool,
        bill: &mut Bill,
    ) -> Result<Reply, LlmError> {
        let Shared { config, chat, meter, .. } = &*self.0;
        let (run, begun) = (call.run, Instant::now());
        // One more than there are tries, to see whether another form helps; the first call of all may need four to learn
        // how the endpoint is asked.
        let mut requests = config.retries.max(2).saturating_add(2);
        for number in 1.. {
            let answer = in_time(call, begun, chat.ask(call.ask, &mut requests)).await;
            let came_to = self.bill(call.ask, &answer);
            bill.add(came_to);
            reservation.settle(came_to.spent());
            let error = match answer {
                Ok(reply) => return Ok(reply),
                Err(error) => error,
            };
            let pause = retry::pause(config, &error, number, self.chance(run));
            let Some(pause) = pause.filter(|pause| again && requests > 0 && !call.over(*pause)) else {
                return Err(error);
            };
            tracing::debug!(run, %error, pause_ms = pause.as_millis(), "the language model is asked again");
            meter.retried();
            tokio::time::sleep(pause).await;
            // Each try is set aside for anew: one that broke off may have cost.
            reservation = match self.reserve(call) {
                Ok(reservation) => reservation,
                Err(_) => return Err(error),
            };
        }
        Err(LlmError::Timeout { after: begun.elapsed() }) // retries are fewer than u32 holds
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

    /// What a try came to: what the endpoint says, as far as that can be, else what the lengths say.
    fn bill(&self, ask: &Ask, answer: &Result<Reply, LlmError>) -> Bill {
        let (said_in, said_out, text) = match answer {
            Ok(reply) => (reply.tokens_in, reply.tokens_out, reply.text.as_str()),
            Err(LlmError::Nonsense { tokens_in, tokens_out, .. }) => (*tokens_in, *tokens_out, ""),
            Err(error) if error.may_cost() => (None, None, ""),
            Err(_) => return Bill::default(),
        };
        let tokens_in = believed(said_in, ask.guess_tokens(), 0);
        // Models that think write more than is seen, but no more than they may.
        let tokens_out = believed(said_out, guess_tokens(text), ask.max_tokens.into());
        Bill { tokens_in, tokens_out, cost: self.0.config.cost(tokens_in, tokens_out) }
    }
}

/// What comes of a call in the time there is for it.
async fn in_time<T>(
    call: &Call<'_>,
    begun: Instant,
    work: impl Future<Output = Result<T, LlmError>>,
) -> Result<T, LlmError> {
    match call.until {
        None => work.await,
        Some(until) => tokio::time::timeout_at(until, work)
            .await
            .unwrap_or_else(|_| Err(LlmError::Timeout { after: begun.elapsed() })),
    }
}

/// Tokens as an endpoint reports them, if they are anywhere near what was guessed, or no more than were `allowed`.
fn believed(said: Option<u64>, guess: u64, allowed: u64) -> u64 {
    let most = guess.saturating_mul(10).saturating_add(1_000).max(allowed).min(BELIEVED);
    said.unwrap_or(guess).min(most)
}
