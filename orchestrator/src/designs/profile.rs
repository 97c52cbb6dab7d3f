//! Failure profile of a run's task, loaded and weighted in one place for designers and for the API.

use designer::FailureProfile;
use designer::profile::{FailureCell, ModeProfile, SectorWeight};
use sqlx::SqliteConnection;
use store::critiques::{self, CritiqueCounters};
use store::failures::{self, CellCounters, CellKey};
use store::{StoreError, failure_sectors, to_u32, to_u64};

use crate::critiques::profile::{decay, total_weight};

/// A cell with its current weight.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightedCell {
    /// Number of the cell, which its examples refer to.
    pub cell: i64,
    /// Failure mode, sector and band of the cell.
    pub key: CellKey,
    /// Counters of the cell as stored.
    pub counters: CellCounters,
    /// Current weight of its failures.
    pub weight: f64,
}

/// The failure profile of a run's task.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CollectedProfile {
    /// Counters of the criticised episodes.
    pub counters: CritiqueCounters,
    /// Cells of the profile, ordered by mode, sector and band.
    pub cells: Vec<WeightedCell>,
    /// The same failures by mode and inertial sector.
    pub inertial: Vec<(String, SectorWeight)>,
}

/// A failure mode of a profile.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeSummary<'a> {
    /// Number of failures of this mode.
    pub count: i64,
    /// Current weight of the failures.
    pub weight: f64,
    /// Cells of the mode.
    pub cells: Vec<&'a WeightedCell>,
    /// Failures of the mode by inertial sector.
    pub inertial: Vec<SectorWeight>,
}

impl CollectedProfile {
    /// Loads the profile of a run's task.
    ///
    /// # Errors
    /// Returns [`StoreError::Database`] if a query fails.
    pub async fn load(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let counters = critiques::counters(conn, run, task).await?;
        let weight = |stored: f64, as_of: i64| decay(stored, counters.criticised - as_of);
        let cells = failures::profile(conn, run, task).await?.into_iter();
        let cells = cells.map(|cell| {
            let weight = weight(cell.counters.weight, cell.counters.as_of);
            WeightedCell { cell: cell.id, key: cell.key, counters: cell.counters, weight }
        });
        let inertial = failure_sectors::of_task(conn, run, task).await?.into_iter().map(|row| {
            let sector = SectorWeight {
                sector: to_u32(row.sector),
                count: to_u64(row.count),
                weight: weight(row.weight, row.as_of),
            };
            (row.mode, sector)
        });
        Ok(Self { cells: cells.collect(), inertial: inertial.collect(), counters })
    }

    /// Returns the current weight of all criticised episodes.
    #[must_use]
    pub fn weight(&self) -> f64 {
        total_weight(self.counters.criticised)
    }

    /// Returns the summary of a failure mode.
    #[must_use]
    pub fn mode(&self, name: &str) -> ModeSummary<'_> {
        let cells: Vec<_> = self.cells.iter().filter(|cell| cell.key.mode == name).collect();
        let inertial = self.inertial.iter().filter(|(mode, _)| mode == name);
        ModeSummary {
            count: cells.iter().map(|cell| cell.counters.count).sum(),
            weight: cells.iter().map(|cell| cell.weight).sum(),
            inertial: inertial.map(|(_, sector)| *sector).collect(),
            cells,
        }
    }

    /// Returns the modes that occurred, each once, in order.
    #[must_use]
    pub fn modes(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.cells.iter().map(|cell| cell.key.mode.as_str()).collect();
        names.dedup(); // cells are ordered by mode
        names
    }

    /// Returns the profile in the form for designers.
    #[must_use]
    pub fn profile(&self, task: &str) -> FailureProfile {
        let modes = self.modes().into_iter().map(|name| {
            let mode = self.mode(name);
            ModeProfile {
                mode: name.to_owned(),
                count: to_u64(mode.count),
                weight: mode.weight,
                cells: mode.cells.iter().map(|cell| failure_cell(cell)).collect(),
                inertial_sectors: mode.inertial,
            }
        });
        FailureProfile {
            task: task.to_owned(),
            criticised: to_u64(self.counters.criticised),
            weight: self.weight(),
            modes: modes.collect(),
        }
    }
}

fn failure_cell(cell: &WeightedCell) -> FailureCell {
    let WeightedCell { key, counters, weight, .. } = cell;
    let share = |n: i64| key.band.filter(|_| counters.count > 0).map(|_| n as f64 / counters.count as f64);
    FailureCell {
        sector: key.sector,
        band: key.band,
        count: to_u64(counters.count),
        weight: *weight,
        avoidable_share: share(counters.avoidable),
        mean_steps_left: share(counters.steps_left),
    }
}
