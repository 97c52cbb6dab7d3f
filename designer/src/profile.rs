//! What is known of an agent's failures: the failure profile that the service collects, in the form it is shown in
//! (`GET /v1/runs/{run}/failures`), so that a saved answer is a profile to design from.

use env_core::critique::SECTORS;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Why a task's episodes lose score. Weights fade with time; fields that designers do not use are skipped.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// The task.
    pub task: String,
    /// Episodes criticised: what everything below is counted over.
    pub criticised: u64,
    /// What these episodes weigh together.
    #[serde(default)]
    pub weight: f64,
    /// The failure modes.
    pub modes: Vec<ModeProfile>,
}

/// A failure mode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModeProfile {
    /// Its name.
    pub mode: String,
    /// How often it occurred.
    pub count: u64,
    /// What that weighs now.
    pub weight: f64,
    /// Where it occurred; empty cells are left out.
    #[serde(default)]
    pub cells: Vec<Cell>,
    /// The same failures by where it came from in the inertial frame (sector 0 is centred on +X); empty in a world without
    /// one.
    #[serde(default)]
    pub inertial: Vec<SectorWeight>,
}

/// Failures of one mode from one sector, in the radial/in-track frame, at one band of speed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The bearing sector; none where nothing was met.
    pub sector: Option<u32>,
    /// The speed band; none where nothing was met.
    pub band: Option<u32>,
    /// How many.
    pub count: u64,
    /// What they weigh now.
    pub weight: f64,
    /// The share that acting in time would have avoided.
    #[serde(default)]
    pub avoidable_share: Option<f64>,
    /// Mean steps that were left to act.
    #[serde(default)]
    pub mean_steps_left: Option<f64>,
}

/// Failures from one sector.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct SectorWeight {
    /// The sector.
    pub sector: u32,
    /// How many.
    pub count: u64,
    /// What they weigh now.
    pub weight: f64,
}

/// Weights of the twelve sectors.
pub type Rose = [f64; SECTORS as usize];

/// A file that is no profile.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// Not the JSON of one.
    #[error("it is no failure profile: {0}")]
    Form(#[from] serde_json::Error),
    /// A profile of several tasks, none of which is the one asked for.
    #[error("it holds no profile of {wanted}; it holds {held}")]
    Task {
        /// The task asked for.
        wanted: String,
        /// Those it holds.
        held: String,
    },
    /// A number that cannot be.
    #[error("{0}")]
    Value(String),
}

/// The service's answer: a profile a task.
#[derive(Deserialize)]
struct Answer {
    tasks: Vec<Profile>,
}

impl Profile {
    /// A profile of a task of which nothing is known.
    #[must_use]
    pub fn blank(task: &str) -> Self {
        Self { task: task.to_owned(), ..Self::default() }
    }

    /// Reads a profile: one by itself, or the service's answer with one a task. Without a task the one with the most
    /// failures is taken.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(json: &str, task: Option<&str>) -> Result<Self, ProfileError> {
        let form: Value = serde_json::from_str(json)?;
        let all = match form.get("tasks") {
            Some(_) => serde_json::from_value::<Answer>(form)?.tasks,
            None => vec![serde_json::from_value(form)?],
        };
        let held = all.iter().map(|profile| profile.task.as_str()).collect::<Vec<_>>().join(", ");
        let found = match task {
            Some(task) => all.into_iter().find(|profile| profile.task == task),
            None => all.into_iter().max_by(|a, b| a.failures().total_cmp(&b.failures())),
        };
        let wanted = task.unwrap_or("any task").to_owned();
        let profile = found.ok_or(ProfileError::Task { wanted, held })?;
        profile.check()?;
        Ok(profile)
    }

    fn check(&self) -> Result<(), ProfileError> {
        let fault = |what: &str, number: String| ProfileError::Value(format!("{what} cannot be {number}"));
        for mode in &self.modes {
            let cells = mode.cells.iter().map(|cell| (cell.weight, cell.sector.unwrap_or(0)));
            let inertial = mode.inertial.iter().map(|sector| (sector.weight, sector.sector));
            for (weight, sector) in cells.chain(inertial).chain([(mode.weight, 0)]) {
                if !(weight.is_finite() && weight >= 0.0) {
                    return Err(fault("a weight", weight.to_string()));
                }
                if sector >= SECTORS {
                    return Err(fault("a sector", sector.to_string()));
                }
            }
        }
        Ok(())
    }

    /// What all failures weigh.
    #[must_use]
    pub fn failures(&self) -> f64 {
        self.modes.iter().map(|mode| mode.weight).sum()
    }

    /// A mode by its name.
    #[must_use]
    pub fn mode(&self, name: &str) -> Option<&ModeProfile> {
        self.modes.iter().find(|mode| mode.mode == name)
    }

    /// How different two profiles are: half the sum of the differences of their shares by mode and sector, 0 to 1 (total
    /// variation). Two without failures are the same.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f64 {
        let (of, than) = (self.shares(), other.shares());
        let of_all = of.iter().map(|(key, share)| {
            let there = than.iter().find(|(k, _)| k == key).map_or(0.0, |(_, share)| *share);
            (share - there).abs()
        });
        let only_there =
            than.iter().filter(|(key, _)| !of.iter().any(|(k, _)| k == key)).map(|(_, share)| *share);
        0.5 * (of_all.sum::<f64>() + only_there.sum::<f64>())
    }

    fn shares(&self) -> Vec<((&str, Option<u32>), f64)> {
        let all = self.failures();
        if all <= 0.0 {
            return vec![(("", None), 1.0)];
        }
        let mut shares: Vec<((&str, Option<u32>), f64)> = Vec::new();
        for mode in &self.modes {
            for cell in &mode.cells {
                let key = (mode.mode.as_str(), cell.sector);
                match shares.iter_mut().find(|(k, _)| *k == key) {
                    Some((_, share)) => *share += cell.weight / all,
                    None => shares.push((key, cell.weight / all)),
                }
            }
        }
        shares
    }
}

impl ModeProfile {
    /// Weights by sector, in the radial/in-track frame.
    #[must_use]
    pub fn rose(&self) -> Rose {
        let met = self.cells.iter().filter_map(|cell| Some((cell.sector?, cell.weight)));
        gather(met)
    }

    /// Weights by sector, in the inertial frame.
    #[must_use]
    pub fn inertial_rose(&self) -> Rose {
        gather(self.inertial.iter().map(|sector| (sector.sector, sector.weight)))
    }

    /// Weights by speed band, `bands` of them.
    #[must_use]
    pub fn speeds(&self, bands: usize) -> Vec<f64> {
        let mut weights = vec![0.0; bands];
        for cell in &self.cells {
            if let Some(weight) = cell.band.and_then(|band| weights.get_mut(band as usize)) {
                *weight += cell.weight;
            }
        }
        weights
    }
}

fn gather(weights: impl Iterator<Item = (u32, f64)>) -> Rose {
    let mut rose = Rose::default();
    for (sector, weight) in weights {
        if let Some(held) = rose.get_mut(sector as usize) {
            *held += weight;
        }
    }
    rose
}
