//! The one writer: it takes work in order, applies a batch of it in one transaction, and answers after the commit.
//!
//! Each change has a savepoint of its own: a change that is refused leaves no trace, and the others are kept. After any failure, the
//! runs that the failed change touched are evicted from memory and restored from the store when next needed.
//!
//! Urgent changes, for which an agent waits (a lease, its renewal), are served before bulk changes (results, critiques, prepared
//! scenarios): an urgent change waits for the one change that is being applied, and is committed at once.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Instant;

use sqlx::{Connection, SqliteConnection};
use store::{DatabaseLock, Outage, StoreError, transactions};
use tokio::runtime::Handle;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use crate::engine::change::{Change, ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use crate::engine::signals::WorkerSignals;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use clock::Clock;

/// Capacity of each queue of waiting work.
const QUEUE_CAPACITY: usize = 1024;
/// Changes committed together at most.
const MAX_BATCH: usize = 64;

/// Handle to the writer. Clones share its queues.
#[derive(Debug, Clone)]
pub struct Writer {
    urgent: JobSender,
    bulk: JobSender,
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
        let (urgent, urgent_inbox) = mpsc::channel(QUEUE_CAPACITY);
        let (bulk, bulk_inbox) = mpsc::channel(QUEUE_CAPACITY);
        let inbox = Inbox { urgent: urgent_inbox, bulk: bulk_inbox, is_bulk_next: false };
        let tx = WriteTx::new(conn, clock.now(), file_lock);
        // The writer has a thread of its own: it alternates with SQLite's thread many times for each change, and must not wait in
        // between for a thread that reads a request body.
        let runtime = Handle::current();
        let task = tokio::task::spawn_blocking(move || runtime.block_on(serve(tx, inbox, clock, signals)));
        (Self { urgent, bulk }, task)
    }

    /// Returns how many jobs wait.
    #[must_use]
    pub fn queue_lengths(&self) -> QueueLengths {
        let waiting = |queue: &JobSender| QUEUE_CAPACITY - queue.capacity();
        QueueLengths { urgent: waiting(&self.urgent), bulk: waiting(&self.bulk) }
    }

    /// Makes a change and returns its answer after the commit.
    ///
    /// # Errors
    /// Returns the error of the change, [`ServiceError::NotCommitted`] if its transaction failed, [`ServiceError::Busy`] if the queue
    /// is full, and [`ServiceError::Stopping`] if the server shuts down.
    pub async fn change<C: Change>(&self, change: C) -> Result<C::Output, ServiceError> {
        let (reply, answer) = oneshot::channel();
        self.send(C::IS_BULK, Box::new(ChangeJob { change, reply }))?;
        answer.await.map_err(|_| ServiceError::Stopping)?
    }

    /// Asks a question about runs in memory.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::change`].
    pub async fn query<Q: StateQuery>(&self, query: Q) -> Result<Q::Output, ServiceError> {
        let (reply, answer) = oneshot::channel();
        self.send(Q::IS_BULK, Box::new(QueryJob { query, reply }))?;
        answer.await.map_err(|_| ServiceError::Stopping)?
    }

    fn send(&self, is_bulk: bool, job: Box<dyn Job>) -> Result<(), ServiceError> {
        let queue = if is_bulk { &self.bulk } else { &self.urgent };
        queue.try_send(job).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => ServiceError::Busy,
            mpsc::error::TrySendError::Closed(_) => ServiceError::Stopping,
        })
    }
}

type JobSender = mpsc::Sender<Box<dyn Job>>;

/// Receiving ends of the queues.
struct Inbox {
    urgent: mpsc::Receiver<Box<dyn Job>>,
    bulk: mpsc::Receiver<Box<dyn Job>>,
    /// True if bulk jobs had to wait: the next batch starts with one.
    is_bulk_next: bool,
}

impl Inbox {
    /// Waits for the first job of a batch; `None` once every handle is dropped.
    async fn next(&mut self) -> Option<Box<dyn Job>> {
        if std::mem::take(&mut self.is_bulk_next)
            && let Ok(job) = self.bulk.try_recv()
        {
            return Some(job);
        }
        tokio::select! {
            biased;
            Some(job) = self.urgent.recv() => {
                self.is_bulk_next = true;
                Some(job)
            }
            Some(job) = self.bulk.recv() => Some(job),
            else => None,
        }
    }

    /// Returns another job for a batch: an urgent one, and a bulk one only while the batch has no urgent job.
    fn more(&mut self, has_urgent: &mut bool) -> Option<Box<dyn Job>> {
        if let Ok(job) = self.urgent.try_recv() {
            *has_urgent = true;
            return Some(job);
        }
        if *has_urgent { None } else { self.bulk.try_recv().ok() }
    }
}

/// Sends an answer once it is known whether the transaction was committed.
type Delivery = Box<dyn FnOnce(Result<(), &StoreError>) + Send>;
type RunningJob<'a> = Pin<Box<dyn Future<Output = JobOutcome> + Send + 'a>>;

/// Outcome of a job before the commit of its batch.
struct JobOutcome {
    is_ok: bool,
    /// Temporary outage of the database that prevented the change from being stored.
    outage: Option<Outage>,
    delivery: Delivery,
}

