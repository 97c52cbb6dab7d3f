//! The one writer: takes changes in order, applies a batch of them in one transaction, and answers after the commit.
//!
//! Each change has a savepoint of its own, so that one that is refused leaves no trace and the others stand. Whatever
//! fails, the runs it touched are dropped from memory and restored from the store when next needed.
//!
//! Changes that somebody waits for with an agent at a standstill (a lease, its renewal) go before those that come in bulk
//! (results, critiques, prepared scenarios): they wait for the one change that is being made, and are committed at once.

use std::collections::{BTreeMap, HashMap};
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use sqlx::{Connection, SqliteConnection, query};
use tokio::runtime::Handle;
use tokio::sync::{Notify, mpsc, oneshot, watch};
use tokio::task::JoinHandle;

use super::TrainingError;
use super::mind::Mind;
use crate::clock::{Clock, Millis};
use crate::store::curriculum::Event;
use crate::store::events::Told;
use crate::store::{self, StoreError};

/// Changes that may wait.
const QUEUE: usize = 1024;
/// Changes committed together at most.
const BATCH: usize = 64;

/// What the writer works with.
#[derive(Debug)]
pub struct Work {
    /// The connection, inside a transaction.
    pub conn: SqliteConnection,
    /// The time of this change.
    pub now: Millis,
    minds: HashMap<String, Mind>,
    touched: Vec<String>,
    /// What a change tells the listeners.
    pub(super) telling: Vec<Told>,
    kept: Kept,
    /// Events told of each run since its ring was looked at.
    told: HashMap<String, u32>,
    wake_events: bool,
    wake_prepare: bool,
    wake_critique: bool,
    wake_design: bool,
    wake_rollout: bool,
    tell_feed: bool,
}

/// What changes leave to the end of their transaction: many rows take one statement.
#[derive(Debug, Default)]
struct Kept {
    /// What is told.
    told: Vec<Told>,
    /// Events of curricula, by run.
    events: BTreeMap<String, Vec<Event>>,
}

/// Who is woken after a commit that made work for them.
#[derive(Debug, Clone, Default)]
pub struct Wakes {
    /// The worker that prepares scenarios.
    pub prepare: Arc<Notify>,
    /// The worker that criticises episodes.
    pub critique: Arc<Notify>,
    /// The worker that asks designers.
    pub design: Arc<Notify>,
    /// Whoever listens to what happens: moves with each commit that told something.
    pub events: Arc<watch::Sender<u64>>,
    /// The worker that flies policies.
    pub rollout: Arc<Notify>,
    /// Moves whenever groups were pushed to a feed, for trainers that wait.
    pub feed: watch::Sender<u64>,
}

impl Work {
    /// A run, restored if it is not in memory, and the connection to change it with.
    ///
    /// # Errors
    /// No such run, or one that cannot be restored.
    pub async fn mind(&mut self, run: &str) -> Result<(&mut Mind, &mut SqliteConnection), TrainingError> {
        if !self.minds.contains_key(run) {
            let mind = Mind::load(&mut self.conn, run).await?;
            self.minds.insert(run.to_owned(), mind);
        }
        if !self.touched.iter().any(|touched| touched == run) {
            self.touched.push(run.to_owned());
        }
        match self.minds.get_mut(run) {
            Some(mind) => Ok((mind, &mut self.conn)),
            None => Err(TrainingError::UnknownRun(run.to_owned())), // cannot be: it was inserted above
        }
    }

    /// Keeps what a change that stands leaves to the end of its transaction.
    fn keep(&mut self) {
        self.kept.told.append(&mut self.telling);
        for run in &self.touched {
            if let Some(mind) = self.minds.get_mut(run) {
                let events = mind.take_unwritten();
                if !events.is_empty() {
                    self.kept.events.entry(run.clone()).or_default().extend(events);
                }
            }
        }
    }

    /// Writes what was kept.
    async fn write_kept(&mut self) -> Result<(), sqlx::Error> {
        let Kept { told, events } = std::mem::take(&mut self.kept);
        for (run, events) in events {
            store::curriculum::append(&mut self.conn, &run, &events).await.map_err(StoreError::into_sqlx)?;
        }
        self.write_told(&told).await.map_err(StoreError::into_sqlx)
    }

    /// Notes that something is told of a run, and wakes who listens after the commit; how much since its ring was looked at.
    pub(super) fn told(&mut self, run: &str) -> u32 {
        self.wake_events = true;
        if let Some(told) = self.told.get_mut(run) {
            *told += 1;
            return *told;
        }
        // A run that was not heard of since the start is looked at soon.
        let first = super::happening::TRIM_EVERY / 2;
        self.told.insert(run.to_owned(), first);
        first
    }

    /// Notes that a run's ring was looked at.
    pub(super) fn trimmed(&mut self, run: &str) {
        self.told.insert(run.to_owned(), 0);
    }

    /// Wakes the worker that prepares scenarios, after the commit.
    pub const fn wake_prepare(&mut self) {
        self.wake_prepare = true;
    }

