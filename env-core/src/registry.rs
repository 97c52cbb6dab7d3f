//! All tasks of all worlds.

use crate::kessler;
use crate::task::TaskSpec;

/// Every task, world by world.
pub fn tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    kessler::TASKS.iter().map(|task| task as &dyn TaskSpec)
}

/// A task by its id.
#[must_use]
pub fn task(id: &str) -> Option<&'static dyn TaskSpec> {
    tasks().find(|task| task.id() == id)
}
