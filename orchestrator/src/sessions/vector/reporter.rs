//! [`EpisodeReporter`]: reports the finished episodes of a vector session in the background.

use std::sync::Arc;

use api_types::{ReceiptStatus, ResultReceipt};
use parking_lot::Mutex;
use serde::Serialize;
use tokio::sync::{mpsc, oneshot};

use crate::engine::error::ServiceError;
use crate::results::reported::ReportedEpisode;
use crate::sessions::session_leases::{SessionLeases, SharedPool};

/// Maximum number of episodes that wait to be reported; more of them block the session.
const MAX_WAITING_EPISODES: usize = 1024;
/// Maximum number of episodes in one report.
const MAX_BATCH_EPISODES: usize = 256;

/// Counts of the finished episodes of a session by the result of their report.
#[derive(Debug, Clone, Default, Serialize)]
pub struct EpisodeTally {
    /// Number of finished episodes.
    pub finished: u64,
    /// Number of episodes whose groups count for mastery.
    pub counted: u64,
    /// Number of episodes that were stored without counting for mastery.
    pub stored: u64,
    /// Number of episodes that were reported after the end of their lease.
    pub late: u64,
    /// Number of episodes that were reported before by another client.
    pub duplicate: u64,
    /// Number of episodes that were rejected.
    pub refused: u64,
    /// Number of episodes that could not be stored; the server's log has the error.
    pub lost: u64,
    /// Number of episodes whose report is pending.
    pub waiting: u64,
}

/// Background reporter of one session.
pub(crate) struct EpisodeReporter {
    /// Queue of episodes; `None` once the session has finished.
    queue: Option<mpsc::Sender<ReportedEpisode>>,
    tally: Arc<Mutex<EpisodeTally>>,
    /// Signal that the queue is closed and everything in it was reported.
    drained: Option<oneshot::Receiver<()>>,
}

impl EpisodeReporter {
    /// Starts a reporter. It ends once the queue is closed and empty; a shutdown of the server waits for it.
    pub(crate) fn start(leases: &Arc<SessionLeases>, pool: &SharedPool) -> Self {
        let (queue, mut waiting) = mpsc::channel::<ReportedEpisode>(MAX_WAITING_EPISODES);
        let (drained_sender, drained) = oneshot::channel();
        let tally: Arc<Mutex<EpisodeTally>> = Arc::default();
        let (shared_tally, shared_leases) = (Arc::clone(&tally), Arc::clone(leases));
        let (run, pool) = (pool.lock().run.clone(), Arc::clone(pool));
        leases.spawn_tracked(async move {
            let mut batch = Vec::with_capacity(MAX_BATCH_EPISODES);
            while waiting.recv_many(&mut batch, MAX_BATCH_EPISODES).await > 0 {
                let receipts = shared_leases.report(&pool, &batch).await;
                shared_tally.lock().count(batch.len() as u64, &receipts);
                if let Err(error) = receipts {
                    tracing::error!(%run, %error, episodes = batch.len(), "Episodes of a session could not be stored.");
                }
                batch.clear();
            }
            shared_leases.spawn_store_abandoned(&pool);
            let _ = drained_sender.send(());
        });
        Self { queue: Some(queue), tally, drained: Some(drained) }
    }

    /// Queues finished episodes; waits while the queue is full.
    pub(super) async fn submit(&self, claims: Vec<ReportedEpisode>) {
        let Some(queue) = &self.queue else { return };
        {
            let mut tally = self.tally.lock();
            tally.finished += claims.len() as u64;
            tally.waiting += claims.len() as u64;
        }
        for claim in claims {
            if queue.send(claim).await.is_err() {
                let mut tally = self.tally.lock();
                tally.waiting -= 1;
                tally.lost += 1;
            }
        }
    }

    /// Returns the current counts.
    pub(super) fn tally(&self) -> EpisodeTally {
        self.tally.lock().clone()
    }

    /// Closes the queue, waits until all episodes are reported, and returns the final counts.
    pub(super) async fn finish(&mut self) -> EpisodeTally {
        self.queue = None;
        if let Some(drained) = self.drained.take() {
            let _ = drained.await; // an error means that the reporter has ended, too
        }
        self.tally()
    }
}

impl EpisodeTally {
    fn count(&mut self, episodes: u64, receipts: &Result<Vec<ResultReceipt>, ServiceError>) {
        self.waiting = self.waiting.saturating_sub(episodes);
        let Ok(receipts) = receipts else {
            self.lost += episodes;
            return;
        };
        for receipt in receipts {
            let count = match receipt.status {
                ReceiptStatus::Counted => &mut self.counted,
                ReceiptStatus::Stored => &mut self.stored,
                ReceiptStatus::Late => &mut self.late,
                ReceiptStatus::Duplicate => &mut self.duplicate,
                ReceiptStatus::Audited | ReceiptStatus::Failed | ReceiptStatus::Refused => &mut self.refused,
            };
            *count += 1;
        }
    }
}
