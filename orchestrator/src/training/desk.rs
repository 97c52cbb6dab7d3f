//! Where everybody who flies for a run comes to: leases are handed out, and what was flown is handed in. Trainers come over
//! `/v1`, sessions from beside it.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use tokio::sync::watch;

use super::audit::{Audited, Claim, Found, audit};
use super::ended::Ended;
use super::eval_lease::take_eval;
use super::evaluation::lease::take_suite;
use super::lease::{Granted, Purpose, TakeLease};
use super::receipt::Receipt;
use super::report::Report;
use super::rollout::take::TakeGroup;
use super::{RunSettings, TrainingError, Writer};
use crate::ids::{LeaseId, RunId};
use crate::store::policies::PolicyRow;
use crate::store::{from_json, runs};

/// How long a lease waits for scenarios to be prepared before whoever asks is told to come again.
const PATIENCE: Duration = Duration::from_secs(10);

/// Results that are written at a time: leases are granted between two parts.
const PART: usize = 25;

/// Hands out leases and takes results.
#[derive(Debug, Clone)]
pub struct Desk {
    /// The one writer.
    pub writer: Writer,
    /// Connections that read.
    pub readers: SqlitePool,
    /// Moves whenever scenarios were prepared.
    pub ready: watch::Receiver<u64>,
    /// Who waits for a lease, run by run.
    pub gates: Arc<Gates>,
    /// Threads that replay what is claimed and prepare eval leases: behind those that answer and write.
    pub replaying: Arc<rayon::ThreadPool>,
}

/// One gate per run; who waits at it is let through in order, so that a large lease gets its turn.
#[derive(Debug, Default)]
pub struct Gates(std::sync::Mutex<HashMap<RunId, Arc<tokio::sync::Mutex<()>>>>);

impl Gates {
    fn of(&self, run: &RunId) -> Arc<tokio::sync::Mutex<()>> {
        // Nothing that holds it can panic; if something did, the map is still a map.
        let mut gates = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        gates.retain(|_, gate| Arc::strong_count(gate) > 1); // nobody waits there
        Arc::clone(gates.entry(run.clone()).or_default())
    }
}

impl Desk {
    /// Grants a lease; where scenarios are still being prepared it waits a while.
    ///
    /// # Errors
    /// A wish that cannot be granted, and [`TrainingError::NotReady`] where preparing takes too long.
    pub async fn lease(&self, wish: TakeLease) -> Result<Granted, TrainingError> {
        if let Some(evaluation) = wish.evaluation.filter(|_| wish.purpose == Purpose::Eval) {
            return take_suite(&self.writer, &self.replaying, wish, evaluation).await;
        }
        if wish.purpose == Purpose::Eval {
            return take_eval(&self.writer, &self.replaying, wish).await;
        }
        let run = wish.run.clone();
        self.when_ready(&run, || self.writer.change(wish.clone())).await
    }

    /// Grants a lease of one group to a worker that flies the run's policy, with that policy; waits likewise.
    ///
    /// # Errors
    /// As [`Desk::lease`]; `Paused` where there is no policy any more.
    pub async fn rollout(&self, run: &RunId) -> Result<(LeaseId, PolicyRow), TrainingError> {
        self.when_ready(run, || self.writer.change(TakeGroup { run: run.clone() })).await
    }

    /// Tries until scenarios are prepared, in turn with all who want some of this run.
    async fn when_ready<T, F>(&self, run: &RunId, attempt: impl Fn() -> F) -> Result<T, TrainingError>
    where
        F: Future<Output = Result<Option<T>, TrainingError>>,
    {
        let gate = self.gates.of(run);
        let mut ready = self.ready.clone();
        let waiting = async {
            let _turn = gate.lock().await;
            loop {
                ready.mark_unchanged();
                if let Some(granted) = attempt().await? {
                    return Ok(granted);
                }
                ready.changed().await.map_err(|_| TrainingError::Stopping)?;
            }
        };
        tokio::time::timeout(PATIENCE, waiting).await.unwrap_or(Err(TrainingError::NotReady))
    }

    /// Replays what is claimed and stores it; what it says is on disk.
    ///
    /// # Errors
    /// No such run, or the store's: what was written by then is, and answered as a duplicate when it is reported again. A claim that
    /// is wrong is refused by itself.
    pub async fn report(
        &self,
        run: RunId,
        policy_version: Option<u32>,
        claims: Vec<Claim>,
    ) -> Result<(Vec<Receipt>, Ended), TrainingError> {
        let (results, mut found) = self.audited(&run, claims).await?;
        let (mut receipts, mut ended) = (Vec::with_capacity(results.len()), Ended::default());
        let mut results = results.into_iter();
        loop {
            let part: Vec<_> = results.by_ref().take(PART).collect();
            let (run, found) = (run.clone(), std::mem::take(&mut found));
            let report = Report { run, policy_version, results: part, found };
            let (told, more) = self.writer.change(report).await?;
            receipts.extend(told);
            ended.add(more);
            if results.len() == 0 {
                return Ok((receipts, ended));
            }
        }
    }

    /// Replays what is claimed, and stores nothing.
    ///
    /// # Errors
    /// No such run, or the store's.
    pub async fn audited(
        &self,
        run: &RunId,
        claims: Vec<Claim>,
    ) -> Result<(Vec<Audited>, Vec<Found>), TrainingError> {
        let mut conn = self.readers.acquire().await?;
        let row = runs::get(&mut conn, run.as_str()).await?;
        let row = row.ok_or_else(|| TrainingError::UnknownRun(run.to_string()))?;
        let settings: RunSettings = from_json("a run's settings", &row.settings)?;
        audit(&mut conn, &self.replaying, (run, settings), claims).await
    }
}
