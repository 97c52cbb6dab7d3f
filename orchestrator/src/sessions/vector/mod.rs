//! Many environments stepped over one connection, by binary frames: on a recipe, each slot with seeds of its own, or on a
//! lease, whose episodes the slots fly in order and the session reports.

mod book;
mod flock;
pub mod frame;
mod open;
mod reports;

use std::sync::Arc;

use axum::body::Bytes;
use env_core::batch::{Autoreset, BatchError};
use env_core::{ScenarioError, TaskSpec};
use tokio::sync::{OwnedSemaphorePermit, oneshot};

use self::flock::Flock;
pub use self::flock::{DONE, IDLE};
use self::frame::{FrameError, Layout};
pub use self::open::VectorWish;
use self::reports::Reports;
pub use self::reports::Tally;
use super::leased::{Held, Leased};
use super::seat::Seat;
use super::{Full, WishError};
use crate::ids::{LeaseId, RunId};
use crate::training::TrainingError;

/// Why a vector session does not do what is asked.
#[derive(Debug, thiserror::Error)]
pub enum VectorError {
    /// What it was opened with.
    #[error(transparent)]
    Wish(#[from] WishError),
    /// No place is free.
    #[error(transparent)]
    Full(#[from] Full),
    /// All memory that such sessions may have is taken.
    #[error("the environments need {needed_mib} MiB, and {free_mib} of {most_mib} are free")]
    Memory {
        /// What it would need.
        needed_mib: usize,
        /// What is free.
        free_mib: usize,
        /// What there is.
        most_mib: usize,
    },
    /// A frame that is none.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Not the frame's turn.
    #[error("it is {found}; the last was {last}: send {} next, or {last} to get its answer again", .last.wrapping_add(1))]
    Sequence {
        /// Its number.
        found: u32,
        /// The last that was answered.
        last: u32,
    },
    /// The environments.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// The run, its lease, or the store.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// Something failed here.
    #[error("the environments were lost; the server's log says why")]
    Lost,
}

impl From<ScenarioError> for VectorError {
    fn from(source: ScenarioError) -> Self {
        Self::Batch(BatchError::Scenario { env: 0, source })
    }
}

/// What the environments fly.
#[derive(Debug, Clone)]
pub enum Source {
    /// A recipe, with seeds of its own for every slot and episode.
    Recipe {
        /// The batch seed.
        seed: u64,
    },
    /// A lease's episodes.
    Lease {
        /// Its run.
        run: RunId,
        /// The lease.
        lease: LeaseId,
    },
}

/// What a lease's episodes are flown with.
struct Leasing {
    leased: Arc<Leased>,
    pool: Held,
    reports: Reports,
}

/// A vector session.
pub struct Vector {
    token: String,
    task: &'static dyn TaskSpec,
    source: Source,
    autoreset: Autoreset,
    layout: Layout,
    columns: Vec<String>,
    /// None while they are stepped elsewhere.
    flock: Option<Box<Flock>>,
    steps: u64,
    last: (u32, Bytes),
    threads: Arc<rayon::ThreadPool>,
    leasing: Option<Leasing>,
    _seat: Seat,
    _memory: OwnedSemaphorePermit,
}

impl std::fmt::Debug for Vector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Vector")
            .field("task", &self.task.id())
            .field("layout", &self.layout)
            .finish_non_exhaustive()
    }
}

/// Works on a thread for environments, so that no connection waits for them; none where that failed.
async fn on<T: Send + 'static>(
    threads: &rayon::ThreadPool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (done, told) = oneshot::channel();
    threads.spawn(move || {
        let _ = done.send(work());
    });
    told.await.ok()
}

impl Vector {
    /// What it is called: who knows it may come back to it.
    #[must_use]
    pub fn token(&self) -> &str {
        &self.token
    }

    /// What it flies.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// Where its scenarios come from.
    #[must_use]
    pub const fn source(&self) -> &Source {
        &self.source
    }

    /// What happens when an episode is over.
    #[must_use]
    pub const fn autoreset(&self) -> Autoreset {
        self.autoreset
    }

    /// Sizes of its frames.
    #[must_use]
    pub const fn layout(&self) -> Layout {
        self.layout
    }

    /// What the values of an observation are called.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Steps taken, resets not counted.
    #[must_use]
    pub const fn steps(&self) -> u64 {
        self.steps
    }

    /// The last frame and its number.
    #[must_use]
    pub fn last(&self) -> (u32, Bytes) {
        (self.last.0, self.last.1.clone())
    }

    /// What became of the episodes of its lease so far; none where it flies none.
    #[must_use]
    pub fn tally(&self) -> Option<Tally> {
        self.leasing.as_ref().map(|leasing| leasing.reports.tally())
    }

    /// Episodes of the lease that nobody flies yet.
    #[must_use]
    pub fn left(&self) -> Option<usize> {
        let task = self.task.id();
        let of_task = |leasing: &Leasing| {
            let pool = super::leased::lock(&leasing.pool);
            pool.left().filter(|(scenario, _)| scenario.task().id() == task).map(|(_, free)| free).sum()
        };
        self.leasing.as_ref().map(of_task)
    }

    /// Answers a binary frame; what was answered last is answered again.
    ///
    /// # Errors
    /// A frame that is none, or out of turn; nothing has moved then, but for [`VectorError::Lost`] and a scenario that
    /// cannot start: the session is of no use any more.
    pub async fn answer(&mut self, bytes: Bytes) -> Result<Bytes, VectorError> {
        let command = self.layout.read(&bytes)?;
        let (sequence, last) = (command.sequence, self.last.0);
        if sequence == last {
            return Ok(self.last.1.clone());
        }
        if sequence != last.wrapping_add(1) {
            return Err(VectorError::Sequence { found: sequence, last });
        }
        let acts = matches!(command.what, frame::What::Act(_));
        let mut flock = self.flock.take().ok_or(VectorError::Lost)?;
        let layout = self.layout;
        let work = move || {
            // Read twice: what was read first borrows from bytes that have moved since. It costs nothing.
            let told = layout.read(&bytes).map_err(VectorError::from);
            let told = told.and_then(|command| Ok(flock.answer(command.sequence, command.what)?));
            let finished = flock.book.as_mut().map(book::Book::finished).unwrap_or_default();
            (flock, told, finished)
        };
        let (flock, told, finished) = on(&self.threads, work).await.ok_or(VectorError::Lost)?;
        if !matches!(told, Err(VectorError::Batch(BatchError::Scenario { .. }))) {
            self.flock = Some(flock);
        }
        if let Some(leasing) = &self.leasing {
            leasing.reports.hand_in(finished).await;
        }
        let told = told?;
        self.steps += u64::from(acts);
        self.last = (sequence, told.clone());
        self.renew().await;
        Ok(told)
    }

    /// Renews its lease where a third of its time is over.
    pub async fn renew(&mut self) {
        if let Some(leasing) = &self.leasing {
            leasing.leased.renew(&leasing.pool).await;
        }
    }

    /// Ends it; what became of the episodes of its lease, once all are told.
    pub async fn finish(&mut self) -> Option<Tally> {
        self.flock = None; // what was not flown to its end is given back
        match &mut self.leasing {
            Some(leasing) => Some(leasing.reports.finish().await),
            None => None,
        }
    }
}
