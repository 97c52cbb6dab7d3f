//! File format of recordings of safe-autonomy-sims' multi-agent docking in CoRL.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::docking::constants::{OBSERVATION_DIM, STATE_DIM};

/// A file of recorded episodes.
#[derive(Debug, Deserialize)]
pub struct DockingRecording {
    /// The recorded episodes in order.
    pub episodes: Vec<RecordedEpisode>,
}

/// One recorded episode. Its deputies are the keys of `init_state` in alphabetical order.
#[derive(Debug, Deserialize)]
pub struct RecordedEpisode {
    /// Short description of the episode.
    #[serde(default)]
    pub label: String,
    /// Number of steps; larger than the length of `steps` if the middle is left out.
    pub n_steps: usize,
    /// States which steps are listed: "steps list truncated to the first 3 and last 5". Thrust was zero in between.
    #[serde(default)]
    pub note: Option<String>,
    /// Time at which the recording environment truncated episodes, s.
    #[serde(default)]
    pub horizon_s: f64,
    /// Return of each deputy.
    #[serde(default, rename = "return")]
    pub returns: BTreeMap<String, f64>,
    /// Initial state of each deputy: x, y, z in m and vx, vy, vz in m/s.
    pub init_state: BTreeMap<String, [f64; STATE_DIM]>,
    /// Initial observation of each deputy.
    #[serde(default)]
    pub init_obs: BTreeMap<String, [f64; OBSERVATION_DIM]>,
    /// The listed steps in order.
    pub steps: Vec<RecordedStep>,
}

/// One step of a recorded episode.
#[derive(Debug, Deserialize)]
pub struct RecordedStep {
    /// State of each deputy after the step. Deputies that have left keep moving here; their states are meaningless.
    pub state: BTreeMap<String, [f64; STATE_DIM]>,
    /// Actions and results of the deputies that were active.
    pub agents: BTreeMap<String, RecordedAgent>,
    /// True if the episode is over.
    pub all_done: bool,
}

/// Action of a deputy in a step, and its result.
#[derive(Debug, Deserialize)]
pub struct RecordedAgent {
    /// Thrust along x, y, z in N.
    pub action: [f64; 3],
    /// Observation after the step.
    pub obs: [f64; OBSERVATION_DIM],
    /// Total reward of the step.
    pub reward: f64,
    /// Reward of the step by component.
    pub components: RecordedComponents,
    /// True if the deputy left.
    pub done: bool,
    /// Names of the rules by which it left.
    pub done_info: Vec<String>,
    /// Verdict of each rule: `WIN`, `LOSE` or `DRAW`.
    pub status: BTreeMap<String, String>,
}

/// Components of a reward, by the names of the original.
#[derive(Debug, Deserialize)]
pub struct RecordedComponents {
    /// Reward for approaching the chief.
    #[serde(rename = "DockingDistanceExponentialChangeReward")]
    pub distance: f64,
    /// Reward for thrust, not positive.
    #[serde(rename = "DockingDeltaVReward")]
    pub delta_v: f64,
    /// Reward for violating the speed limit, not positive.
    #[serde(rename = "DockingVelocityConstraintReward")]
    pub velocity: f64,
    /// Reward for docking with the chief.
    #[serde(rename = "DockingSuccessReward")]
    pub success: f64,
    /// Reward for failing, not positive.
    #[serde(rename = "DockingFailureReward")]
    pub failure: f64,
}

impl RecordedEpisode {
    /// The number of each listed step, counted from 1.
    ///
    /// # Errors
    /// Returns a message if steps are left out and `note` does not state which.
    pub fn step_numbers(&self) -> Result<Vec<usize>, String> {
        let listed = self.steps.len();
        if listed == self.n_steps {
            return Ok((1..=listed).collect());
        }
        let counts: Vec<usize> = self
            .note
            .as_deref()
            .unwrap_or_default()
            .split(|c: char| !c.is_ascii_digit())
            .filter_map(|digits| digits.parse().ok())
            .collect();
        match counts.as_slice() {
            &[first, last]
                if first.checked_add(last) == Some(listed)
                    && listed < self.n_steps
                    && self.n_steps <= crate::log::MAX_LOG_STEPS =>
            {
                Ok((1..=first).chain(self.n_steps - last + 1..=self.n_steps).collect())
            }
            _ => Err(format!("it lists {listed} of {} steps, and does not state which", self.n_steps)),
        }
    }
}
