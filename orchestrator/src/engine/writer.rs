//! The one writer: it takes work in order, applies a batch of it in one transaction, and answers after the commit.
//!
//! Each change has a savepoint of its own: a change that is refused leaves no trace, and the others are kept. After any failure, the
//! runs that the failed change touched are evicted from memory and restored from the store when next needed.
//!
//! Urgent changes, for which an agent waits (a lease, its renewal), are served before bulk changes (results, critiques, prepared
//! scenarios): an urgent change waits for the one change that is being applied, and is committed at once. Queries are answered
//! between two transactions, also while the database is locked or full.
//!
//! While an outage lasts (`storage_health`), a batch that cannot begin is refused at once with all changes that wait, and the writer
//! probes until the database can be written again. A damaged database is not written any more.

mod inbox;
mod job;

use std::sync::Arc;
use std::time::{Duration, Instant};

use sqlx::{Connection, SqliteConnection};
use store::{DatabaseLock, Outage, StoreError, transactions};
use tokio::runtime::Handle;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

pub use self::inbox::QUEUE_CAPACITY;
use self::inbox::{Inbox, Queues, Work};
use self::job::{ChangeJob, Delivery, Job, JobOutcome, QueryJob, WaitingQuery};
use crate::engine::change::{Change, StateQuery};
use crate::engine::commit_log::CommitLog;
use crate::engine::error::ServiceError;
use crate::engine::signals::WorkerSignals;
use crate::engine::storage_health::StorageHealth;
use crate::engine::write_probe::WriteProbe;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use clock::Clock;

/// Changes committed together at most.
const MAX_BATCH: usize = 64;
/// Longest time that the writer waits for another process's lock. After that the lock is an outage.
const LOCK_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause between two attempts to get the lock.
const LOCK_RETRY_PAUSE: Duration = Duration::from_millis(10);
/// Time between two write probes while an outage lasts.
const PROBE_INTERVAL: Duration = Duration::from_millis(500);

/// Handle to the writer. Clones share its queues.
#[derive(Debug, Clone)]
pub struct Writer {
    queues: Queues,
    health: StorageHealth,
    commits: CommitLog,
}

/// Numbers of jobs that wait for the writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueueLengths {
    /// Jobs that are served first.
    pub urgent: usize,
    /// Jobs that are served when no urgent job waits.
    pub bulk: usize,
}

impl Writer {
    /// Starts the writer. It ends, with a snapshot of each run in memory, once every handle is dropped.
    #[must_use]
    pub fn start(
        conn: SqliteConnection,
        file_lock: Option<Arc<DatabaseLock>>,
        clock: Clock,
        signals: WorkerSignals,
    ) -> (Self, JoinHandle<()>) {
        let (queues, inbox) = inbox::create();
        let health = StorageHealth::new(file_lock.as_ref().map(|lock| lock.path().to_owned()));
        let tx = WriteTx::new(conn, clock.now(), file_lock);
        let commits = CommitLog::default();
        let serving = WriterLoop {
            tx,
            inbox,
            clock,
            signals,
            health: health.clone(),
            commits: commits.clone(),
            probed_at: None,
        };
        // The writer has a thread of its own: it alternates with SQLite's thread many times for each change, and must not wait in
        // between for a thread that reads a request body.
        let runtime = Handle::current();
        let task = tokio::task::spawn_blocking(move || runtime.block_on(serving.serve()));
        (Self { queues, health, commits }, task)
    }

    /// Returns how many jobs wait.
    #[must_use]
    pub fn queue_lengths(&self) -> QueueLengths {
        let Queues { urgent, bulk, .. } = &self.queues;
        QueueLengths { urgent: inbox::waiting(urgent), bulk: inbox::waiting(bulk) }
    }

    /// Knowledge of the server about the state of its database.
    #[must_use]
    pub const fn health(&self) -> &StorageHealth {
        &self.health
    }

    /// Log of the latest commits.
    #[must_use]
    pub const fn commits(&self) -> &CommitLog {
        &self.commits
    }

    /// Makes a change and returns its answer after the commit.
    ///
    /// # Errors
    /// Returns the error of the change, [`ServiceError::NotCommitted`] if its transaction failed, [`ServiceError::Busy`] if the queue
    /// is full, and [`ServiceError::Stopping`] if the server shuts down.
    pub async fn change<C: Change>(&self, change: C) -> Result<C::Output, ServiceError> {
        let (reply, answer) = oneshot::channel();
        let queue = if C::IS_BULK { &self.queues.bulk } else { &self.queues.urgent };
        let job: Box<dyn Job> = Box::new(ChangeJob { change, reply });
        queue.try_send(job).map_err(|error| queue_error(&error))?;
        answer.await.map_err(|_| ServiceError::Stopping)?
    }

