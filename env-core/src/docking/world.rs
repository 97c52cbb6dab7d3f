//! Implements the world interface for docking.

use serde_json::Value;

use super::{DOCKING_TASKS, WORLD_ID, recording};
use crate::task::TaskSpec;
use crate::world::{BenchSpec, ComparisonError, RecordingComparison, World};

/// The only instance of the world.
pub static DOCKING: DockingWorld = DockingWorld;

/// Implementation of [`World`] for docking.
#[derive(Debug)]
pub struct DockingWorld;

impl World for DockingWorld {
    fn id(&self) -> &'static str {
        WORLD_ID
    }

    fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        DOCKING_TASKS.iter().map(|task| task as &dyn TaskSpec).collect()
    }

    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>> {
        recording::is_recording(recording).then(|| recording::compare_recording(recording, tolerance))
    }

    fn benchmarks(&self) -> Vec<BenchSpec> {
        let Some(task) = self.tasks().into_iter().find(|task| task.id() == "docking/multiagent") else {
            return Vec::new();
        };
        // The cost of a step of the original was not measured for this project.
        vec![BenchSpec { task, params: &[("deputies", 3.0)], action: 1.0, original_us_per_step: None }]
    }
}
