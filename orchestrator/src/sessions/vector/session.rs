//! [`VectorSession`]: answers binary frames and reports the episodes of its lease.

use std::sync::Arc;

use axum::body::Bytes;
use env_core::TaskSpec;
use env_core::batch::{Autoreset, BatchError};
use store::ids::{LeaseId, RunId};
use tokio::sync::OwnedSemaphorePermit;

use super::assigner::LeaseAssigner;
use super::env_batch::EnvBatch;
use super::error::VectorError;
use super::frame::{FrameCommand, FrameLayout};
use super::reporter::{EpisodeReporter, EpisodeTally};
use super::run_on;
use crate::engine::error::ServiceError;
use crate::limits::QuotaPermit;
use crate::sessions::session_leases::{SessionLeases, SharedPool};

/// Source of the scenarios of a vector session.
#[derive(Debug, Clone)]
pub enum VectorSource {
    /// One recipe, with seeds of their own for every slot and episode.
    Recipe {
        /// Seed of the batch.
        seed: u64,
    },
    /// Episodes of a lease.
    Lease {
        /// Id of the lease's run.
        run: RunId,
        /// Id of the lease.
        lease: LeaseId,
    },
}

/// Connection of a session to its lease.
pub(crate) struct LeaseBinding {
    pub(crate) leases: Arc<SessionLeases>,
    pub(crate) pool: SharedPool,
    pub(crate) reporter: EpisodeReporter,
}

/// Last frame that was sent, kept so that it can be sent again.
#[derive(Debug, Clone)]
pub struct LastFrame {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// Bytes of the frame.
    pub bytes: Bytes,
}

/// Session with many environments of one task.
pub struct VectorSession {
    pub(crate) token: String,
    pub(crate) task: &'static dyn TaskSpec,
    pub(crate) source: VectorSource,
    pub(crate) autoreset: Autoreset,
    pub(crate) layout: FrameLayout,
    pub(crate) columns: Vec<String>,
    /// The environments; `None` while they are stepped on another thread, and after they were lost.
    pub(crate) batch: Option<Box<EnvBatch>>,
    pub(crate) steps: u64,
    pub(crate) last_frame: LastFrame,
    pub(crate) threads: Arc<rayon::ThreadPool>,
    pub(crate) lease: Option<LeaseBinding>,
    pub(crate) _permit: QuotaPermit,
    pub(crate) _memory: OwnedSemaphorePermit,
}

impl std::fmt::Debug for VectorSession {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VectorSession")
            .field("task", &self.task.id())
            .field("layout", &self.layout)
            .finish_non_exhaustive()
    }
}

impl VectorSession {
    /// Returns the secret id by which a client resumes the session.
    #[must_use]
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Returns the task of all environments.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// Returns the source of the scenarios.
    #[must_use]
    pub const fn source(&self) -> &VectorSource {
        &self.source
    }

    /// Returns what happens to an environment whose episode has ended.
    #[must_use]
    pub const fn autoreset(&self) -> Autoreset {
        self.autoreset
    }

    /// Returns the layout of the frames.
    #[must_use]
    pub const fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Returns the names of the values of an observation.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Returns the number of steps taken, without resets.
    #[must_use]
    pub const fn steps(&self) -> u64 {
        self.steps
    }

    /// Returns the last frame that was sent.
    #[must_use]
    pub const fn last_frame(&self) -> &LastFrame {
        &self.last_frame
    }

    /// Returns the counts of the lease's reported episodes; `None` without a lease.
    #[must_use]
    pub fn tally(&self) -> Option<EpisodeTally> {
        self.lease.as_ref().map(|lease| lease.reporter.tally())
    }

    /// Returns the number of the lease's episodes that no session has started; `None` without a lease.
    #[must_use]
    pub fn remaining_episodes(&self) -> Option<usize> {
        let count = |lease: &LeaseBinding| {
            let pool = lease.pool.lock();
            let groups = pool.free_groups().filter(|group| group.scenario.task().id() == self.task.id());
            groups.map(|group| group.free.len()).sum()
        };
        self.lease.as_ref().map(count)
    }

    /// Answers a binary frame. A repeated number returns the last reply again.
    ///
    /// # Errors
    /// Returns an error if the bytes are not a frame of this session, have the wrong number, or are rejected by the
    /// environments; nothing changes then. After [`VectorError::Lost`] and a scenario that cannot start, the session is
    /// unusable.
    pub async fn answer(&mut self, bytes: Bytes) -> Result<Bytes, VectorError> {
        let frame = self.layout.parse(&bytes)?;
        let (sequence, last) = (frame.sequence, self.last_frame.sequence);
        if sequence == last {
            return Ok(self.last_frame.bytes.clone());
        }
        if sequence != last.wrapping_add(1) {
            return Err(VectorError::Sequence { found: sequence, last });
        }
        if let Some(lease) = &self.lease {
            let pool = lease.pool.lock();
            if pool.run_end.is_deleted() {
                return Err(ServiceError::UnknownRun(pool.run.to_string()).into());
            }
        }
        if let Some(lease) = &self.lease {
            // Each environment may start one episode.
            lease.leases.begin_for_task(&lease.pool, self.task.id(), self.layout.envs).await?;
        }
        let is_step = matches!(frame.command, FrameCommand::Step(_));
        let mut batch = self.batch.take().ok_or(VectorError::Lost)?;
        let layout = self.layout;
        let work = move || {
            // Parses again: the first result borrows from bytes that were moved since. Parsing is cheap.
            let frame = layout.parse(&bytes).map_err(VectorError::from);
            let reply = frame.and_then(|frame| Ok(batch.run(frame.sequence, frame.command)?));
            let finished = batch.assigner.as_mut().map(LeaseAssigner::take_finished).unwrap_or_default();
            (batch, reply, finished)
        };
        let (batch, reply, finished) = run_on(&self.threads, work).await.ok_or(VectorError::Lost)?;
        if !matches!(reply, Err(VectorError::Batch(BatchError::Scenario { .. }))) {
            self.batch = Some(batch);
        }
        if let Some(lease) = &self.lease {
            lease.reporter.submit(finished).await;
        }
        let bytes = reply?;
        self.steps += u64::from(is_step);
        self.last_frame = LastFrame { sequence, bytes: bytes.clone() };
        self.renew_lease().await;
        Ok(bytes)
    }

    /// Renews the lease if a third of its time is over.
    pub async fn renew_lease(&mut self) {
        if let Some(lease) = &self.lease {
            lease.leases.renew(&lease.pool).await;
        }
    }

    /// Ends the session: returns unfinished episodes, waits until all others are reported, and returns their counts.
    pub async fn finish(&mut self) -> Option<EpisodeTally> {
        self.batch = None; // returns unfinished episodes
        match &mut self.lease {
            Some(lease) => Some(lease.reporter.finish().await),
            None => None,
        }
    }
}
