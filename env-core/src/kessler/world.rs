//! The kessler world: its tasks, benchmark and recordings.

use serde_json::Value;

use super::{KESSLER_TASKS, WORLD_ID, recording};
use crate::task::TaskSpec;
use crate::world::{BenchSpec, ComparisonError, RecordingComparison, World};

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

    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>> {
        recording::is_recording(recording).then(|| recording::compare_recording(recording, tolerance))
    }

    fn benchmarks(&self) -> Vec<BenchSpec> {
        let Some(task) = self.tasks().into_iter().find(|task| task.id() == "kessler/survival") else {
            return Vec::new();
        };
        // As much debris as in the hardest task of the public kessler-env, whose step took 125 µs.
        vec![BenchSpec { task, params: &[("debris", 50.0)], action: 0.05, original_us_per_step: Some(125.0) }]
    }
}
