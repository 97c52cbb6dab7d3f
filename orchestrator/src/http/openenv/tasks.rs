//! Tasks by the names that OpenEnv's clients use.

use env_core::TaskSpec;

/// Tasks of the public kessler-env, in the order in which its resets go through them.
pub(super) const RESET_ORDER: [&str; 3] = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];

/// Returns a task by its id, or by its name in the first world.
pub(crate) fn task_by_name(name: &str) -> Option<&'static dyn TaskSpec> {
    if name.contains('/') {
        return env_core::task(name);
    }
    env_core::default_tasks().into_iter().find(|task| task.id().split('/').next_back() == Some(name))
}

/// Returns the ids of all tasks, for messages.
pub(crate) fn known_tasks() -> String {
    env_core::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", ")
}

/// Returns the task of an id that the source code names.
pub(crate) fn built_in_task(id: &str) -> &'static dyn TaskSpec {
    let first = || env_core::tasks().next();
    // There is always a task, and an id in the source code is known.
    env_core::task(id).or_else(first).unwrap_or_else(|| unreachable!("there are tasks"))
}
