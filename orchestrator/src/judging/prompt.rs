//! What a judge is told. The words are files in `prompts/`, one folder a version.

use super::{Step, action};
use crate::policy::{Seen, prompt};

/// The version of the words.
pub(super) const VERSION: &str = "judge-1";
const SYSTEM: &str = include_str!("../../prompts/judge-1/system.md");
const USER: &str = include_str!("../../prompts/judge-1/user.md");

/// The rules, and how to judge.
pub(super) fn system(step: &Step<'_>) -> String {
    let rules = prompt::rules(step.scenario.task());
    prompt::fill(SYSTEM, &[("rules", rules)]).trim_end().to_owned()
}

/// The step.
pub(super) fn user(step: &Step<'_>, before: &Seen, after: &Seen) -> String {
    let task = step.scenario.task();
    let of = [
        ("step", step.log.len().to_string()),
        ("before", prompt::compact(task, before)),
        ("action", action(step.scenario, step.log)),
        ("reward", format!("{:.4}", after.reward)),
        ("after", prompt::compact(task, after)),
    ];
    prompt::fill(USER, &of).trim_end().to_owned()
}
