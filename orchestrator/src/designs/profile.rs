//! A failure profile as it stands: collected from the store once, weighed once, for whoever shows it and whoever designs
//! from it.

use designer::FailureProfile;
use designer::profile::{FailureCell, ModeProfile, SectorWeight};
use sqlx::SqliteConnection;

use crate::store::critiques::{self, CritiqueCounters};
use crate::store::failures::{self, CellKey, CellCounters};
use crate::store::{StoreError, failure_sectors, to_u32, to_u64};
use crate::critiques::profile::{fade, weight_of};

/// A cell with what it weighs now.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightedCell {
    /// The number that its examples are under.
    pub cell: i64,
    /// Which it is.
    pub key: CellKey,
    /// Its sums as stored.
    pub sums: CellCounters,
    /// What its failures weigh now.
    pub weight: f64,
}

/// The failure profile of a run's task.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CollectedProfile {
    /// What it rests on.
    pub sums: CritiqueCounters,
    /// Its cells, by mode, sector and band.
    pub cells: Vec<WeightedCell>,
    /// The same failures by mode and inertial sector.
    pub inertial: Vec<(String, SectorWeight)>,
}

/// A failure mode of a profile.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeSummary<'a> {
    /// How often it occurred.
    pub count: i64,
    /// What that weighs now.
    pub weight: f64,
    /// Where.
    pub cells: Vec<&'a WeightedCell>,
    /// From where, by inertial sector.
    pub inertial: Vec<SectorWeight>,
}

impl CollectedProfile {
    /// Collects the profile of a run's task.
    ///
    /// # Errors
    /// The database's.
    pub async fn read(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Self, StoreError> {
        let sums = critiques::counters(conn, run, task).await?;
        let weight = |held: f64, as_of: i64| fade(held, sums.criticised - as_of);
        let cells = failures::profile(conn, run, task).await?.into_iter();
        let cells = cells.map(|cell| {
            let weight = weight(cell.counters.weight, cell.counters.as_of);
            WeightedCell { cell: cell.id, key: cell.key, sums: cell.counters, weight }
        });
        let inertial = failure_sectors::of_task(conn, run, task).await?.into_iter().map(|row| {
            let sector = SectorWeight {
                sector: to_u32(row.sector),
                count: to_u64(row.count),
                weight: weight(row.weight, row.as_of),
            };
            (row.mode, sector)
        });
        Ok(Self { cells: cells.collect(), inertial: inertial.collect(), sums })
    }

    /// What the criticised episodes weigh together.
    #[must_use]
    pub fn weight(&self) -> f64 {
        weight_of(self.sums.criticised)
    }

    /// One failure mode.
    #[must_use]
    pub fn mode(&self, name: &str) -> ModeSummary<'_> {
        let cells: Vec<_> = self.cells.iter().filter(|cell| cell.key.mode == name).collect();
        let inertial = self.inertial.iter().filter(|(mode, _)| mode == name);
        ModeSummary {
            count: cells.iter().map(|cell| cell.sums.count).sum(),
            weight: cells.iter().map(|cell| cell.weight).sum(),
            inertial: inertial.map(|(_, sector)| *sector).collect(),
            cells,
        }
    }

    /// The modes that occurred, each once, in order.
    #[must_use]
    pub fn modes(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.cells.iter().map(|cell| cell.key.mode.as_str()).collect();
        names.dedup(); // cells are ordered by mode
        names
    }

    /// The profile as designers read it.
    #[must_use]
    pub fn profile(&self, task: &str) -> FailureProfile {
        let modes = self.modes().into_iter().map(|name| {
            let mode = self.mode(name);
            ModeProfile {
                mode: name.to_owned(),
                count: to_u64(mode.count),
                weight: mode.weight,
                cells: mode.cells.iter().map(|cell| told(cell)).collect(),
                inertial: mode.inertial,
            }
        });
        FailureProfile {
            task: task.to_owned(),
            criticised: to_u64(self.sums.criticised),
            weight: self.weight(),
            modes: modes.collect(),
        }
    }
}

fn told(cell: &WeightedCell) -> FailureCell {
    let WeightedCell { key, sums, weight, .. } = cell;
    let share = |n: i64| key.encounter.filter(|_| sums.count > 0).map(|_| n as f64 / sums.count as f64);
    FailureCell {
        sector: key.encounter.map(|bin| bin.sector),
        band: key.encounter.map(|bin| bin.band),
        count: to_u64(sums.count),
        weight: *weight,
        avoidable_share: share(sums.avoidable),
        mean_steps_left: share(sums.steps_left),
    }
}
