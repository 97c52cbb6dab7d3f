//! Prompts of the model judge. The texts are files in `prompts/`, one folder for each version.

use super::JudgedStep;
use crate::{TimeStep, prompt};

/// Version of the prompt texts.
pub(super) const JUDGE_PROMPT_VERSION: &str = "judge-2";
const JUDGE_SYSTEM_TEMPLATE: &str = include_str!("../../prompts/judge-2/system.md");
const JUDGE_USER_TEMPLATE: &str = include_str!("../../prompts/judge-2/user.md");

/// Returns the system message: the rules of the task, and how to judge.
pub(super) fn system(step: &JudgedStep<'_>) -> String {
    let rules = prompt::task_rules(step.scenario.task());
    prompt::fill_template(JUDGE_SYSTEM_TEMPLATE, &[("rules", rules)]).trim_end().to_owned()
}

/// Returns the user message: the action with the observations before and after it.
pub(super) fn user(step: &JudgedStep<'_>, before: &TimeStep, after: &TimeStep) -> String {
    let task = step.scenario.task();
    let values = [
        ("step", step.log.len().to_string()),
        ("before", prompt::compact_observation(task, before)),
        ("action", step.action_text()),
        ("reward", format!("{:.4}", after.reward)),
        ("after", prompt::compact_observation(task, after)),
    ];
    prompt::fill_template(JUDGE_USER_TEMPLATE, &values).trim_end().to_owned()
}
