//! Criticising what was reported: what an episode shows about why score was lost goes into the failure profile.
//!
//! It runs behind the acknowledgement. Episodes wait in a durable queue; a job of it is some episodes of one lease and
//! task, and leaves the queue in the transaction that enters what they showed.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::AssertUnwindSafe;

use rayon::prelude::*;
use sqlx::SqliteConnection;

use crate::critiques::profile_cache::ProfileCache;
use crate::critiques::critique_input::{CritiqueInput, CritiqueEpisode};
use crate::critiques::profile::EpisodeFindings;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::store::critiques::{self, CritiqueJob};
use crate::store::{StoreError, layout_outcomes};

/// Episodes of a job at most.
pub const MAX_JOB_EPISODES: usize = 64;

/// A job that was done.
#[derive(Debug)]
pub struct CritiqueResult {
    /// The job.
    pub job: CritiqueJob,
    /// What its episodes showed.
    pub notes: Vec<EpisodeFindings>,
    /// Episodes sampled out.
    pub skipped: i64,
    /// Episodes that could not be criticised.
    pub failed: i64,
    /// Why, for the first of them.
    pub reason: Option<String>,
}

/// Criticises the episodes of a job, in parallel. One that cannot be criticised is counted and holds up no other.
#[must_use]
pub fn criticise(material: CritiqueInput) -> CritiqueResult {
    let CritiqueInput { job, chosen, skipped } = material;
    let (mut notes, mut reasons) = (Vec::with_capacity(chosen.len()), Vec::new());
    let noted: Vec<_> = chosen.into_par_iter().map(|(number, stage)| note(number, stage)).collect();
    for noted in noted {
        match noted {
            Ok(note) => notes.push(note),
            Err(reason) => reasons.push(reason),
        }
    }
    CritiqueResult { job, notes, skipped, failed: reasons.len() as i64, reason: reasons.into_iter().next() }
}

fn note(number: i64, stage: Result<CritiqueEpisode, String>) -> Result<EpisodeFindings, String> {
    let told = stage.and_then(|CritiqueEpisode { scenario, layout, log }| {
        let task = scenario.task();
        let critique = std::panic::catch_unwind(AssertUnwindSafe(|| task.critique(&scenario, &log)))
            .map_err(|_| "the critique panicked".to_owned())?
            .map_err(|error| error.to_string())?;
        Ok(EpisodeFindings { layout, ..EpisodeFindings::of(number, &critique, task.speed_bands())? })
    });
    told.map_err(|reason| format!("episode {number}: {reason}"))
}

/// Enters what jobs showed into the profiles, and takes the jobs off the queue. A job that is not on it any more was
/// entered before, and is left alone.
#[derive(Debug)]
pub struct StoreCritiques(pub Vec<CritiqueResult>);

impl Change for StoreCritiques {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let mut by_task: BTreeMap<(String, String), Vec<CritiqueResult>> = BTreeMap::new();
        let ids: Vec<i64> = self.0.iter().map(|done| done.job.id).collect();
        let taken = critiques::dequeue(&mut tx.conn, &ids).await?;
        for done in self.0.into_iter().filter(|done| taken.contains(&done.job.id)) {
            by_task.entry((done.job.run.clone(), done.job.task.clone())).or_default().push(done);
        }
        for ((run, task), all) in by_task {
            let now = tx.now;
            let RunTx { state: mind, conn, .. } = tx.run(&run).await?;
            let mut ledger = match mind.ledgers.remove(&task) {
                Some(ledger) => ledger,
                None => ProfileCache::load(conn, &run, &task).await?,
            };
            ledger.enter(conn, (&run, &task), now, &all).await?;
            blame(conn, &all).await?;
            mind.ledgers.insert(task.clone(), ledger);
            let notes = || all.iter().flat_map(|done| &done.notes);
            let mut modes = BTreeMap::new();
            for failing in notes().flat_map(|note| &note.failures) {
                *modes.entry(failing.key.mode.as_str()).or_default() += 1;
            }
            let criticised = notes().count();
            tx.emit(&run, &RunEvent::Failures { task: &task, criticised, modes })?;
        }
        Ok(())
    }
}

/// Tells layouts what went wrong on them.
async fn blame(conn: &mut SqliteConnection, all: &[CritiqueResult]) -> Result<(), StoreError> {
    let mut by_layout: BTreeMap<i64, Vec<BTreeSet<&str>>> = BTreeMap::new();
    for note in all.iter().flat_map(|done| &done.notes).filter(|note| !note.failures.is_empty()) {
        let Some(layout) = note.layout else { continue };
        let modes = note.failures.iter().map(|failing| failing.key.mode.as_str()).collect();
        by_layout.entry(layout).or_default().push(modes);
    }
    for (layout, episodes) in by_layout {
        layout_outcomes::add_faults(conn, layout, &episodes).await?;
    }
    Ok(())
}