    /// Asks a question about runs in memory. The answer does not wait for a lock on the database.
    ///
    /// # Errors
    /// Returns the error of the query, [`ServiceError::Busy`] if the queue is full, and [`ServiceError::Stopping`] if the server
    /// shuts down.
    pub async fn query<Q: StateQuery>(&self, query: Q) -> Result<Q::Output, ServiceError> {
        let (reply, answer) = oneshot::channel();
        let query: Box<dyn WaitingQuery> = Box::new(QueryJob { query, reply });
        self.queues.queries.try_send(query).map_err(|error| queue_error(&error))?;
        answer.await.map_err(|_| ServiceError::Stopping)?
    }
}

/// The error of work that could not be queued.
const fn queue_error<T>(error: &mpsc::error::TrySendError<T>) -> ServiceError {
    match error {
        mpsc::error::TrySendError::Full(_) => ServiceError::Busy,
        mpsc::error::TrySendError::Closed(_) => ServiceError::Stopping,
    }
}

/// State of the writer's thread.
struct WriterLoop {
    tx: WriteTx,
    inbox: Inbox,
    clock: Clock,
    signals: WorkerSignals,
    health: StorageHealth,
    commits: CommitLog,
    /// When the last write probe of an outage ended.
    probed_at: Option<Instant>,
}

impl WriterLoop {
    async fn serve(mut self) {
        if let Err(error) = transactions::wait_briefly_for_locks(&mut self.tx.conn).await {
            tracing::warn!(error = %error, "Queries wait up to 5 s while another process locks the database.");
        }
        loop {
            let next = self.inbox.next();
            let work = match self.health.outage() {
                None => next.await,
                Some(_) => match tokio::time::timeout(PROBE_INTERVAL, next).await {
                    Ok(work) => work,
                    Err(_) => {
                        self.probe().await;
                        continue;
                    }
                },
            };
            match work {
                None => break,
                Some(Work::Query(query)) => self.answer(query).await,
                Some(Work::Batch(first)) => {
                    let is_committed = self.apply_batch(first).await;
                    self.answer_queries().await;
                    if is_committed && self.health.outage().is_some() && self.is_probe_due() {
                        self.probe().await;
                    }
                }
            }
        }
        close(self.tx).await;
    }

    async fn answer(&mut self, query: Box<dyn WaitingQuery>) {
        if let Some(outage) = query.answer(&mut self.tx).await {
            self.health.report_failed_read(outage);
        }
    }

    async fn answer_queries(&mut self) {
        for query in self.inbox.take_queries() {
            self.answer(query).await;
        }
    }

    fn is_probe_due(&self) -> bool {
        self.probed_at.is_none_or(|at| at.elapsed() >= PROBE_INTERVAL)
    }

    /// Ends the outage if a write probe can be committed.
    async fn probe(&mut self) {
        let (reply, mut answer) = oneshot::channel();
        self.apply_batch(Box::new(ChangeJob { change: WriteProbe, reply })).await;
        if matches!(answer.try_recv(), Ok(Ok(()))) {
            self.health.recover();
        }
        self.probed_at = Some(Instant::now());
    }

    /// Applies the first job, and the jobs that wait after it, in one transaction, and answers them. Returns true if it was committed.
    async fn apply_batch(&mut self, first: Box<dyn Job>) -> bool {
        if let Some(outage) = self.health.refusal() {
            self.refuse_all(first, &StoreError::RolledBack(outage));
            return false;
        }
        let started_at = Instant::now();
        if let Err(error) = self.begin().await {
            self.record_commit(1, started_at, false);
            self.report(&error, "A batch of changes could not begin.");
            drop(transactions::roll_back_batch(&mut self.tx.conn).await);
            self.refuse_all(first, &error);
            return false;
        }
        let mut deliveries = Vec::new();
        let committed = self.commit_batch(first, &mut deliveries).await;
        self.record_commit(deliveries.len(), started_at, committed.is_ok());
        if let Err(error) = &committed {
            self.report(error, "A batch of changes could not be committed and was undone.");
            drop(transactions::roll_back_batch(&mut self.tx.conn).await);
            self.tx.discard_all();
            self.clock.adopt(-self.tx.clock_shift); // the shift of the deadlines was rolled back
        }
        self.tx.clock_shift = 0;
        for delivery in deliveries {
            delivery(committed.as_ref().copied());
        }
        self.tx.outbox.send_signals(&self.signals);
        committed.is_ok()
    }

