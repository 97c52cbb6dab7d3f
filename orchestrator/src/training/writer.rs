//! The one writer: takes changes in order, applies a batch of them in one transaction, and answers after the commit.
//!
//! Each change has a savepoint of its own, so that one that is refused leaves no trace and the others stand. Whatever
//! fails, the runs it touched are dropped from memory and restored from the store when next needed.
//!
//! Changes that somebody waits for with an agent at a standstill (a lease, its renewal) go before those that come in bulk
//! (results, critiques, prepared scenarios): they wait for the one change that is being made, and are committed at once.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Instant;

use sqlx::{Connection, SqliteConnection, query};
use tokio::runtime::Handle;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use super::TrainingError;
use super::work::{Wakes, Work};
use crate::clock::Clock;
use crate::counts;
use crate::store::{Claim, StoreError, Trouble};

/// Changes that may wait.
const QUEUE: usize = 1024;
/// Changes committed together at most.
const BATCH: usize = 64;

/// Something that changes the database.
pub trait Change: Send + 'static {
    /// What the caller learns, after the commit.
    type Answer: Send + 'static;
    /// It takes milliseconds and comes in numbers: others go first.
    const BULK: bool = false;

    /// Makes the change. An error undoes it.
    fn apply(self, work: &mut Work) -> impl Future<Output = Result<Self::Answer, TrainingError>> + Send;
}

/// The handle to the writer.
#[derive(Debug, Clone)]
pub struct Writer {
    urgent: Queue,
    bulk: Queue,
}

type Queue = mpsc::Sender<Box<dyn Errand>>;

/// What waits to be written.
struct Inbox {
    urgent: mpsc::Receiver<Box<dyn Errand>>,
    bulk: mpsc::Receiver<Box<dyn Errand>>,
    /// What comes in bulk has had to wait: it is its turn.
    bulk_next: bool,
}

impl Inbox {
    /// The next errand, once there is one; none when nobody is left who could send any.
    async fn next(&mut self) -> Option<Box<dyn Errand>> {
        if std::mem::take(&mut self.bulk_next)
            && let Ok(errand) = self.bulk.try_recv()
        {
            return Some(errand);
        }
        tokio::select! {
            biased;
            Some(errand) = self.urgent.recv() => {
                self.bulk_next = true;
                Some(errand)
            }
            Some(errand) = self.bulk.recv() => Some(errand),
            else => None,
        }
    }

    /// What else is to be committed with it: whatever is urgent, and if nothing is, what comes in bulk.
    fn more(&mut self, urgent: &mut bool) -> Option<Box<dyn Errand>> {
        if let Ok(errand) = self.urgent.try_recv() {
            *urgent = true;
            return Some(errand);
        }
        if *urgent { None } else { self.bulk.try_recv().ok() }
    }
}

impl Writer {
    /// Starts the writer. It ends, with snapshots taken, when every handle is gone.
    #[must_use]
    pub fn start(
        (conn, claim): (SqliteConnection, Option<Arc<Claim>>),
        clock: Clock,
        wakes: Wakes,
    ) -> (Self, JoinHandle<()>) {
        let (urgent, urgent_inbox) = mpsc::channel(QUEUE);
        let (bulk, bulk_inbox) = mpsc::channel(QUEUE);
        let inbox = Inbox { urgent: urgent_inbox, bulk: bulk_inbox, bulk_next: false };
        let work = Work::new(conn, clock.now(), claim);
        // A thread of its own: it and the database's take turns many times for each change, and must not wait in between
        // for a thread that reads a body.
        let runtime = Handle::current();
        let task = tokio::task::spawn_blocking(move || runtime.block_on(serve(work, inbox, clock, wakes)));
        (Self { urgent, bulk }, task)
    }

    /// How many changes wait: those that go first, and those that come in bulk.
    #[must_use]
    pub fn waiting(&self) -> (usize, usize) {
        (QUEUE - self.urgent.capacity(), QUEUE - self.bulk.capacity())
    }

    /// Makes a change; the answer comes after its commit.
    ///
    /// # Errors
    /// Why it was refused, or the store's failure; `Busy` where too many wait.
    pub async fn change<C: Change>(&self, change: C) -> Result<C::Answer, TrainingError> {
        let (reply, answer) = oneshot::channel();
        let queue = if C::BULK { &self.bulk } else { &self.urgent };
        queue.try_send(Box::new(Parcel { change, reply })).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => TrainingError::Busy,
            mpsc::error::TrySendError::Closed(_) => TrainingError::Stopping,
        })?;
        answer.await.map_err(|_| TrainingError::Stopping)?
    }
}

/// Delivers an answer once it is known whether the commit stood.
type Delivery = Box<dyn FnOnce(Result<(), &StoreError>) + Send>;
type Running<'a> = Pin<Box<dyn Future<Output = Ran> + Send + 'a>>;

