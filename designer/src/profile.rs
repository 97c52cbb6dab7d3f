//! [`FailureProfile`]: which failures an agent has, and how often. Its JSON is that of `GET /v1/runs/{run}/failure_profiles`, so that
//! a saved response can be used as input of a designer.

use env_core::critique::PROFILE_SECTORS;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Failures of an agent in one task. Weights decay with time. Fields of the API that designers do not use are ignored.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FailureProfile {
    /// Id of the task, such as `kessler/survival`.
    pub task: String,
    /// Number of criticised episodes, over which everything below is counted.
    pub criticised: u64,
    /// Sum of the weights of these episodes.
    #[serde(default)]
    pub weight: f64,
    /// Failure modes that occurred.
    pub modes: Vec<ModeProfile>,
}

/// Failures of one mode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModeProfile {
    /// Name of the failure mode.
    pub mode: String,
    /// Number of failures without decay.
    pub count: u64,
    /// Sum of the decayed weights of the failures.
    pub weight: f64,
    /// Failures by sector and band of relative speed, without empty cells.
    #[serde(default)]
    pub cells: Vec<FailureCell>,
    /// The same failures by bearing in the inertial frame (sector 0 is centred on +X); empty in a world without this frame.
    #[serde(default)]
    pub inertial_sectors: Vec<SectorWeight>,
}

/// Failures of one mode in one sector and one band of relative speed. A sector is one of bearings in the radial/in-track frame or,
/// in tasking, of orbit angles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FailureCell {
    /// Number of the sector; `None` for a failure without a bearing and an orbit angle.
    pub sector: Option<u32>,
    /// Speed band; `None` for a failure without an encounter.
    pub band: Option<u32>,
    /// Number of failures without decay.
    pub count: u64,
    /// Sum of the decayed weights.
    pub weight: f64,
    /// Share of the failures that were avoidable.
    #[serde(default)]
    pub avoidable_share: Option<f64>,
    /// Mean number of steps that were left to act.
    #[serde(default)]
    pub mean_steps_left: Option<f64>,
}

/// Failures from one bearing sector.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct SectorWeight {
    /// Number of the sector.
    pub sector: u32,
    /// Number of failures without decay.
    pub count: u64,
    /// Sum of the decayed weights.
    pub weight: f64,
}

/// Weight of each sector.
pub type SectorWeights = [f64; PROFILE_SECTORS as usize];

/// Reason why a text is no usable failure profile.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// The text is not the JSON of a profile.
    #[error("it is not a failure profile: {0}")]
    Json(#[from] serde_json::Error),
    /// The profile does not contain the requested task.
    #[error("it has no profile of {wanted}; it has {available}")]
    MissingTask {
        /// Id of the requested task.
        wanted: String,
        /// Tasks of the profile, separated by commas.
        available: String,
    },
    /// A number is out of range.
    #[error("{0}")]
    Value(String),
}

/// Response of the API, with one profile per task.
#[derive(Deserialize)]
struct ProfileResponse {
    tasks: Vec<FailureProfile>,
}

impl FailureProfile {
    /// Creates a profile of a task without failures.
    #[must_use]
    pub fn empty(task: &str) -> Self {
        Self { task: task.to_owned(), ..Self::default() }
    }

    /// Parses a profile, or the response of the API with one profile per task. If `task` is `None`, the profile with the
    /// largest weight of failures is returned.
    ///
    /// # Errors
    /// Returns [`ProfileError::Json`] if the text is no profile, [`ProfileError::MissingTask`] if it lacks the task, and
    /// [`ProfileError::Value`] if a weight or a sector is out of range.
    pub fn parse(json: &str, task: Option<&str>) -> Result<Self, ProfileError> {
        let value: Value = serde_json::from_str(json)?;
        let all = match value.get("tasks") {
            Some(_) => serde_json::from_value::<ProfileResponse>(value)?.tasks,
            None => vec![serde_json::from_value(value)?],
        };
        let available = all.iter().map(|profile| profile.task.as_str()).collect::<Vec<_>>().join(", ");
        let found = match task {
            Some(task) => all.into_iter().find(|profile| profile.task == task),
            None => all.into_iter().max_by(|a, b| a.total_weight().total_cmp(&b.total_weight())),
        };
        let wanted = task.unwrap_or("any task").to_owned();
        let profile = found.ok_or(ProfileError::MissingTask { wanted, available })?;
        profile.validate()?;
        Ok(profile)
    }