    /// Records a commit in the metrics and in the log of the latest ones.
    fn record_commit(&self, changes: usize, started_at: Instant, succeeded: bool) {
        let duration = started_at.elapsed();
        metrics::record_commit(changes, duration, succeeded);
        self.commits.record(changes, duration, succeeded);
    }

    /// Answers the first job, and all jobs that wait, with an error.
    fn refuse_all(&mut self, first: Box<dyn Job>, error: &StoreError) {
        first.refuse(error);
        for job in self.inbox.take_jobs() {
            job.refuse(error);
        }
    }

    /// Records a batch that failed. An outage is logged once, when it begins.
    fn report(&mut self, error: &StoreError, failure: &'static str) {
        self.tx.has_outage = true;
        match error.outage() {
            Some(outage) => {
                tracing::debug!(error = %error, "{failure}");
                self.health.report_failed_change(outage);
            }
            None => tracing::error!(error = %error, "{failure}"),
        }
    }

    /// Begins the transaction of a batch. Waits for another process's lock, unless the lock is known, and answers queries meanwhile.
    async fn begin(&mut self) -> Result<(), StoreError> {
        self.tx.check_files().await?;
        let is_known = self.health.outage() == Some(Outage::Locked);
        let deadline = Instant::now() + if is_known { Duration::ZERO } else { LOCK_TIMEOUT };
        loop {
            match transactions::begin_batch(&mut self.tx.conn).await {
                Err(error) if error.outage() == Some(Outage::Locked) && Instant::now() < deadline => {
                    self.answer_queries().await;
                    tokio::time::sleep(LOCK_RETRY_PAUSE).await;
                }
                begun => return begun,
            }
        }
    }

    /// Applies the first job, and the jobs that wait after each one, in the transaction that was begun.
    async fn commit_batch(
        &mut self,
        first: Box<dyn Job>,
        deliveries: &mut Vec<Delivery>,
    ) -> Result<(), StoreError> {
        let mut has_urgent = !first.is_bulk();
        self.apply_in_savepoint(Ok(()), first, deliveries).await?;
        for _ in 1..MAX_BATCH {
            let Some(job) = self.inbox.more(&mut has_urgent) else { break };
            let begun = transactions::begin_next_change(&mut self.tx.conn).await;
            self.apply_in_savepoint(begun, job, deliveries).await?;
        }
        self.tx.flush().await?;
        transactions::commit_batch(&mut self.tx.conn).await
    }

    /// Applies one job in a savepoint of its own; refuses it if the savepoint was not `begun`.
    async fn apply_in_savepoint(
        &mut self,
        begun: Result<(), StoreError>,
        job: Box<dyn Job>,
        deliveries: &mut Vec<Delivery>,
    ) -> Result<(), StoreError> {
        if let Err(error) = begun {
            job.refuse(&error);
            return Err(error);
        }
        let tx = &mut self.tx;
        tx.begin_change(self.clock.now()); // the job may have arrived after the one before it
        let JobOutcome { is_ok, outage, delivery } = job.run(tx).await;
        deliveries.push(delivery);
        if is_ok {
            tx.keep_change();
            return Ok(());
        }
        if let Some(outage) = outage {
            self.health.report_failed_change(outage);
        }
        if outage == Some(Outage::Damaged) {
            return Err(StoreError::RolledBack(Outage::Damaged)); // earlier changes of the batch are not acknowledged either
        }
        // On a full disk SQLite may have rolled back the whole transaction: there is no savepoint to return to.
        let undone = transactions::undo_change(&mut tx.conn).await;
        undone.map_err(|error| outage.map_or(error, StoreError::RolledBack))?;
        tx.discard_change();
        // A later change of this transaction may restore the evicted runs: it must find their kept events in the store.
        tx.flush().await
    }
}

/// Stores a snapshot of every run in memory, so that a restart restores them at once, and closes the database.
async fn close(tx: WriteTx) {
    let (states, mut conn) = tx.into_parts();
    for mut state in states {
        if let Err(error) = state.snapshot(&mut conn).await {
            tracing::warn!(run = %state.run, error = %error, "The snapshot of a run at shutdown failed; the events restore the run.");
        }
    }
    if let Err(error) = conn.close().await {
        tracing::warn!(error = %error, "The database did not close cleanly; it recovers when it is opened.");
    }
}
