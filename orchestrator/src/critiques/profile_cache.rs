//! Failure profile of a run's task in memory: read once, since the writer alone changes it.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::SqliteConnection;
use store::StoreError;
use store::critiques::{self, CritiqueCounters};
use store::failure_sectors::{self, InertialSectorRow};
use store::failures::{self, CellCounters, CellKey, EXAMPLES_PER_CELL, FailureExample};
use store::keys::EpisodeKey;

use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::profile::{self, FailureFinding};
use clock::Millis;

/// The failure profile of a run's task, as it is stored.
#[derive(Debug, Default)]
pub struct ProfileCache {
    run: String,
    task: String,
    counters: CritiqueCounters,
    cells: BTreeMap<CellKey, CachedCell>,
    /// Rows by failure mode and inertial sector.
    sectors: BTreeMap<(String, i64), InertialSectorRow>,
}

#[derive(Debug, Default)]
struct CachedCell {
    /// Number of the row; `None` until it is inserted.
    id: Option<i64>,
    counters: CellCounters,
}

/// Rows that a batch of results changes.
#[derive(Default)]
struct ChangedRows {
    cells: BTreeMap<CellKey, Vec<FailureExample>>,
    sectors: BTreeSet<(String, i64)>,
}

impl ProfileCache {
    /// Reads the profile of a task.
    pub(crate) async fn load(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let cells = failures::profile(conn, run, task).await?;
        let cells =
            cells.into_iter().map(|row| (row.key, CachedCell { id: Some(row.id), counters: row.counters }));
        let sectors = failure_sectors::of_task(conn, run, task).await?;
        Ok(Self {
            run: run.to_owned(),
            task: task.to_owned(),
            counters: critiques::counters(conn, run, task).await?,
            cells: cells.collect(),
            sectors: sectors.into_iter().map(|row| ((row.mode.clone(), row.sector), row)).collect(),
        })
    }

    /// Adds the findings of results, here and in the store.
    pub(crate) async fn add(
        &mut self,
        conn: &mut SqliteConnection,
        now: Millis,
        results: &[CritiqueResult],
    ) -> Result<(), StoreError> {
        let mut changed = ChangedRows::default();
        for result in results {
            self.counters.skipped += result.skipped;
            self.counters.failed += result.failed;
            for findings in &result.findings {
                profile::add_findings(&mut self.counters, findings);
                let episode = EpisodeKey { lease: result.job.lease, number: findings.number };
                for failure in &findings.failures {
                    self.add_failure(&mut changed, now, episode, failure);
                }
            }
        }
        critiques::put_counters(conn, &self.run, &self.task, &self.counters).await?;
        let sectors: Vec<_> = changed.sectors.iter().filter_map(|key| self.sectors.get(key)).collect();
        failure_sectors::put(conn, &self.run, &self.task, &sectors).await?;
        self.write_cells(conn, &changed.cells).await
    }

    fn add_failure(
        &mut self,
        changed: &mut ChangedRows,
        now: Millis,
        episode: EpisodeKey,
        failure: &FailureFinding,
    ) {
        let nth = self.counters.criticised;
        if let Some(sector) = failure.inertial.map(i64::from) {
            let key = (failure.key.mode.clone(), sector);
            let new = InertialSectorRow { mode: key.0.clone(), sector, count: 0, weight: 0.0, as_of: nth };
            profile::add_sector(self.sectors.entry(key.clone()).or_insert(new), nth);
            changed.sectors.insert(key);
        }
        let counters = &mut self.cells.entry(failure.key.clone()).or_default().counters;
        profile::add_failure(counters, nth, now, failure);
        let example = example(counters.count, nth, episode, failure);
        changed.cells.entry(failure.key.clone()).or_default().push(example);
    }

    /// Writes the changed cells, and the newest examples of each.
    async fn write_cells(
        &mut self,
        conn: &mut SqliteConnection,
        changed: &BTreeMap<CellKey, Vec<FailureExample>>,
    ) -> Result<(), StoreError> {
        let (mut known, mut new) = (Vec::new(), Vec::new());
        for key in changed.keys() {
            match self.cells.get(key) {
                Some(CachedCell { id: Some(_), counters }) => known.push((key, counters)),
                Some(CachedCell { id: None, counters }) => new.push((key, counters)),
                None => {} // every changed cell is cached
            }
        }
        failures::put_cells(conn, &self.run, &self.task, &known).await?;
        for (key, id) in failures::insert_cells(conn, &self.run, &self.task, &new).await? {
            self.cells.entry(key).or_default().id = Some(id);
        }
        let mut newest = Vec::new();
        for (key, examples) in changed {
            let Some(CachedCell { id: Some(id), .. }) = self.cells.get(key) else { continue }; // it was written above
            let surplus = examples.len().saturating_sub(EXAMPLES_PER_CELL as usize);
            newest.extend(examples[surplus..].iter().map(|example| (*id, example)));
        }
        failures::put_examples(conn, &newest).await
    }
}

/// Builds the example of a failure: number `ordinal` of its cell, in number `episode_ordinal` of the task's criticised episodes.
fn example(
    ordinal: i64,
    episode_ordinal: i64,
    episode: EpisodeKey,
    failure: &FailureFinding,
) -> FailureExample {
    let encounter = failure.encounter;
    FailureExample {
        ordinal,
        episode_ordinal,
        lease: episode.lease,
        number: episode.number,
        agent: i64::from(failure.agent),
        step: i64::from(failure.step),
        sector_deg: failure.sector_deg,
        relative_speed: encounter.map(|found| found.relative_speed),
        steps_left: encounter.map(|found| i64::from(found.steps_left)),
        avoidable: encounter.and_then(|found| found.avoidable),
    }
}
