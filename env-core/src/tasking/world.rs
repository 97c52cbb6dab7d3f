//! Implements the world interface for tasking.

use serde_json::Value;

use super::WORLD_ID;
use super::recording::replay;
use super::task::TASKING_TASKS;
use crate::task::TaskSpec;
use crate::world::{BenchSpec, ComparisonError, RecordingComparison, World};

/// The only instance of the world.
pub static TASKING: TaskingWorld = TaskingWorld;

/// Implementation of [`World`] for tasking.
#[derive(Debug)]
pub struct TaskingWorld;

impl World for TaskingWorld {
    fn id(&self) -> &'static str {
        WORLD_ID
    }

    fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        TASKING_TASKS.iter().map(|task| task as &dyn TaskSpec).collect()
    }

    /// Compares with the world's tolerance of each quantity, or with `tolerance` where that is larger.
    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>> {
        replay::is_recording(recording).then(|| replay::compare_recording(recording, tolerance))
    }

    /// Each task with its default params. `make bench-peers BSK=1` measures the original.
    fn benchmarks(&self) -> Vec<BenchSpec> {
        let original_us = [4630.0, 32_300.0, 21_300.0];
        TASKING_TASKS
            .iter()
            .zip(original_us)
            .map(|(task, us)| BenchSpec { task, params: &[], action: 0.0, original_us_per_step: Some(us) })
            .collect()
    }
}
