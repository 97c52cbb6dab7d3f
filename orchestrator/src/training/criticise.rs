//! Criticising what was reported: what an episode shows about why score was lost goes into the failure profile.
//!
//! It runs behind the acknowledgement. Episodes wait in a durable queue; a job of it is some episodes of one lease and
//! task, and leaves the queue in the transaction that enters what they showed.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::AssertUnwindSafe;

use rayon::prelude::*;
use sqlx::SqliteConnection;

use super::profile::{self, Note};
use super::{Change, Happening, TrainingError, Work};
use crate::clock::Millis;
use crate::store::critiques::{self, Job};
use crate::store::failures::{self, CellKey, CellSums, Example, RING};
use crate::store::inertial::{self, SectorRow};
use crate::store::{StoreError, layouts};
use material::Stage;
pub use material::{Material, load};

mod material;

/// Episodes of a job at most.
pub const JOB: usize = 64;

/// A job that was done.
#[derive(Debug)]
pub struct Done {
    /// The job.
    pub job: Job,
    /// What its episodes showed.
    pub notes: Vec<Note>,
    /// Episodes sampled out.
    pub skipped: i64,
    /// Episodes that could not be criticised.
    pub failed: i64,
    /// Why, for the first of them.
    pub reason: Option<String>,
}

/// Criticises the episodes of a job, in parallel. One that cannot be criticised is counted and holds up no other.
#[must_use]
pub fn criticise(material: Material) -> Done {
    let Material { job, chosen, skipped } = material;
    let (mut notes, mut reasons) = (Vec::with_capacity(chosen.len()), Vec::new());
    let noted: Vec<_> = chosen.into_par_iter().map(|(number, stage)| note(number, stage)).collect();
    for noted in noted {
        match noted {
            Ok(note) => notes.push(note),
            Err(reason) => reasons.push(reason),
        }
    }
    Done { job, notes, skipped, failed: reasons.len() as i64, reason: reasons.into_iter().next() }
}

fn note(number: i64, stage: Result<Stage, String>) -> Result<Note, String> {
    let told = stage.and_then(|Stage { scenario, layout, log }| {
        let task = scenario.task();
        let critique = std::panic::catch_unwind(AssertUnwindSafe(|| task.critique(&scenario, &log)))
            .map_err(|_| "the critique panicked".to_owned())?
            .map_err(|error| error.to_string())?;
        Ok(Note { layout, ..Note::of(number, &critique, task.speed_bands())? })
    });
    told.map_err(|reason| format!("episode {number}: {reason}"))
}

/// Enters what jobs showed into the profiles, and takes the jobs off the queue. A job that is not on it any more was
/// entered before, and is left alone.
#[derive(Debug)]
pub struct Enter(pub Vec<Done>);

impl Change for Enter {
    type Answer = ();
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        let mut by_task: BTreeMap<(String, String), Vec<Done>> = BTreeMap::new();
        let ids: Vec<i64> = self.0.iter().map(|done| done.job.id).collect();
        let taken = critiques::take(&mut work.conn, &ids).await?;
        for done in self.0.into_iter().filter(|done| taken.contains(&done.job.id)) {
            by_task.entry((done.job.run.clone(), done.job.task.clone())).or_default().push(done);
        }
        for ((run, task), all) in by_task {
            enter(&mut work.conn, work.now, &run, &task, &all).await?;
            let notes = || all.iter().flat_map(|done| &done.notes);
            let mut modes = BTreeMap::new();
            for failing in notes().flat_map(|note| &note.failures) {
                *modes.entry(failing.key.mode.as_str()).or_default() += 1;
            }
            let criticised = notes().count();
            work.tell(&run, &Happening::Failures { task: &task, criticised, modes })?;
        }
        Ok(())
    }
}

/// A cell that a batch touches.
struct Touched {
    sums: CellSums,
    examples: Vec<Example>,
}

