//! The kessler world: its tasks, benchmark and recordings.

use serde::Deserialize;
use serde_json::Value;

use super::constants::SATELLITES;
use super::recording::{EpisodeDifferences, KesslerRecording, StepDifference, compare_episode};
use super::{KESSLER_TASKS, WORLD_ID};
use crate::task::TaskSpec;
use crate::world::{
    BenchSpec, ComparisonError, FirstDifference, RecordingComparison, World, WorstDifference,
};

/// The kessler world, version 1.
pub static KESSLER: KesslerWorld = KesslerWorld;

/// World of three satellites, debris and the Earth in a plane.
#[derive(Debug)]
pub struct KesslerWorld;

impl World for KesslerWorld {
    fn id(&self) -> &'static str {
        WORLD_ID
    }

    fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        KESSLER_TASKS.iter().map(|task| task as &dyn TaskSpec).collect()
    }

    fn bench_spec(&self) -> BenchSpec {
        // As much debris as in the hardest task of the public kessler-env, whose step took 125 µs.
        BenchSpec {
            task: "kessler/survival",
            params: &[("debris", 50.0)],
            action: 0.05,
            original_us_per_step: Some(125.0),
        }
    }

    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>> {
        // Recordings of the public kessler-env start from satellites and debris.
        recording.pointer("/episodes/0/initial/satellites")?;
        Some(compare_episodes(recording, tolerance))
    }
}

fn compare_episodes(recording: &Value, tolerance: f64) -> Result<RecordingComparison, ComparisonError> {
    let recording = KesslerRecording::deserialize(recording)
        .map_err(|error| ComparisonError::Malformed(format!("it is not a recording: {error}")))?;
    let mut comparison = RecordingComparison {
        episodes: recording.episodes.len(),
        steps: 0,
        worst: Vec::new(),
        first: None,
        documented: Vec::new(),
    };
    let mut worst = EpisodeDifferences::default();
    for (index, episode) in recording.episodes.iter().enumerate() {
        let fault = |reason: String| ComparisonError::Episode { episode: index, reason };
        if episode.steps.is_empty() {
            return Err(fault("it has no steps".to_owned()));
        }
        // A missing satellite could not be compared.
        if let Some(step) = episode.steps.iter().position(|step| step.satellites.len() != SATELLITES) {
            return Err(fault(format!("step {} does not have {SATELLITES} satellites", step + 1)));
        }
        let differences = compare_episode(episode, tolerance).map_err(|error| fault(error.to_string()))?;
        comparison.steps += differences.steps;
        worst.satellite = worst.satellite.max(differences.satellite);
        worst.debris = worst.debris.max(differences.debris);
        worst.reward = worst.reward.max(differences.reward);
        worst.total_score = worst.total_score.max(differences.total_score);
        let first = [&differences.first_beyond, &differences.first_mismatch]
            .into_iter()
            .flatten()
            .min_by_key(|difference| difference.step);
        if let (None, Some(difference)) = (&comparison.first, first) {
            let StepDifference { step, what } = difference.clone();
            comparison.first = Some(FirstDifference { episode: index, step, what });
        }
    }
    comparison.worst = [
        ("satellite", worst.satellite),
        ("debris", worst.debris),
        ("reward", worst.reward),
        ("total_score", worst.total_score),
    ]
    .map(|(quantity, difference)| WorstDifference { quantity, difference, allowed: tolerance })
    .to_vec();
    Ok(comparison)
}