    /// Wakes the worker that criticises episodes, after the commit.
    pub const fn wake_critique(&mut self) {
        self.wake_critique = true;
    }

    /// Wakes the worker that asks designers, after the commit.
    pub const fn wake_design(&mut self) {
        self.wake_design = true;
    }

    /// Wakes the worker that flies policies, after the commit.
    pub const fn wake_rollout(&mut self) {
        self.wake_rollout = true;
    }

    /// Tells trainers that wait for groups, after the commit.
    pub const fn tell_feed(&mut self) {
        self.tell_feed = true;
    }
}

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
    pub fn start(conn: SqliteConnection, clock: Clock, wakes: Wakes) -> (Self, JoinHandle<()>) {
        let (urgent, urgent_inbox) = mpsc::channel(QUEUE);
        let (bulk, bulk_inbox) = mpsc::channel(QUEUE);
        let inbox = Inbox { urgent: urgent_inbox, bulk: bulk_inbox, bulk_next: false };
        let now = clock.now();
        let work = Work {
            conn,
            now,
            minds: HashMap::new(),
            touched: Vec::new(),
            telling: Vec::new(),
            kept: Kept::default(),
            told: HashMap::new(),
            wake_events: false,
            wake_prepare: false,
            wake_critique: false,
            wake_design: false,
            wake_rollout: false,
            tell_feed: false,
        };
        // A thread of its own: it and the database's take turns many times for each change, and must not wait in between
        // for a thread that reads a body.
        let runtime = Handle::current();
        let task = tokio::task::spawn_blocking(move || runtime.block_on(serve(work, inbox, clock, wakes)));
        (Self { urgent, bulk }, task)
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
type Delivery = Box<dyn FnOnce(Result<(), &sqlx::Error>) + Send>;
type Running<'a> = Pin<Box<dyn Future<Output = (bool, Delivery)> + Send + 'a>>;

trait Errand: Send {
    fn run<'a>(self: Box<Self>, work: &'a mut Work) -> Running<'a>;
    /// Answers without having tried: no transaction could be begun.
    fn refuse(self: Box<Self>, error: &sqlx::Error);
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
            let delivery: Delivery = Box::new(move |committed| {
                let answer = committed.map_err(TrainingError::not_committed).and(answer);
                // A caller that went away does not want its answer any more.
                drop(reply.send(answer));
            });
            (stands, delivery)
        })
    }

    fn refuse(self: Box<Self>, error: &sqlx::Error) {
        drop(self.reply.send(Err(TrainingError::not_committed(error))));
    }

    fn is_bulk(&self) -> bool {
        C::BULK
    }
}

async fn serve(mut work: Work, mut inbox: Inbox, clock: Clock, wakes: Wakes) {
    while let Some(first) = inbox.next().await {
        let mut deliveries = Vec::new();
        let committed = commit(&mut work, &clock, (first, &mut inbox), &mut deliveries).await;
        if let Err(error) = &committed {
            tracing::error!(error = %error, "A batch of changes could not be committed; nothing of it was kept.");
            drop(query("ROLLBACK").execute(&mut work.conn).await);
            work.minds.clear();
            work.telling.clear();
            work.kept = Kept::default();
        }
        for delivery in deliveries {
            delivery(committed.as_ref().copied());
        }
        if std::mem::take(&mut work.wake_events) {
            wakes.events.send_modify(|commits| *commits += 1);
        }
        if std::mem::take(&mut work.wake_prepare) {
            wakes.prepare.notify_one();
        }
        if std::mem::take(&mut work.wake_critique) {
            wakes.critique.notify_one();
        }
        if std::mem::take(&mut work.wake_design) {
            wakes.design.notify_one();
        }
        if std::mem::take(&mut work.wake_rollout) {
            wakes.rollout.notify_one();
        }
        if std::mem::take(&mut work.tell_feed) {
            wakes.feed.send_modify(|pushes| *pushes += 1);
        }
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
) -> Result<(), sqlx::Error> {
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
) -> Result<(), sqlx::Error> {
    work.touched.clear();
    if let Err(error) = query(begin).execute(&mut work.conn).await {
        errand.refuse(&error);
        return Err(error);
    }
    work.now = clock.now(); // it may have come after the one before it
    let (stands, delivery) = errand.run(work).await;
    deliveries.push(delivery);
    if stands {
        work.keep();
        return Ok(());
    }
    query("ROLLBACK TO change").execute(&mut work.conn).await?;
    work.telling.clear();
    for run in work.touched.drain(..) {
        work.minds.remove(&run);
    }
    // Whoever restores these runs within this transaction is to find what stands of them.
    work.write_kept().await
}

/// Snapshots of every run in memory, so that a restart restores at once.
async fn farewell(mut work: Work) {
    for mind in work.minds.values_mut() {
        if let Err(error) = mind.snapshot(&mut work.conn).await {
            tracing::warn!(run = %mind.run, error = %error, "No snapshot at shutdown; the events restore the run.");
        }
    }
    if let Err(error) = work.conn.close().await {
        tracing::warn!(error = %error, "The database did not close cleanly; it recovers when opened.");
    }
}
