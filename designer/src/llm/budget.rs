//! What has been spent, by run and by day. What a call may cost is set aside before it is made, so that calls at once do
//! not overshoot together.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use super::{LlmConfig, LlmError};

/// What was used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Tokens, in and out.
    pub tokens: u64,
    /// What they cost.
    pub cost: f64,
}

impl Spent {
    fn add(&mut self, other: Self) {
        self.tokens = self.tokens.saturating_add(other.tokens);
        self.cost += other.cost;
    }

    fn take(&mut self, other: Self) {
        self.tokens = self.tokens.saturating_sub(other.tokens);
        self.cost = (self.cost - other.cost).max(0.0);
    }
}

/// Spent, and set aside for calls under way.
#[derive(Debug, Clone, Copy, Default)]
struct Account {
    spent: Spent,
    reserved: Spent,
}

impl Account {
    fn with(&self, more: Spent) -> Spent {
        let mut all = self.spent;
        all.add(self.reserved);
        all.add(more);
        all
    }
}

#[derive(Debug, Default)]
struct Books {
    day: i64,
    today: Account,
    runs: BTreeMap<String, Account>,
}

impl Books {
    /// A new day begins with nothing spent; what is under way stays set aside.
    fn turn(&mut self, day: i64) {
        if day != self.day {
            self.day = day;
            self.today.spent = Spent::default();
        }
    }
}

/// The budget of all runs.
#[derive(Debug, Clone, Default)]
pub(super) struct Budget(Arc<Mutex<Books>>);

/// What is set aside for one call. Dropped without [`Reservation::settle`] (a call nobody waits for any more) it counts as
/// what was certainly sent.
#[derive(Debug)]
pub(super) struct Reservation {
    budget: Budget,
    run: String,
    day: i64,
    held: Spent,
    certain: Spent,
    settled: bool,
}

impl Budget {
    fn books(&self) -> MutexGuard<'_, Books> {
        // Numbers are whole after every statement: a panic elsewhere leaves nothing half-done here.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets aside what a call may come to.
    ///
    /// # Errors
    /// The budget that does not pay for it.
    pub(super) fn reserve(
        &self,
        config: &LlmConfig,
        run: &str,
        tokens_in: u64,
    ) -> Result<Reservation, LlmError> {
        let most = u64::from(config.max_tokens);
        let held = Spent { tokens: tokens_in.saturating_add(most), cost: config.cost(tokens_in, most) };
        let certain = Spent { tokens: tokens_in, cost: config.cost(tokens_in, 0) };
        let day = config.clock.day();
        let mut books = self.books();
        books.turn(day);
        let of_run = books.runs.get(run).copied().unwrap_or_default();
        let tokens = |spent: Spent| spent.tokens as f64;
        let limits = [
            (
                "tokens of this run",
                tokens(of_run.with(held)),
                tokens(of_run.with(Spent::default())),
                config.tokens_per_run.map(|t| t as f64),
            ),
            (
                "tokens of today",
                tokens(books.today.with(held)),
                tokens(books.today.with(Spent::default())),
                config.tokens_per_day.map(|t| t as f64),
            ),
            (
                "cost of today",
                books.today.with(held).cost,
                books.today.with(Spent::default()).cost,
                config.cost_per_day,
            ),
        ];
        for (what, then, now, limit) in limits {
            if let Some(limit) = limit.filter(|limit| then > *limit) {
                return Err(LlmError::Budget { what, spent: now, limit });
            }
        }
        books.today.reserved.add(held);
        books.runs.entry(run.to_owned()).or_default().reserved.add(held);
        Ok(Reservation { budget: self.clone(), run: run.to_owned(), day, held, certain, settled: false })
    }

    /// Counts what was spent before this process began.
    pub(super) fn restore(&self, run: &str, spent: Spent, day: i64, today: i64) {
        let mut books = self.books();
        books.turn(today);
        books.runs.entry(run.to_owned()).or_default().spent.add(spent);
        if day == today {
            books.today.spent.add(spent);
        }
    }

    /// What was spent today, by all.
    pub(super) fn today(&self, day: i64) -> Spent {
        let mut books = self.books();
        books.turn(day);
        books.today.spent
    }

    /// What a run has spent in all.
    pub(super) fn run(&self, run: &str) -> Spent {
        self.books().runs.get(run).map(|account| account.spent).unwrap_or_default()
    }
}

impl Reservation {
    /// The call is over, and came to this.
    pub(super) fn settle(mut self, spent: Spent) {
        self.book(spent);
    }

    fn book(&mut self, spent: Spent) {
        self.settled = true;
        let mut books = self.budget.books();
        books.today.reserved.take(self.held);
        if books.day == self.day {
            books.today.spent.add(spent);
        }
        let account = books.runs.entry(self.run.clone()).or_default();
        account.reserved.take(self.held);
        account.spent.add(spent);
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        if !self.settled {
            let certain = self.certain;
            self.book(certain);
        }
    }
}
