//! Token and cost budgets, by run and by day. The possible cost of a call is reserved before the call, so that concurrent
//! calls cannot exceed a budget together.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::{LlmConfig, LlmError, TokenUsage};

/// Tokens and cost that were spent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spending {
    /// Prompt and completion tokens.
    pub tokens: u64,
    /// Cost, in the currency of the configured prices.
    pub cost: f64,
}

impl From<TokenUsage> for Spending {
    fn from(usage: TokenUsage) -> Self {
        Self { tokens: usage.tokens_in.saturating_add(usage.tokens_out), cost: usage.cost }
    }
}

impl Spending {
    fn add(&mut self, other: Self) {
        self.tokens = self.tokens.saturating_add(other.tokens);
        self.cost += other.cost;
    }

    fn subtract(&mut self, other: Self) {
        self.tokens = self.tokens.saturating_sub(other.tokens);
        self.cost = (self.cost - other.cost).max(0.0);
    }
}

/// Budgets of all runs. Clones share their accounts.
#[derive(Debug, Clone, Default)]
pub(crate) struct Budget(Arc<Mutex<BudgetAccounts>>);

#[derive(Debug, Default)]
struct BudgetAccounts {
    /// Day of `today`, in days since 1970 UTC.
    day: i64,
    today: Account,
    runs: BTreeMap<String, Account>,
}

/// Spent amount, and the amount reserved for running calls.
#[derive(Debug, Clone, Copy, Default)]
struct Account {
    spent: Spending,
    reserved: Spending,
}

/// Reservation for one call. If it is dropped without [`Reservation::settle`] (the caller was cancelled), the prompt counts
/// as spent.
#[derive(Debug)]
pub(crate) struct Reservation {
    budget: Budget,
    run: String,
    day: i64,
    reserved: Spending,
    /// Spending of a call without an answer.
    minimum: Spending,
    is_settled: bool,
}

/// A configured limit, and how a reservation would change the amount it limits.
struct BudgetCheck {
    budget: &'static str,
    used: f64,
    used_with_call: f64,
    limit: Option<f64>,
}

impl Budget {
    /// Reserves the most that a call of `run` with `tokens_in` prompt tokens can cost.
    ///
    /// # Errors
    /// Returns [`LlmError::Budget`] if a limit would be exceeded.
    pub(crate) fn reserve(
        &self,
        config: &LlmConfig,
        run: &str,
        tokens_in: u64,
    ) -> Result<Reservation, LlmError> {
        let max_tokens_out = u64::from(config.max_tokens);
        let reserved = Spending {
            tokens: tokens_in.saturating_add(max_tokens_out),
            cost: config.cost(tokens_in, max_tokens_out),
        };
        let minimum = Spending { tokens: tokens_in, cost: config.cost(tokens_in, 0) };
        let day = config.clock.day();
        let mut accounts = self.lock();
        accounts.start_day(day);
        for check in accounts.checks(config, run, reserved) {
            let BudgetCheck { budget, used, used_with_call, limit } = check;
            if let Some(limit) = limit.filter(|limit| used_with_call > *limit) {
                return Err(LlmError::Budget { budget, used, limit });
            }
        }
        accounts.today.reserved.add(reserved);
        accounts.runs.entry(run.to_owned()).or_default().reserved.add(reserved);
        let (budget, run) = (self.clone(), run.to_owned());
        Ok(Reservation { budget, run, day, reserved, minimum, is_settled: false })
    }

    /// Adds the spending of `run` on `day` before this process started. Days are counted since 1970 UTC.
    pub(crate) fn restore(&self, run: &str, spending: Spending, day: i64, today: i64) {
        let mut accounts = self.lock();
        accounts.start_day(today);
        accounts.runs.entry(run.to_owned()).or_default().spent.add(spending);
        if day == today {
            accounts.today.spent.add(spending);
        }
    }

    /// Returns the spending of all runs on `today`.
    pub(crate) fn spent_today(&self, today: i64) -> Spending {
        let mut accounts = self.lock();
        accounts.start_day(today);
        accounts.today.spent
    }

    /// Returns the total spending of a run.
    pub(crate) fn spent_by_run(&self, run: &str) -> Spending {
        self.lock().runs.get(run).map(|account| account.spent).unwrap_or_default()
    }

    fn lock(&self) -> MutexGuard<'_, BudgetAccounts> {
        // Every statement leaves the numbers consistent, so a poisoned lock is safe to use.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl BudgetAccounts {
    /// Resets the spending of the day if `day` is a new one. Reservations of running calls remain.
    fn start_day(&mut self, day: i64) {
        if day != self.day {
            self.day = day;
            self.today.spent = Spending::default();
        }
    }

    fn checks(&self, config: &LlmConfig, run: &str, call: Spending) -> [BudgetCheck; 3] {
        let run = self.runs.get(run).copied().unwrap_or_default();
        let tokens = |budget, account: Account, limit: Option<u64>| BudgetCheck {
            budget,
            used: account.used().tokens as f64,
            used_with_call: account.used_with(call).tokens as f64,
            limit: limit.map(|limit| limit as f64),
        };
        [
            tokens("tokens of this run", run, config.tokens_per_run),
            tokens("tokens of today", self.today, config.tokens_per_day),
            BudgetCheck {
                budget: "cost of today",
                used: self.today.used().cost,
                used_with_call: self.today.used_with(call).cost,
                limit: config.cost_per_day,
            },
        ]
    }
}

impl Account {
    fn used(&self) -> Spending {
        self.used_with(Spending::default())
    }

    fn used_with(&self, call: Spending) -> Spending {
        let mut used = self.spent;
        used.add(self.reserved);
        used.add(call);
        used
    }
}

impl Reservation {
    /// Replaces the reservation by the actual cost of the call.
    pub(crate) fn settle(mut self, spending: Spending) {
        self.record(spending);
    }

    fn record(&mut self, spending: Spending) {
        self.is_settled = true;
        let mut accounts = self.budget.lock();
        accounts.today.reserved.subtract(self.reserved);
        if accounts.day == self.day {
            accounts.today.spent.add(spending);
        }
        let account = accounts.runs.entry(self.run.clone()).or_default();
        account.reserved.subtract(self.reserved);
        account.spent.add(spending);
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        if !self.is_settled {
            let minimum = self.minimum;
            self.record(minimum);
        }
    }
}