/// What came of a change.
struct Ran {
    stands: bool,
    /// What kept it from being stored, where that is the database's and for a while.
    trouble: Option<Trouble>,
    delivery: Delivery,
}

trait Errand: Send {
    fn run<'a>(self: Box<Self>, work: &'a mut Work) -> Running<'a>;
    /// Answers without having tried: no transaction could be begun.
    fn refuse(self: Box<Self>, error: &StoreError);
    /// Others go first.
    fn is_bulk(&self) -> bool;
}

struct Parcel<C: Change> {
    change: C,
    reply: oneshot::Sender<Result<C::Answer, TrainingError>>,
}

impl<C: Change> Errand for Parcel<C> {
    fn run<'a>(self: Box<Self>, work: &'a mut Work) -> Running<'a> {
        Box::pin(async move {
            let Self { change, reply } = *self;
            let answer = change.apply(work).await;
            let stands = answer.is_ok();
            let trouble = answer.as_ref().err().and_then(TrainingError::trouble);
            work.troubled |= trouble.is_some();
            let delivery: Delivery = Box::new(move |committed| {
                let answer = committed.map_err(TrainingError::not_committed).and(answer);
                // A caller that went away does not want its answer any more.
                drop(reply.send(answer));
            });
            Ran { stands, trouble, delivery }
        })
    }

    fn refuse(self: Box<Self>, error: &StoreError) {
        drop(self.reply.send(Err(TrainingError::not_committed(error))));
    }

    fn is_bulk(&self) -> bool {
        C::BULK
    }
}

async fn serve(mut work: Work, mut inbox: Inbox, clock: Clock, wakes: Wakes) {
    while let Some(first) = inbox.next().await {
        let mut deliveries = Vec::new();
        let begun = Instant::now();
        let committed = commit(&mut work, &clock, (first, &mut inbox), &mut deliveries).await;
        counts::commit(deliveries.len(), begun.elapsed(), committed.is_ok());
        if let Err(error) = &committed {
            tracing::error!(error = %error, "A batch of changes could not be committed; nothing of it was kept.");
            drop(query("ROLLBACK").execute(&mut work.conn).await);
            work.forget_all();
            work.troubled = true;
            clock.adopt(-work.adopted); // nothing was moved with it
        }
        work.adopted = 0;
        for delivery in deliveries {
            delivery(committed.as_ref().copied());
        }
        work.ring(&wakes);
    }
    farewell(work).await;
}

/// Makes changes in one transaction: the first, and those that wait when each before it is made.
///
/// What begins and ends a change goes in one statement with what it follows or precedes: each statement is a turn of two
/// threads.
async fn commit(
    work: &mut Work,
    clock: &Clock,
    (first, inbox): (Box<dyn Errand>, &mut Inbox),
    deliveries: &mut Vec<Delivery>,
) -> Result<(), StoreError> {
    let mut urgent = !first.is_bulk();
    attempt(work, clock, ("BEGIN IMMEDIATE; SAVEPOINT change", first), deliveries).await?;
    for _ in 1..BATCH {
        let Some(errand) = inbox.more(&mut urgent) else { break };
        attempt(work, clock, ("RELEASE change; SAVEPOINT change", errand), deliveries).await?;
    }
    work.write_kept().await?;
    query("RELEASE change; COMMIT").execute(&mut work.conn).await?;
    Ok(())
}

/// One change in a savepoint of its own.
async fn attempt(
    work: &mut Work,
    clock: &Clock,
    (begin, errand): (&'static str, Box<dyn Errand>),
    deliveries: &mut Vec<Delivery>,
) -> Result<(), StoreError> {
    if let Err(error) = query(begin).execute(&mut work.conn).await.map_err(StoreError::from) {
        errand.refuse(&error);
        return Err(error);
    }
    work.begin(clock.now()); // it may have come after the one before it
    let Ran { stands, trouble, delivery } = errand.run(work).await;
    deliveries.push(delivery);
    if stands {
        work.keep();
        return Ok(());
    }
    // Where the disk is full SQLite may have undone everything by itself, and there is nothing to go back to.
    let undone = query("ROLLBACK TO change").execute(&mut work.conn).await;
    undone.map_err(|error| trouble.map_or_else(|| error.into(), StoreError::Undone))?;
    work.forget();
    // Whoever restores these runs within this transaction is to find what stands of them.
    work.write_kept().await
}

/// Snapshots of every run in memory, so that a restart restores at once.
async fn farewell(work: Work) {
    let (minds, mut conn) = work.parting();
    for mut mind in minds {
        if let Err(error) = mind.snapshot(&mut conn).await {
            tracing::warn!(run = %mind.run, error = %error, "No snapshot at shutdown; the events restore the run.");
        }
    }
    if let Err(error) = conn.close().await {
        tracing::warn!(error = %error, "The database did not close cleanly; it recovers when opened.");
    }
}
