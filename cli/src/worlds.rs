//! What the help says of worlds: their names and policies, as they themselves tell it.

use env_core::World;
use env_core::policy::PolicySpec;
use env_core::space::ParamSpec;

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

/// What the policies of these names do, a line each, world by world where that differs.
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
            [(about, _)] => Some(format!("  {name}: {about}")),
            several => {
                let each = several.iter().map(|(about, worlds)| format!("{about} ({})", worlds.join(", ")));
                Some(format!("  {name}: {}", each.collect::<Vec<_>>().join("; ")))
            }
        }
    });
    words.collect::<Vec<_>>().join("\n")
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

/// A param's name and value for people, with its unit where the name ends in it: "fuel 20", "time limit 500 s".
pub(super) fn param_in_words(spec: &ParamSpec, value: &str) -> String {
    let unit = spec.name.strip_suffix(spec.unit).and_then(|name| name.strip_suffix('_'));
    match unit.filter(|_| !spec.unit.is_empty()) {
        Some(name) => format!("{} {value} {}", name.replace('_', " "), spec.unit),
        None => format!("{} {value}", spec.name.replace('_', " ")),
    }
}

/// The names of all worlds.
pub(super) fn names() -> Vec<&'static str> {
    env_core::worlds().map(World::name).collect()
}
