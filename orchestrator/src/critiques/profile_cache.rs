//! What a run's task has shown so far: read once, then held in memory, since the writer alone changes it.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::SqliteConnection;

use crate::critiques::profile;
use crate::critiques::profile::FailureFinding;
use crate::critiques::criticise::CritiqueResult;
use crate::clock::Millis;
use crate::store::StoreError;
use crate::store::critiques::{self, CritiqueCounters, CritiqueJob};
use crate::store::failures::{self, CellKey, CellCounters, FailureExample, EXAMPLES_PER_CELL};
use crate::store::failure_sectors::{self, InertialSectorRow};

/// The failure profile of a run's task, as it is stored.
#[derive(Debug, Default)]
pub struct ProfileCache {
    sums: CritiqueCounters,
    /// With the number of each.
    cells: BTreeMap<CellKey, (Option<i64>, CellCounters)>,
    /// By mode and inertial sector.
    sectors: BTreeMap<(String, i64), InertialSectorRow>,
}

/// What a batch touches of it.
#[derive(Default)]
struct ChangedRows {
    cells: BTreeMap<CellKey, Vec<FailureExample>>,
    sectors: BTreeSet<(String, i64)>,
}

impl ProfileCache {
    pub(crate) async fn load(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let cells = failures::profile(conn, run, task).await?;
        let sectors = failure_sectors::of_task(conn, run, task).await?;
        Ok(Self {
            sums: critiques::counters(conn, run, task).await?,
            cells: cells.into_iter().map(|cell| (cell.key, (Some(cell.id), cell.counters))).collect(),
            sectors: sectors.into_iter().map(|row| ((row.mode.clone(), row.sector), row)).collect(),
        })
    }

    /// Enters what jobs showed, here and in the store.
    pub(crate) async fn enter(
        &mut self,
        conn: &mut SqliteConnection,
        (run, task): (&str, &str),
        now: Millis,
        all: &[CritiqueResult],
    ) -> Result<(), StoreError> {
        let mut touched = ChangedRows::default();
        for done in all {
            self.sums.skipped += done.skipped;
            self.sums.failed += done.failed;
            for note in &done.notes {
                profile::enter(&mut self.sums, note);
                for failing in &note.failures {
                    self.fail(&mut touched, now, (&done.job, note.number), failing);
                }
            }
        }
        critiques::put_counters(conn, run, task, &self.sums).await?;
        let sectors: Vec<_> = touched.sectors.iter().filter_map(|key| self.sectors.get(key)).collect();
        failure_sectors::put(conn, run, task, &sectors).await?;
        self.write_cells(conn, (run, task), &touched.cells).await
    }

    fn fail(&mut self, touched: &mut ChangedRows, now: Millis, (job, number): (&CritiqueJob, i64), failing: &FailureFinding) {
        let place = self.sums.criticised;
        if let Some(sector) = failing.inertial.map(i64::from) {
            let key = (failing.key.mode.clone(), sector);
            let fresh = InertialSectorRow { mode: key.0.clone(), sector, count: 0, weight: 0.0, as_of: place };
            profile::enter_sector(self.sectors.entry(key.clone()).or_insert(fresh), place);
            touched.sectors.insert(key);
        }
        let (_, sums) = self.cells.entry(failing.key.clone()).or_default();
        profile::enter_failure(sums, place, now, failing);
        let example = example(sums.count, place, job.lease, number, failing);
        touched.cells.entry(failing.key.clone()).or_default().push(example);
    }

    /// Writes cells that were touched, and the newest examples of each.
    async fn write_cells(
        &mut self,
        conn: &mut SqliteConnection,
        (run, task): (&str, &str),
        touched: &BTreeMap<CellKey, Vec<FailureExample>>,
    ) -> Result<(), StoreError> {
        let (mut known, mut new) = (Vec::new(), Vec::new());
        for key in touched.keys() {
            match self.cells.get(key) {
                Some((Some(_), sums)) => known.push((key, sums)),
                Some((None, sums)) => new.push((key, sums)),
                None => {} // cannot be: it was entered
            }
        }
        failures::put_cells(conn, run, task, &known).await?;
        for (key, number) in failures::insert_cells(conn, run, task, &new).await? {
            self.cells.entry(key).or_default().0 = Some(number);
        }
        let mut newest = Vec::new();
        for (key, examples) in touched {
            let Some((Some(cell), _)) = self.cells.get(key) else { continue }; // cannot be: it was written above
            let old = examples.len().saturating_sub(EXAMPLES_PER_CELL as usize);
            newest.extend(examples[old..].iter().map(|example| (*cell, example)));
        }
        failures::put_examples(conn, &newest).await
    }
}

fn example(nth: i64, place: i64, lease: i64, number: i64, failing: &FailureFinding) -> FailureExample {
    let met = failing.met;
    FailureExample {
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
