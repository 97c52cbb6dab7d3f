//! kessler as a world.

use serde_json::Value;

use super::constants::SATELLITES;
use super::record::{Differences, Recording, compare};
use super::{TASKS, WORLD};
use crate::task::TaskSpec;
use crate::world::{BenchSpec, Compared, FirstDifference, RecordError, World, Worst};

/// The world.
pub static KESSLER: KesslerWorld = KesslerWorld;

/// kessler as a world.
#[derive(Debug)]
pub struct KesslerWorld;

impl World for KesslerWorld {
    fn id(&self) -> &'static str {
        WORLD
    }

    fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        TASKS.iter().map(|task| task as &dyn TaskSpec).collect()
    }

    fn bench(&self) -> BenchSpec {
        // As much debris as the public original's hardest task has; 125 µs is what its step took.
        BenchSpec {
            task: "kessler/survival",
            params: &[("debris", 50.0)],
            action: 0.05,
            original_us_per_step: Some(125.0),
        }
    }

    fn compare(&self, recording: &Value, tolerance: f64) -> Option<Result<Compared, RecordError>> {
        // Episodes of the public kessler-env start from satellites and debris.
        recording.pointer("/episodes/0/initial/satellites")?;
        Some(compare_all(recording, tolerance))
    }
}

fn compare_all(recording: &Value, tolerance: f64) -> Result<Compared, RecordError> {
    use serde::Deserialize;
    let recording = Recording::deserialize(recording)
        .map_err(|error| RecordError::Malformed(format!("it is not a recording: {error}")))?;
    let mut all = Compared {
        episodes: recording.episodes.len(),
        steps: 0,
        worst: Vec::new(),
        first: None,
        documented: Vec::new(),
    };
    let mut worst = Differences::default();
    for (index, episode) in recording.episodes.iter().enumerate() {
        let fault = |reason: String| RecordError::Episode { episode: index, reason };
        if episode.steps.is_empty() {
            return Err(fault("it has no steps".to_owned()));
        }
        // What a step leaves out could not differ.
        if let Some(step) = episode.steps.iter().position(|step| step.satellites.len() != SATELLITES) {
            return Err(fault(format!("step {} does not have {SATELLITES} satellites", step + 1)));
        }
        let found = compare(episode, tolerance).map_err(|error| fault(error.to_string()))?;
        all.steps += found.steps;
        worst.satellite = worst.satellite.max(found.satellite);
        worst.debris = worst.debris.max(found.debris);
        worst.reward = worst.reward.max(found.reward);
        worst.total_score = worst.total_score.max(found.total_score);
        let first =
            [&found.first_beyond, &found.first_mismatch].into_iter().flatten().min_by_key(|(step, _)| *step);
        if let (None, Some((step, what))) = (&all.first, first) {
            all.first = Some(FirstDifference { episode: index, step: *step, what: what.clone() });
        }
    }
    all.worst = [
        ("satellite", worst.satellite),
        ("debris", worst.debris),
        ("reward", worst.reward),
        ("total_score", worst.total_score),
    ]
    .map(|(quantity, difference)| Worst { quantity, difference, allowed: tolerance })
    .to_vec();
    Ok(all)
}
