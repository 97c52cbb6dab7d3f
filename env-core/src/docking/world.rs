//! docking as a world.

use serde_json::Value;

use super::{TASKS, WORLD, record};
use crate::task::TaskSpec;
use crate::world::{BenchSpec, Compared, RecordError, World};

/// The world.
pub static DOCKING: DockingWorld = DockingWorld;

/// docking as a world.
#[derive(Debug)]
pub struct DockingWorld;

impl World for DockingWorld {
    fn id(&self) -> &'static str {
        WORLD
    }

    fn tasks(&self) -> Vec<&'static dyn TaskSpec> {
        TASKS.iter().map(|task| task as &dyn TaskSpec).collect()
    }

    fn bench(&self) -> BenchSpec {
        // What a step of the original costs was not measured for this project.
        BenchSpec {
            task: "docking/multiagent",
            params: &[("deputies", 3.0)],
            action: 1.0,
            original_us_per_step: None,
        }
    }

    fn compare(&self, recording: &Value, tolerance: f64) -> Option<Result<Compared, RecordError>> {
        record::recognise(recording).then(|| record::compare_all(recording, tolerance))
    }
}
