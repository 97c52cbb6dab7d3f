//! The format of the recordings: episodes of safe-autonomy-sims' multi-agent docking in CoRL.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::docking::constants::{OBSERVATION, STATE};

/// A file of recorded episodes.
#[derive(Debug, Deserialize)]
pub struct Recording {
    /// The episodes.
    pub episodes: Vec<RecordedEpisode>,
}

/// One recorded episode. Deputies are those of `init_state`, in the order of their names.
#[derive(Debug, Deserialize)]
pub struct RecordedEpisode {
    /// What it shows.
    #[serde(default)]
    pub label: String,
    /// Steps flown; more than are listed where the middle is left out.
    pub n_steps: usize,
    /// Which are listed then: "steps list truncated to the first 3 and last 5". Thrust was zero in between.
    #[serde(default)]
    pub note: Option<String>,
    /// Steps after which the recording's environment cut episodes off by itself, s.
    #[serde(default)]
    pub horizon_s: f64,
    /// Rewards added up, by deputy.
    #[serde(default, rename = "return")]
    pub returns: BTreeMap<String, f64>,
    /// x, y, z, vx, vy, vz at the start.
    pub init_state: BTreeMap<String, [f64; STATE]>,
    /// Observations at the start.
    #[serde(default)]
    pub init_obs: BTreeMap<String, [f64; OBSERVATION]>,
    /// The steps that are listed.
    pub steps: Vec<RecordedStep>,
}

/// One recorded step.
#[derive(Debug, Deserialize)]
pub struct RecordedStep {
    /// States after it, of all deputies: those that have left go on flying here, and mean nothing.
    pub state: BTreeMap<String, [f64; STATE]>,
    /// The deputies that were stepped.
    pub agents: BTreeMap<String, RecordedAgent>,
    /// Whether the episode is over.
    pub all_done: bool,
}

/// What one deputy did and was told in a step.
#[derive(Debug, Deserialize)]
pub struct RecordedAgent {
    /// Thrust, N.
    pub action: [f64; 3],
    /// The observation after it.
    pub obs: [f64; OBSERVATION],
    /// The reward.
    pub reward: f64,
    /// The same by component.
    pub components: RecordedComponents,
    /// Whether it left.
    pub done: bool,
    /// By which rules.
    pub done_info: Vec<String>,
    /// What each rule says of it: `WIN`, `LOSE` or `DRAW`.
    pub status: BTreeMap<String, String>,
}

/// Components of a reward, by the names of the original.
#[derive(Debug, Deserialize)]
pub struct RecordedComponents {
    /// For coming nearer.
    #[serde(rename = "DockingDistanceExponentialChangeReward")]
    pub distance: f64,
    /// For thrust.
    #[serde(rename = "DockingDeltaVReward")]
    pub delta_v: f64,
    /// For violating the speed limit.
    #[serde(rename = "DockingVelocityConstraintReward")]
    pub velocity: f64,
    /// For docking.
    #[serde(rename = "DockingSuccessReward")]
    pub success: f64,
    /// For failing.
    #[serde(rename = "DockingFailureReward")]
    pub failure: f64,
}

impl RecordedEpisode {
    /// The number of each listed step, counted from 1.
    ///
    /// # Errors
    /// Fewer steps than were flown, and no word which.
    pub fn numbers(&self) -> Result<Vec<usize>, String> {
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
                    && self.n_steps <= crate::log::MAX_STEPS =>
            {
                Ok((1..=first).chain(self.n_steps - last + 1..=self.n_steps).collect())
            }
            _ => Err(format!("it lists {listed} of {} steps, and does not say which", self.n_steps)),
        }
    }
}
