//! What a run's task has shown so far: read once, then held in memory, since the writer alone changes it.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::SqliteConnection;

use super::super::profile::{self, Failing};
use super::Done;
use crate::clock::Millis;
use crate::store::StoreError;
use crate::store::critiques::{self, CritiqueSums, Job};
use crate::store::failures::{self, CellKey, CellSums, Example, RING};
use crate::store::inertial::{self, SectorRow};

/// The failure profile of a run's task, as it is stored.
#[derive(Debug, Default)]
pub struct Ledger {
    sums: CritiqueSums,
    /// With the number of each.
    cells: BTreeMap<CellKey, (Option<i64>, CellSums)>,
    /// By mode and inertial sector.
    sectors: BTreeMap<(String, i64), SectorRow>,
}

/// What a batch touches of it.
#[derive(Default)]
struct Touched {
    cells: BTreeMap<CellKey, Vec<Example>>,
    sectors: BTreeSet<(String, i64)>,
}

impl Ledger {
    pub(super) async fn load(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let cells = failures::profile(conn, run, task).await?;
        let sectors = inertial::of_task(conn, run, task).await?;
        Ok(Self {
            sums: critiques::sums(conn, run, task).await?,
            cells: cells.into_iter().map(|(number, key, sums)| (key, (Some(number), sums))).collect(),
            sectors: sectors.into_iter().map(|row| ((row.mode.clone(), row.sector), row)).collect(),
        })
    }

    /// Enters what jobs showed, here and in the store.
    pub(super) async fn enter(
        &mut self,
        conn: &mut SqliteConnection,
        (run, task): (&str, &str),
        now: Millis,
        all: &[Done],
    ) -> Result<(), StoreError> {
        let mut touched = Touched::default();
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
        critiques::put_sums(conn, run, task, &self.sums).await?;
        let sectors: Vec<_> = touched.sectors.iter().filter_map(|key| self.sectors.get(key)).collect();
        inertial::put(conn, run, task, &sectors).await?;
        self.write_cells(conn, (run, task), &touched.cells).await
    }

    fn fail(&mut self, touched: &mut Touched, now: Millis, (job, number): (&Job, i64), failing: &Failing) {
        let place = self.sums.criticised;
        if let Some(sector) = failing.inertial.map(i64::from) {
            let key = (failing.key.mode.clone(), sector);
            let fresh = SectorRow { mode: key.0.clone(), sector, count: 0, weight: 0.0, as_of: place };
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
        touched: &BTreeMap<CellKey, Vec<Example>>,
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
            let old = examples.len().saturating_sub(RING as usize);
            newest.extend(examples[old..].iter().map(|example| (*cell, example)));
        }
        failures::put_examples(conn, &newest).await
    }
}

fn example(nth: i64, place: i64, lease: i64, number: i64, failing: &Failing) -> Example {
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
