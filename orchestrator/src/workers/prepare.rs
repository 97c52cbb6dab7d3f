//! Turns waiting proposals into scenarios with brackets, in order and in parallel.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use env_core::SeedSpace;
use rayon::prelude::*;
use sqlx::SqlitePool;
use tokio::sync::{Notify, watch};

use crate::curriculum::Proposal;
use crate::store::proposals::{Waiting, unprepared};
use crate::store::{StoreError, from_json, unsigned};
use crate::training::prepare::{Hopeless, Prepared, StorePrepared, prepare};
use crate::training::{TrainingError, Writer};

/// Proposals taken at a time: few, so that a lease that waits is served soon.
const BATCH: i64 = 8;
/// How long it waits after a failure, and at most for a wake-up that was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct Preparer {
    /// Where proposals are read.
    pub readers: SqlitePool,
    /// Where scenarios are written.
    pub writer: Writer,
    /// Rung when there is work.
    pub wake: Arc<Notify>,
    /// Told after every batch, for leases that wait.
    pub ready: watch::Sender<u64>,
    /// Threads of its own: scenarios that are hard to find must not hold up the replay of results.
    pub pool: Arc<rayon::ThreadPool>,
    /// Params that are not worth looking under.
    pub hopeless: Arc<Hopeless>,
}

impl Preparer {
    /// Works until the writer is gone.
    pub async fn run(self) {
        loop {
            match self.batch().await {
                Ok(0) => {
                    let _ = tokio::time::timeout(PAUSE, self.wake.notified()).await;
                }
                Ok(_) => self.ready.send_modify(|n| *n += 1),
                Err(TrainingError::Stopping) => return,
                Err(error) => {
                    tracing::error!(error = %error, "Scenarios could not be prepared; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }

    async fn batch(&self) -> Result<usize, TrainingError> {
        let waiting = {
            let mut conn = self.readers.acquire().await?;
            unprepared(&mut conn, BATCH).await?
        };
        let count = waiting.len();
        if count == 0 {
            return Ok(0);
        }
        let (pool, hopeless) = (Arc::clone(&self.pool), Arc::clone(&self.hopeless));
        let done: Vec<_> = tokio::task::spawn_blocking(move || {
            pool.install(|| waiting.into_par_iter().map(|waiting| one(waiting, &hopeless)).collect())
        })
        .await
        .map_err(|error| TrainingError::invalid("proposal", error.to_string()))?;
        let mut change = StorePrepared { prepared: Vec::new(), hopeless: Vec::new() };
        for (run, seq, prepared) in done {
            match prepared {
                Some(prepared) => change.prepared.push((run, seq, prepared)),
                None => change.hopeless.push((run, seq)),
            }
        }
        self.writer.change(change).await?;
        Ok(count)
    }
}

/// Prepares one proposal; none where that cannot be done. One that is broken must not hold up the others.
fn one(waiting: Waiting, hopeless: &Hopeless) -> (String, i64, Option<Prepared>) {
    let Waiting { run, run_seed, seq, body } = waiting;
    let prepared = std::panic::catch_unwind(AssertUnwindSafe(|| {
        let proposal: Proposal = from_json("a proposal", &body)?;
        prepare(SeedSpace::Training, unsigned(run_seed), unsigned(seq), &proposal, hopeless)
            .map_err(StoreError::from)
    }));
    let prepared = match prepared {
        Ok(Ok(prepared)) => Some(prepared),
        Ok(Err(error)) => {
            tracing::warn!(run, seq, error = %error, "A proposal cannot be prepared and is dropped.");
            None
        }
        Err(_) => {
            tracing::error!(run, seq, "Preparing a proposal panicked; it is dropped.");
            None
        }
    };
    (run, seq, prepared)
}
