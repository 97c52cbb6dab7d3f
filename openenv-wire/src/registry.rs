//! The list of all worlds' formats.

use env_core::TaskSpec;

use crate::wire_format::WireFormat;
use crate::{docking, kessler, tasking};

/// Selects the format of a world's task.
type SelectFormat = fn(&dyn TaskSpec) -> &'static dyn WireFormat;

/// The formats of each world, by the world's id.
static FORMATS: [(&str, SelectFormat); 3] = [
    (env_core::kessler::WORLD_ID, |_| &kessler::FORMAT),
    (env_core::docking::WORLD_ID, |_| &docking::FORMAT),
    (env_core::tasking::WORLD_ID, tasking::format),
];

/// The OpenEnv representation of a task.
///
/// # Panics
/// If the task's world is not listed here; a test checks that every world of `env-core` is.
#[must_use]
pub fn wire_format(task: &dyn TaskSpec) -> &'static dyn WireFormat {
    let listed = FORMATS.iter().find(|(world, _)| *world == task.world());
    listed.map(|(_, select)| select(task)).expect("every world of env-core has a wire format")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_has_a_wire_format() {
        for task in env_core::tasks() {
            assert!(wire_format(task).action_schema().is_object(), "{}", task.id());
        }
    }
}
