//! The list of all worlds and their tasks. It is above the worlds; nothing below it depends on it.

use crate::task::TaskSpec;
use crate::world::{BenchSpec, World};
use crate::{docking, kessler, tasking};

static WORLDS: [&dyn World; 3] = [&kessler::KESSLER, &docking::DOCKING, &tasking::TASKING];

/// Iterates over all worlds.
pub fn worlds() -> impl Iterator<Item = &'static dyn World> {
    WORLDS.into_iter()
}

/// Finds a benchmark by the id of its task, or the first one of a world by the world's name.
#[must_use]
pub fn benchmark(name: &str) -> Option<BenchSpec> {
    let all = || worlds().flat_map(World::benchmarks);
    let of_world = || worlds().find(|world| world.name() == name)?.benchmarks().first().copied();
    all().find(|spec| spec.task.id() == name).or_else(of_world)
}

/// Finds a world by its name, with or without its version.
#[must_use]
pub fn world(name: &str) -> Option<&'static dyn World> {
    worlds().find(|world| world.id() == name || world.name() == name)
}

/// Iterates over all tasks, world by world.
pub fn tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    worlds().flat_map(World::tasks)
}

/// The tasks of the first world, which are used if no tasks are given. Tasks of different worlds have different action
/// spaces, so no agent could be trained on all tasks.
#[must_use]
pub fn default_tasks() -> Vec<&'static dyn TaskSpec> {
    worlds().next().map(World::tasks).unwrap_or_default()
}

/// Finds a task by its id.
#[must_use]
pub fn task(id: &str) -> Option<&'static dyn TaskSpec> {
    tasks().find(|task| task.id() == id)
}