impl JobOutcome {
    fn new<T: Send + 'static>(
        answer: Result<T, ServiceError>,
        reply: oneshot::Sender<Result<T, ServiceError>>,
    ) -> Self {
        let is_ok = answer.is_ok();
        let outage = answer.as_ref().err().and_then(ServiceError::outage);
        let delivery: Delivery = Box::new(move |committed| {
            let answer = committed.map_err(ServiceError::not_committed).and(answer);
            // The caller may have dropped its end; the answer is then of no use.
            drop(reply.send(answer));
        });
        Self { is_ok, outage, delivery }
    }
}

/// A change or a query with the channel of its answer.
trait Job: Send {
    fn run<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> RunningJob<'a>;
    /// Answers with an error because no transaction could be started.
    fn refuse(self: Box<Self>, error: &StoreError);
    /// True if other jobs are served first.
    fn is_bulk(&self) -> bool;
}

struct ChangeJob<C: Change> {
    change: C,
    reply: oneshot::Sender<Result<C::Output, ServiceError>>,
}

impl<C: Change> Job for ChangeJob<C> {
    fn run<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> RunningJob<'a> {
        Box::pin(async move {
            let answer = self.change.apply(tx).await;
            let outcome = JobOutcome::new(answer, self.reply);
            tx.has_outage |= outcome.outage.is_some();
            outcome
        })
    }

    fn refuse(self: Box<Self>, error: &StoreError) {
        drop(self.reply.send(Err(ServiceError::not_committed(error))));
    }

    fn is_bulk(&self) -> bool {
        C::IS_BULK
    }
}

struct QueryJob<Q: StateQuery> {
    query: Q,
    reply: oneshot::Sender<Result<Q::Output, ServiceError>>,
}

impl<Q: StateQuery> Job for QueryJob<Q> {
    fn run<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> RunningJob<'a> {
        Box::pin(async move {
            let answer = self.query.read(&mut ReadTx::new(tx)).await;
            JobOutcome::new(answer, self.reply)
        })
    }

    fn refuse(self: Box<Self>, error: &StoreError) {
        drop(self.reply.send(Err(ServiceError::not_committed(error))));
    }

    fn is_bulk(&self) -> bool {
        Q::IS_BULK
    }
}

async fn serve(mut tx: WriteTx, mut inbox: Inbox, clock: Clock, signals: WorkerSignals) {
    while let Some(first) = inbox.next().await {
        let mut deliveries = Vec::new();
        let started_at = Instant::now();
        let committed = commit_batch(&mut tx, &clock, first, &mut inbox, &mut deliveries).await;
        metrics::record_commit(deliveries.len(), started_at.elapsed(), committed.is_ok());
        if let Err(error) = &committed {
            tracing::error!(error = %error, "A batch of changes could not be committed and was undone.");
            drop(transactions::roll_back_batch(&mut tx.conn).await);
            tx.discard_all();
            tx.has_outage = true;
            clock.adopt(-tx.clock_shift); // the shift of the deadlines was rolled back
        }
        tx.clock_shift = 0;
        for delivery in deliveries {
            delivery(committed.as_ref().copied());
        }
        tx.outbox.send_signals(&signals);
    }
    close(tx).await;
}

/// Applies the first job, and the jobs that wait after each one, in one transaction.
async fn commit_batch(
    tx: &mut WriteTx,
    clock: &Clock,
    first: Box<dyn Job>,
    inbox: &mut Inbox,
    deliveries: &mut Vec<Delivery>,
) -> Result<(), StoreError> {
    let mut has_urgent = !first.is_bulk();
    let begun = transactions::begin_batch(&mut tx.conn).await;
    apply_in_savepoint(tx, clock, begun, first, deliveries).await?;
    for _ in 1..MAX_BATCH {
        let Some(job) = inbox.more(&mut has_urgent) else { break };
        let begun = transactions::begin_next_change(&mut tx.conn).await;
        apply_in_savepoint(tx, clock, begun, job, deliveries).await?;
    }
    tx.flush().await?;
    transactions::commit_batch(&mut tx.conn).await
}

/// Applies one job in a savepoint of its own; refuses it if the savepoint was not `begun`.
async fn apply_in_savepoint(
    tx: &mut WriteTx,
    clock: &Clock,
    begun: Result<(), StoreError>,
    job: Box<dyn Job>,
    deliveries: &mut Vec<Delivery>,
) -> Result<(), StoreError> {
    if let Err(error) = begun {
        job.refuse(&error);
        return Err(error);
    }
    tx.begin_change(clock.now()); // the job may have arrived after the one before it
    let JobOutcome { is_ok, outage, delivery } = job.run(tx).await;
    deliveries.push(delivery);
    if is_ok {
        tx.keep_change();
        return Ok(());
    }
    // On a full disk SQLite may have rolled back the whole transaction: there is no savepoint to return to.
    let undone = transactions::undo_change(&mut tx.conn).await;
    undone.map_err(|error| outage.map_or(error, StoreError::RolledBack))?;
    tx.discard_change();
    // A later change of this transaction may restore the evicted runs: it must find their kept events in the store.
    tx.flush().await
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
