//! Names that users type: tasks, and suggestions for names that do not exist.

use std::collections::BTreeSet;

use env_core::TaskSpec;

/// Smallest similarity (Jaro–Winkler) of a suggestion.
const MIN_SIMILARITY: f64 = 0.75;
/// Largest difference in similarity from the best suggestion.
const MAX_DISTANCE_FROM_BEST: f64 = 0.08;
/// Largest number of suggestions.
const MAX_SUGGESTIONS: usize = 3;

/// Finds a task by its id, or by the part after the `/` if only one task has it.
///
/// # Errors
/// Returns a message with similar names if no single task has the name.
pub fn find_task(name: &str) -> Result<&'static dyn TaskSpec, String> {
    let is_short = |task: &&'static dyn TaskSpec| task.id().rsplit('/').next() == Some(name);
    if let Some(task) = env_core::task(name) {
        return Ok(task);
    }
    let mut meant = env_core::tasks().filter(is_short);
    match (meant.next(), meant.next()) {
        (Some(task), None) => Ok(task),
        (Some(_), Some(_)) => {
            let ids = env_core::tasks().filter(is_short).map(TaskSpec::id).collect::<Vec<_>>().join(", ");
            Err(format!("several tasks are called {name}: choose one of {ids}"))
        }
        (None, _) => {
            let ids: Vec<&str> = env_core::tasks().map(TaskSpec::id).collect();
            let short = ids.iter().filter_map(|id| id.rsplit('/').next());
            let known = ids.iter().copied().chain(short);
            Err(format!(
                "there is no task {name:?}{}; the tasks are {}",
                suggest(name, known),
                ids.join(", ")
            ))
        }
    }
}

/// Parses the name of a task and returns its id.
///
/// # Errors
/// Returns the errors of [`find_task`].
pub fn parse_task(name: &str) -> Result<String, String> {
    find_task(name).map(|task| task.id().to_owned())
}

/// Returns ` (did you mean …?)` with the known names that are similar, the most similar first, or an empty string.
pub fn suggest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let lower = name.to_lowercase();
    // A run may have its id as its name.
    let known: BTreeSet<&str> = known.collect();
    let mut near: Vec<(f64, &str)> = known
        .into_iter()
        .map(|known| (strsim::jaro_winkler(&lower, &known.to_lowercase()), known))
        .filter(|(similarity, _)| *similarity >= MIN_SIMILARITY)
        .collect();
    near.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best = near.first().map_or(0.0, |(similarity, _)| *similarity);
    near.retain(|(similarity, _)| best - similarity <= MAX_DISTANCE_FROM_BEST);
    near.truncate(MAX_SUGGESTIONS);
    let names: Vec<&str> = near.into_iter().map(|(_, known)| known).collect();
    if names.is_empty() { String::new() } else { format!(" (did you mean {}?)", names.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_found_by_id_and_short_name() {
        let id = |name| find_task(name).unwrap().id();
        assert_eq!(id("kessler/survival"), "kessler/survival");
        assert_eq!((id("survival"), id("multiagent")), ("kessler/survival", "docking/multiagent"));
        insta::assert_snapshot!(
            ["survivel", "kessler/formaton", "golf"].map(|name| parse_task(name).unwrap_err()).join("\n")
        );
    }
}
