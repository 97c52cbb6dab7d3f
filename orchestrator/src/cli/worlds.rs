//! What the help says of worlds: their names and policies, as they themselves tell it.

use env_core::World;
use env_core::policy::PolicySpec;

/// The names of all built-in policies of all tasks, each once, in the order people should read them.
pub(super) fn policy_names() -> Vec<&'static str> {
    let mut names = Vec::new();
    for spec in env_core::tasks().flat_map(|task| task.policies()) {
        if !names.contains(&spec.name) {
            names.push(spec.name);
        }
    }
    names
}

/// What the policies of these names do, world by world where that differs: "hold does nothing; blind: in kessler …".
pub(super) fn policies_in_words(names: &[&str]) -> String {
    let words = names.iter().filter_map(|name| {
        let mut told: Vec<(&str, Vec<&str>)> = Vec::new();
        for world in env_core::worlds() {
            for about in abouts(world, name) {
                match told.iter_mut().find(|(known, _)| *known == about) {
                    Some((_, worlds)) if worlds.contains(&world.name()) => {}
                    Some((_, worlds)) => worlds.push(world.name()),
                    None => told.push((about, vec![world.name()])),
                }
            }
        }
        match told.as_slice() {
            [] => None,
            [(about, _)] => Some(format!("{name}: {about}")),
            several => {
                let each: Vec<String> = several
                    .iter()
                    .map(|(about, worlds)| format!("{} {about}", worlds.join(" and ")))
                    .collect();
                Some(format!("{name}: {}", each.join(", ")))
            }
        }
    });
    words.collect::<Vec<_>>().join("; ")
}

/// What a world's tasks say of the policy of this name.
fn abouts(world: &dyn World, name: &str) -> Vec<&'static str> {
    let of_name = |spec: &&PolicySpec| spec.name == name;
    world
        .tasks()
        .iter()
        .flat_map(|task| task.policies().iter().filter(of_name))
        .map(|spec| spec.about)
        .collect()
}

/// The names of all worlds.
pub(super) fn names() -> Vec<&'static str> {
    env_core::worlds().map(World::name).collect()
}
