//! The one writer: takes changes in order, applies a batch of them in one transaction, and answers after the commit.
//!
//! Each change has a savepoint of its own, so that one that is refused leaves no trace and the others stand. Whatever
//! fails, the runs it touched are dropped from memory and restored from the store when next needed.

use std::collections::HashMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use sqlx::{Connection, SqliteConnection, query};
use tokio::sync::{Notify, mpsc, oneshot, watch};
use tokio::task::JoinHandle;

use super::TrainingError;
use super::mind::Mind;
use crate::clock::{Clock, Millis};

/// Changes that may wait.
const QUEUE: usize = 1024;
/// Changes committed together at most.
const BATCH: usize = 64;

/// What the writer works with.
#[derive(Debug)]
pub struct Work {
    /// The connection, inside a transaction.
    pub conn: SqliteConnection,
    /// The time of this batch.
    pub now: Millis,
    minds: HashMap<String, Mind>,
    touched: Vec<String>,
    wake_prepare: bool,
    wake_critique: bool,
    wake_design: bool,
    wake_rollout: bool,
    tell_feed: bool,
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
        self.touched.push(run.to_owned());
        match self.minds.get_mut(run) {
            Some(mind) => Ok((mind, &mut self.conn)),
            None => Err(TrainingError::UnknownRun(run.to_owned())), // cannot be: it was inserted above
        }
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

    /// Makes the change. An error undoes it.
    fn apply(self, work: &mut Work) -> impl Future<Output = Result<Self::Answer, TrainingError>> + Send;
}

/// The handle to the writer.
#[derive(Debug, Clone)]
pub struct Writer {
    queue: mpsc::Sender<Box<dyn Errand>>,
}

impl Writer {
    /// Starts the writer. It ends, with snapshots taken, when every handle is gone.
    #[must_use]
    pub fn start(conn: SqliteConnection, clock: Clock, wakes: Wakes) -> (Self, JoinHandle<()>) {
        let (queue, inbox) = mpsc::channel(QUEUE);
        let now = clock.now();
        let (minds, touched) = (HashMap::new(), Vec::new());
        let work = Work {
            conn,
            now,
            minds,
            touched,
            wake_prepare: false,
            wake_critique: false,
            wake_design: false,
            wake_rollout: false,
            tell_feed: false,
        };
        let task = tokio::spawn(serve(work, inbox, clock, wakes));
        (Self { queue }, task)
    }

    /// Makes a change; the answer comes after its commit.
    ///
    /// # Errors
    /// Why it was refused, or the store's failure; `Busy` where too many wait.
    pub async fn change<C: Change>(&self, change: C) -> Result<C::Answer, TrainingError> {
        let (reply, answer) = oneshot::channel();
        self.queue.try_send(Box::new(Parcel { change, reply })).map_err(|error| match error {
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
}

async fn serve(mut work: Work, mut inbox: mpsc::Receiver<Box<dyn Errand>>, clock: Clock, wakes: Wakes) {
    let mut batch = Vec::with_capacity(BATCH);
    while inbox.recv_many(&mut batch, BATCH).await > 0 {
        work.now = clock.now();
        let mut deliveries = Vec::with_capacity(batch.len());
        let committed = commit(&mut work, batch.drain(..), &mut deliveries).await;
        if let Err(error) = &committed {
            tracing::error!(error = %error, "A batch of changes could not be committed; nothing of it was kept.");
            drop(query("ROLLBACK").execute(&mut work.conn).await);
            work.minds.clear();
        }
        for delivery in deliveries {
            delivery(committed.as_ref().copied());
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

async fn commit(
    work: &mut Work,
    batch: impl Iterator<Item = Box<dyn Errand>>,
    deliveries: &mut Vec<Delivery>,
) -> Result<(), sqlx::Error> {
    if let Err(error) = query("BEGIN IMMEDIATE").execute(&mut work.conn).await {
        batch.for_each(|errand| errand.refuse(&error));
        return Err(error);
    }
    let mut batch = batch;
    while let Some(errand) = batch.next() {
        if let Err(error) = attempt(work, errand, deliveries).await {
            batch.for_each(|errand| errand.refuse(&error));
            return Err(error);
        }
    }
    query("COMMIT").execute(&mut work.conn).await?;
    Ok(())
}

/// One change in a savepoint of its own.
async fn attempt(
    work: &mut Work,
    errand: Box<dyn Errand>,
    deliveries: &mut Vec<Delivery>,
) -> Result<(), sqlx::Error> {
    work.touched.clear();
    if let Err(error) = query("SAVEPOINT change").execute(&mut work.conn).await {
        errand.refuse(&error);
        return Err(error);
    }
    let (stands, delivery) = errand.run(work).await;
    deliveries.push(delivery);
    if !stands {
        query("ROLLBACK TO change").execute(&mut work.conn).await?;
        for run in work.touched.drain(..) {
            work.minds.remove(&run);
        }
    }
    query("RELEASE change").execute(&mut work.conn).await?;
    Ok(())
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