    /// Checks the weights and sectors.
    ///
    /// # Errors
    /// Returns [`ProfileError::Value`] if one is out of range.
    pub fn validate(&self) -> Result<(), ProfileError> {
        let fault = |name: &str, number: String| ProfileError::Value(format!("{name} cannot be {number}"));
        for mode in &self.modes {
            let cells = mode.cells.iter().map(|cell| (cell.weight, cell.sector.unwrap_or(0)));
            let inertial = mode.inertial_sectors.iter().map(|sector| (sector.weight, sector.sector));
            for (weight, sector) in cells.chain(inertial).chain([(mode.weight, 0)]) {
                if !(weight.is_finite() && weight >= 0.0) {
                    return Err(fault("a weight", weight.to_string()));
                }
                if sector >= PROFILE_SECTORS {
                    return Err(fault("a sector", sector.to_string()));
                }
            }
        }
        Ok(())
    }

    /// Returns the sum of the weights of all failures.
    #[must_use]
    pub fn total_weight(&self) -> f64 {
        self.modes.iter().map(|mode| mode.weight).sum()
    }

    /// Returns the failures of a mode.
    #[must_use]
    pub fn mode(&self, name: &str) -> Option<&ModeProfile> {
        self.modes.iter().find(|mode| mode.mode == name)
    }

    /// Returns the total variation distance of two profiles, 0 to 1: half the sum of the differences of their shares by mode
    /// and sector. The distance of two profiles without failures is 0.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f64 {
        let (own, others) = (self.shares(), other.shares());
        let differences = own.iter().map(|(key, share)| {
            let other = others.iter().find(|(k, _)| k == key).map_or(0.0, |(_, share)| *share);
            (share - other).abs()
        });
        let only_other =
            others.iter().filter(|(key, _)| !own.iter().any(|(k, _)| k == key)).map(|(_, share)| *share);
        0.5 * (differences.sum::<f64>() + only_other.sum::<f64>())
    }

    /// Share of each pair of mode and sector in all failures.
    fn shares(&self) -> Vec<((&str, Option<u32>), f64)> {
        let all = self.total_weight();
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
    /// Returns the weights by sector of the radial/in-track frame.
    #[must_use]
    pub fn sector_weights(&self) -> SectorWeights {
        sum_by_sector(self.cells.iter().filter_map(|cell| Some((cell.sector?, cell.weight))))
    }

    /// Returns the weights by sector of the inertial frame.
    #[must_use]
    pub fn inertial_sector_weights(&self) -> SectorWeights {
        sum_by_sector(self.inertial_sectors.iter().map(|sector| (sector.sector, sector.weight)))
    }

    /// Returns the weights of the first `bands` speed bands.
    #[must_use]
    pub fn band_weights(&self, bands: usize) -> Vec<f64> {
        let mut weights = vec![0.0; bands];
        for cell in &self.cells {
            if let Some(weight) = cell.band.and_then(|band| weights.get_mut(band as usize)) {
                *weight += cell.weight;
            }
        }
        weights
    }
}

fn sum_by_sector(weights: impl Iterator<Item = (u32, f64)>) -> SectorWeights {
    let mut sums = SectorWeights::default();
    for (sector, weight) in weights {
        if let Some(held) = sums.get_mut(sector as usize) {
            *held += weight;
        }
    }
    sums
}
