//! Names, policies and params of the worlds as text, for help and messages.

use env_core::World;
use env_core::policy::PolicySpec;
use env_core::space::ParamSpec;

/// Returns the names of all built-in policies of all tasks, each once, in reading order.
pub fn policy_names() -> Vec<&'static str> {
    let mut names = Vec::new();
    for spec in env_core::tasks().flat_map(|task| task.policies()) {
        if !names.contains(&spec.name) {
            names.push(spec.name);
        }
    }
    names
}

/// Describes the policies of these names, one per line. Descriptions that differ between worlds are listed by world.
pub fn describe_policies(names: &[&str]) -> String {
    let words = names.iter().filter_map(|name| {
        let mut descriptions: Vec<(&str, Vec<&str>)> = Vec::new();
        for world in env_core::worlds() {
            for about in policy_descriptions(world, name) {
                match descriptions.iter_mut().find(|(known, _)| *known == about) {
                    Some((_, worlds)) if worlds.contains(&world.name()) => {}
                    Some((_, worlds)) => worlds.push(world.name()),
                    None => descriptions.push((about, vec![world.name()])),
                }
            }
        }
        match descriptions.as_slice() {
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

/// Returns the descriptions of a policy in all tasks of a world.
fn policy_descriptions(world: &dyn World, name: &str) -> Vec<&'static str> {
    let of_name = |spec: &&PolicySpec| spec.name == name;
    world
        .tasks()
        .iter()
        .flat_map(|task| task.policies().iter().filter(of_name))
        .map(|spec| spec.description)
        .collect()
}

/// Formats a param's name and value, as "fuel 20". A unit at the end of the name follows the value: "time limit 500 s".
pub fn describe_param(spec: &ParamSpec, value: &str) -> String {
    let unit = spec.name.strip_suffix(spec.unit).and_then(|name| name.strip_suffix('_'));
    match unit.filter(|_| !spec.unit.is_empty()) {
        Some(name) => format!("{} {value} {}", name.replace('_', " "), spec.unit),
        None => format!("{} {value}", spec.name.replace('_', " ")),
    }
}

/// Returns the names of all worlds.
pub fn names() -> Vec<&'static str> {
    env_core::worlds().map(|world| world.name()).collect()
}
