//! All worlds, and all tasks of them.

use crate::task::TaskSpec;
use crate::world::World;
use crate::{docking, kessler};

/// Every world.
static WORLDS: [&dyn World; 2] = [&kessler::KESSLER, &docking::DOCKING];

/// Every world.
pub fn worlds() -> impl Iterator<Item = &'static dyn World> {
    WORLDS.into_iter()
}

/// A world by its name, with or without its version.
#[must_use]
pub fn world(name: &str) -> Option<&'static dyn World> {
    worlds().find(|world| world.id() == name || world.name() == name)
}

/// Every task, world by world.
pub fn tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    worlds().flat_map(World::tasks)
}

/// The tasks of the first world: what is meant where nobody says which. One agent has one action space, so all tasks of
/// all worlds would be nobody's.
#[must_use]
pub fn usual_tasks() -> Vec<&'static dyn TaskSpec> {
    worlds().next().map(World::tasks).unwrap_or_default()
}

/// A task by its id.
#[must_use]
pub fn task(id: &str) -> Option<&'static dyn TaskSpec> {
    tasks().find(|task| task.id() == id)
}
