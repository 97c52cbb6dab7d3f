//! Implements the interface of recorded worlds for tasking.

use serde_json::Value;

use super::WORLD_ID;
use super::recording::replay;
use crate::world::{ComparisonError, RecordedWorld, RecordingComparison};

/// The only instance of the world.
pub static TASKING: TaskingWorld = TaskingWorld;

/// Implementation of [`RecordedWorld`] for tasking.
#[derive(Debug)]
pub struct TaskingWorld;

impl RecordedWorld for TaskingWorld {
    fn id(&self) -> &'static str {
        WORLD_ID
    }

    /// Compares with the world's tolerance of each quantity, or with `tolerance` where that is larger.
    fn compare_recording(
        &self,
        recording: &Value,
        tolerance: f64,
    ) -> Option<Result<RecordingComparison, ComparisonError>> {
        replay::is_recording(recording).then(|| replay::compare_recording(recording, tolerance))
    }
}
