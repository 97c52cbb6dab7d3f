//! Critiques: replayed episodes are examined for the reasons of their losses.

use std::panic::AssertUnwindSafe;

use env_core::critique::{Critique, Failure, SpeedBands, Verdict, profile_sector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::episode_batch::{EpisodeBatch, LoggedEpisode};
use crate::wire::{MAX_ENTRIES, WireError, from_bytes, list, to_bytes};

/// Verdicts on actions, in the order of their counters.
pub const VERDICTS: [Verdict; 4] = [Verdict::Needed, Verdict::Harmless, Verdict::Wasteful, Verdict::Harmful];

/// Findings of a critique.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CritiqueFindings {
    /// Value that the deterministic judge gives the episode.
    pub judged: f64,
    /// Number of actions by verdict, in the order of [`VERDICTS`].
    pub verdicts: [i64; 4],
    /// Failures: the reasons why score was lost.
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    pub failures: Vec<CritiqueFailure>,
}

/// A failure of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CritiqueFailure {
    /// Name of the failure mode.
    pub mode: String,
    /// Sector of the failure's angle, if it has one.
    pub sector: Option<u32>,
    /// Band of the relative speed, if there was an encounter.
    pub band: Option<u32>,
    /// Index of the agent that failed.
    pub agent: u32,
    /// Step of the failure, from 1.
    pub step: u32,
    /// Angle whose sector is above, in degrees.
    pub sector_deg: Option<f64>,
    /// The encounter behind the failure, if there was one.
    pub encounter: Option<EncounterFinding>,
    /// Inertial sector of the encounter, in a world with an inertial frame.
    pub inertial: Option<u32>,
}

/// An encounter as the failure profile keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EncounterFinding {
    /// Relative speed, in the world's unit.
    pub relative_speed: f64,
    /// Steps between the first detection and the encounter.
    pub steps_left: u32,
    /// True if acting at the first detection would have helped; `None` if the object was never seen.
    pub avoidable: Option<bool>,
}

/// Result of a critique: one entry for each episode, in order. An episode that cannot be criticised has a sentence with the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct CritiqueOutput(pub Vec<Result<CritiqueFindings, String>>);

/// Form of a [`CritiqueOutput`] as MessagePack.
#[derive(Deserialize)]
struct WireFindings(
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")] Vec<Result<CritiqueFindings, String>>,
);

impl CritiqueOutput {
    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        to_bytes(&self.0)
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireFindings(findings) = from_bytes(bytes)?;
        Ok(Self(findings))
    }
}

/// Criticises episodes in parallel on the current thread pool. An episode that cannot be criticised does not affect the others.
#[must_use]
pub fn criticise(batch: &EpisodeBatch) -> CritiqueOutput {
    CritiqueOutput(batch.0.par_iter().map(criticise_episode).collect())
}

fn criticise_episode(LoggedEpisode { scenario, log }: &LoggedEpisode) -> Result<CritiqueFindings, String> {
    let task = scenario.task();
    let critique = std::panic::catch_unwind(AssertUnwindSafe(|| task.critique(scenario, log)))
        .map_err(|_| "the critique panicked".to_owned())?
        .map_err(|error| error.to_string())?;
    CritiqueFindings::of(&critique, task.speed_bands())
}

impl CritiqueFindings {
    /// Extracts the findings of a critique.
    ///
    /// # Errors
    /// Returns a sentence if the judge gives no finite value.
    pub fn of(critique: &Critique, bands: SpeedBands) -> Result<Self, String> {
        if !critique.assessment.value.is_finite() {
            return Err(format!("its judge says {}", critique.assessment.value));
        }
        let mut verdicts = [0; 4];
        for action in &critique.actions {
            verdicts[verdict_index(action.verdict)] += 1;
        }
        let failures = critique.failures.iter().map(|failure| CritiqueFailure::of(failure, bands)).collect();
        Ok(Self { judged: critique.assessment.value, verdicts, failures })
    }
}

impl CritiqueFailure {
    fn of(failure: &Failure, bands: SpeedBands) -> Self {
        let encounter = failure.encounter.as_ref().map(|e| EncounterFinding {
            relative_speed: e.relative_speed,
            steps_left: e.steps_left,
            avoidable: e.avoidable,
        });
        let sector_deg = failure.sector_deg();
        let inertial = failure.encounter.as_ref().and_then(|e| e.bearing_inertial_deg).map(profile_sector);
        Self {
            mode: failure.mode.to_owned(),
            sector: sector_deg.map(profile_sector),
            band: encounter.map(|found| bands.band(found.relative_speed)),
            agent: failure.agent,
            step: failure.step,
            sector_deg,
            encounter,
            inertial,
        }
    }
}

const fn verdict_index(verdict: Verdict) -> usize {
    match verdict {
        Verdict::Needed => 0,
        Verdict::Harmless => 1,
        Verdict::Wasteful => 2,
        Verdict::Harmful => 3,
    }
}
