//! What a vector session flew of a lease, reported beside the stepping.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::{mpsc, oneshot};

use super::super::leased::Leased;
use crate::ids::RunId;
use crate::training::TrainingError;
use crate::training::audit::Claim;

/// Episodes that may wait to be reported; beyond that a step waits.
const WAITING: usize = 1024;
/// Episodes that are reported together.
const BATCH: usize = 256;

/// What became of the episodes that were flown.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Tally {
    /// Flown to their end.
    pub flown: u64,
    /// Of these, their groups can move mastery.
    pub counted: u64,
    /// Of these, kept as a statistic.
    pub stored: u64,
    /// Of these, their lease was over.
    pub late: u64,
    /// Of these, reported before by somebody else.
    pub duplicate: u64,
    /// Of these, refused.
    pub refused: u64,
    /// Of these, lost: they could not be stored, and the server's log says why.
    pub lost: u64,
    /// Of these, not reported yet.
    pub waiting: u64,
}

/// The way to the run.
pub(super) struct Reports {
    claims: Option<mpsc::Sender<Claim>>,
    tally: Arc<Mutex<Tally>>,
    told: Option<oneshot::Receiver<()>>,
}

fn hold(tally: &Mutex<Tally>) -> MutexGuard<'_, Tally> {
    // Nothing that holds it can panic; if something did, the numbers are still numbers.
    tally.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Reports {
    /// Begins to report to this run, until all that was handed in is told and nobody can hand in more.
    pub(super) fn begin(leased: &Arc<Leased>, run: RunId) -> Self {
        let (claims, mut waiting) = mpsc::channel::<Claim>(WAITING);
        let (done, told) = oneshot::channel();
        let tally: Arc<Mutex<Tally>> = Arc::default();
        let (counts, desk) = (Arc::clone(&tally), Arc::clone(leased));
        leased.finish(async move {
            let mut batch = Vec::with_capacity(BATCH);
            while waiting.recv_many(&mut batch, BATCH).await > 0 {
                let receipts = desk.report(&run, &batch).await;
                hold(&counts).count(batch.len() as u64, &receipts);
                if let Err(error) = receipts {
                    tracing::error!(%run, %error, episodes = batch.len(), "Episodes of a session could not be stored.");
                }
                batch.clear();
            }
            let _ = done.send(());
        });
        Self { claims: Some(claims), tally, told: Some(told) }
    }

    /// Hands episodes in; waits where too many wait.
    pub(super) async fn hand_in(&self, claims: Vec<Claim>) {
        let Some(way) = &self.claims else { return };
        {
            let mut tally = hold(&self.tally);
            tally.flown += claims.len() as u64;
            tally.waiting += claims.len() as u64;
        }
        for claim in claims {
            if way.send(claim).await.is_err() {
                let mut tally = hold(&self.tally);
                tally.waiting -= 1;
                tally.lost += 1;
            }
        }
    }

    /// What became of them so far.
    pub(super) fn tally(&self) -> Tally {
        hold(&self.tally).clone()
    }

    /// What became of them, once all are told.
    pub(super) async fn finish(&mut self) -> Tally {
        self.claims = None;
        if let Some(told) = self.told.take() {
            let _ = told.await; // the reporter going away means the same
        }
        self.tally()
    }
}

impl Tally {
    fn count(
        &mut self,
        episodes: u64,
        receipts: &Result<Vec<crate::training::receipt::Receipt>, TrainingError>,
    ) {
        self.waiting = self.waiting.saturating_sub(episodes);
        let Ok(receipts) = receipts else {
            self.lost += episodes;
            return;
        };
        for receipt in receipts {
            let place = match receipt.status {
                "counted" => &mut self.counted,
                "stored" => &mut self.stored,
                "late" => &mut self.late,
                "duplicate" => &mut self.duplicate,
                _ => &mut self.refused,
            };
            *place += 1;
        }
    }
}
