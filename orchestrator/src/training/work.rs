//! What changes work with: the connection, the runs in memory, and what is left to the end of the transaction.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use sqlx::SqliteConnection;
use tokio::sync::{Notify, watch};

use super::TrainingError;
use super::history::{Counts, SeenTo};
use super::mind::Mind;
use crate::clock::Millis;
use crate::store::curriculum::Event;
use crate::store::events::Told;
use crate::store::history::Part;
use crate::store::{self, Claim, StoreError, Trouble};

/// What the writer works with.
#[derive(Debug)]
pub struct Work {
    /// The connection, inside a transaction.
    pub conn: SqliteConnection,
    /// The time of this change.
    pub now: Millis,
    /// That the database is this server's, and still where it was.
    pub(super) claim: Option<Arc<Claim>>,
    /// A change could not be stored since it was last looked whether one can be.
    pub(super) troubled: bool,
    /// How far the clock was let jump in this transaction.
    pub(super) adopted: i64,
    minds: HashMap<String, Mind>,
    /// Runs that the change looked at.
    touched: Vec<String>,
    /// What a change tells the listeners.
    pub(super) telling: Vec<Told>,
    /// What a change adds to the history of runs, by run and task.
    counting: Counts,
    /// When each run's history was last seen to.
    seen_to: HashMap<String, SeenTo>,
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
    /// What came of runs' tasks.
    counts: Counts,
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
    /// Nothing in memory, nobody to be woken.
    pub(super) fn new(conn: SqliteConnection, now: Millis, claim: Option<Arc<Claim>>) -> Self {
        Self {
            conn,
            now,
            claim,
            troubled: false,
            adopted: 0,
            minds: HashMap::new(),
            touched: Vec::new(),
            telling: Vec::new(),
            counting: Counts::default(),
            seen_to: HashMap::new(),
            kept: Kept::default(),
            told: HashMap::new(),
            wake_events: false,
            wake_prepare: false,
            wake_critique: false,
            wake_design: false,
            wake_rollout: false,
            tell_feed: false,
        }
    }

    /// A change is about to be made, at this time.
    pub(super) fn begin(&mut self, now: Millis) {
        self.touched.clear();
        self.now = now;
    }

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

    /// The runs in memory.
    pub fn minds(&self) -> impl Iterator<Item = &Mind> {
        self.minds.values()
    }

    /// What is added to a task's history by this change.
    pub(super) fn count(&mut self, run: &str, task: &str) -> &mut Part {
        self.counting.of(run, task)
    }

    /// Of how many groups of a task the blind panel was looked at in this transaction.
    pub(super) fn panels(&self, run: &str, task: &str) -> i64 {
        self.counting.panels(run, task) + self.kept.counts.panels(run, task)
    }

    /// Keeps what a change that stands leaves to the end of its transaction.
    pub(super) fn keep(&mut self) {
        self.kept.told.append(&mut self.telling);
        self.kept.counts.join(&mut self.counting);
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
    pub(super) async fn write_kept(&mut self) -> Result<(), StoreError> {
        if self.claim.as_ref().is_some_and(|claim| !claim.is_there()) {
            return Err(StoreError::Undone(Trouble::Gone));
        }
        let Kept { told, events, counts } = std::mem::take(&mut self.kept);
        for (run, events) in events {
            store::curriculum::append(&mut self.conn, &run, &events).await?;
        }
        for (run, parts) in counts.0 {
            let seen_to = self.seen_to.entry(run.clone()).or_default();
            seen_to.write(&mut self.conn, (&run, self.minds.get(&run)), parts, self.now).await?;
        }
        self.write_told(&told).await
    }

    /// Forgets what a change did that was undone: the runs it touched are restored when next needed.
    pub(super) fn forget(&mut self) {
        self.telling.clear();
        self.counting = Counts::default();
        for run in self.touched.drain(..) {
            self.minds.remove(&run);
        }
    }

    /// Forgets what a whole transaction did.
    pub(super) fn forget_all(&mut self) {
        self.forget();
        self.minds.clear();
        self.kept = Kept::default();
    }

    /// The runs in memory, and the connection.
    pub(super) fn parting(self) -> (impl Iterator<Item = Mind>, SqliteConnection) {
        (self.minds.into_values(), self.conn)
    }

    /// Wakes whom the commit made work for.
    pub(super) fn ring(&mut self, wakes: &Wakes) {
        if std::mem::take(&mut self.wake_events) {
            wakes.events.send_modify(|commits| *commits += 1);
        }
        for (wake, worker) in [
            (&mut self.wake_prepare, &wakes.prepare),
            (&mut self.wake_critique, &wakes.critique),
            (&mut self.wake_design, &wakes.design),
            (&mut self.wake_rollout, &wakes.rollout),
        ] {
            if std::mem::take(wake) {
                worker.notify_one();
            }
        }
        if std::mem::take(&mut self.tell_feed) {
            wakes.feed.send_modify(|pushes| *pushes += 1);
        }
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