async fn enter(
    conn: &mut SqliteConnection,
    now: Millis,
    run: &str,
    task: &str,
    all: &[Done],
) -> Result<(), StoreError> {
    let mut sums = critiques::sums(conn, run, task).await?;
    let known: BTreeMap<CellKey, CellSums> =
        failures::profile(conn, run, task).await?.into_iter().map(|(_, key, sums)| (key, sums)).collect();
    let mut cells: BTreeMap<CellKey, Touched> = BTreeMap::new();
    let mut sectors = Sectors::read(conn, run, task).await?;
    for done in all {
        sums.skipped += done.skipped;
        sums.failed += done.failed;
        for note in &done.notes {
            profile::enter(&mut sums, note);
            for failing in &note.failures {
                sectors.enter(sums.criticised, failing);
                let cell = cells.entry(failing.key.clone()).or_insert_with(|| Touched {
                    sums: known.get(&failing.key).copied().unwrap_or_default(),
                    examples: Vec::new(),
                });
                profile::enter_failure(&mut cell.sums, sums.criticised, now, failing);
                let nth = cell.sums.count;
                cell.examples.push(example(nth, sums.criticised, done.job.lease, note.number, failing));
            }
        }
    }
    blame(conn, all).await?;
    critiques::put_sums(conn, run, task, &sums).await?;
    sectors.write(conn, run, task).await?;
    let sums: Vec<_> = cells.iter().map(|(key, touched)| (key, &touched.sums)).collect();
    let numbers = failures::put_cells(conn, run, task, &sums).await?;
    let mut newest = Vec::new();
    for (key, Touched { examples, .. }) in &cells {
        let Some(cell) = numbers.get(key) else { continue }; // cannot be: it was written above
        let old = examples.len().saturating_sub(RING as usize);
        newest.extend(examples[old..].iter().map(|example| (*cell, example)));
    }
    failures::put_examples(conn, &newest).await
}

/// Tells layouts what went wrong on them.
async fn blame(conn: &mut SqliteConnection, all: &[Done]) -> Result<(), StoreError> {
    let mut by_layout: BTreeMap<i64, Vec<BTreeSet<&str>>> = BTreeMap::new();
    for note in all.iter().flat_map(|done| &done.notes).filter(|note| !note.failures.is_empty()) {
        let Some(layout) = note.layout else { continue };
        let modes = note.failures.iter().map(|failing| failing.key.mode.as_str()).collect();
        by_layout.entry(layout).or_default().push(modes);
    }
    for (layout, episodes) in by_layout {
        layouts::blame(conn, layout, &episodes).await?;
    }
    Ok(())
}

/// The profile by inertial sector: small enough to be held whole.
struct Sectors {
    rows: BTreeMap<(String, i64), SectorRow>,
    touched: BTreeSet<(String, i64)>,
}

impl Sectors {
    async fn read(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let rows = inertial::of_task(conn, run, task).await?;
        let rows = rows.into_iter().map(|row| ((row.mode.clone(), row.sector), row)).collect();
        Ok(Self { rows, touched: BTreeSet::new() })
    }

    fn enter(&mut self, place: i64, failing: &profile::Failing) {
        let Some(sector) = failing.inertial.map(i64::from) else { return };
        let mode = failing.key.mode.clone();
        let key = (mode.clone(), sector);
        let fresh = SectorRow { mode, sector, count: 0, weight: 0.0, as_of: place };
        profile::enter_sector(self.rows.entry(key.clone()).or_insert(fresh), place);
        self.touched.insert(key);
    }

    async fn write(&self, conn: &mut SqliteConnection, run: &str, task: &str) -> Result<(), StoreError> {
        let rows: Vec<_> = self.touched.iter().filter_map(|key| self.rows.get(key)).collect();
        inertial::put(conn, run, task, &rows).await
    }
}

fn example(nth: i64, place: i64, lease: i64, number: i64, failing: &profile::Failing) -> Example {
    let met = failing.met;
    Example {
        nth,
        place,
        lease,
        number,
        agent: i64::from(failing.agent),
        step: i64::from(failing.step),
        bearing_deg: met.map(|m| m.bearing_deg),
        relative_speed: met.map(|m| m.relative_speed),
        steps_left: met.map(|m| i64::from(m.steps_left)),
        avoidable: met.and_then(|m| m.avoidable),
    }
}

#[cfg(test)]
mod tests;
