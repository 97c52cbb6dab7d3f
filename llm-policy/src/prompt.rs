//! Prompts of the chat policy. The texts are files in `prompts/`, one folder for each version. A changed text gets a new
//! version, so that every episode can be traced to the prompt that led to it.

use env_core::TaskSpec;
use serde_json::{Number, Value};

use super::action_codec::ActionCodec;
use super::kessler;
use super::time_step::TimeStep;

/// Version of the prompt texts.
const PROMPT_VERSION: &str = "2";
const SYSTEM_TEMPLATE: &str = include_str!("../prompts/2/system.md");
const USER_TEMPLATE: &str = include_str!("../prompts/2/user.md");
const REPAIR_TEMPLATE: &str = include_str!("../prompts/2/repair.md");
const OTHER_RULES: &str = include_str!("../prompts/2/other.md");
const KESSLER_RULES: &str = include_str!("../prompts/2/kessler.md");
const KESSLER_GOALS: [(&str, &str); 4] = [
    ("kessler/survival", include_str!("../prompts/2/kessler-survival.md")),
    ("kessler/eco_station", include_str!("../prompts/2/kessler-eco_station.md")),
    ("kessler/rendezvous", include_str!("../prompts/2/kessler-rendezvous.md")),
    ("kessler/formation", include_str!("../prompts/2/kessler-formation.md")),
];
/// Significant digits of numbers in a compact observation of a world without tables.
const SIGNIFICANT_DIGITS: usize = 4;

/// Format of the observations in a prompt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationFormat {
    /// Tables of the relevant values, or JSON with fewer digits if the world has no tables.
    Compact,
    /// JSON as the environment sends it.
    Raw,
}

/// Prompt texts of one task.
#[derive(Debug, Clone)]
pub struct TaskPrompt {
    codec: ActionCodec,
    format: ObservationFormat,
    system: String,
    /// Name of the world without its version.
    world: &'static str,
    /// True if the world's observations are formatted as tables.
    has_tables: bool,
}

impl TaskPrompt {
    /// Creates the prompt of the codec's task.
    #[must_use]
    pub fn new(codec: ActionCodec, format: ObservationFormat) -> Self {
        let task = codec.task();
        let has_tables = kessler::is_kessler(task);
        let form = if has_tables {
            kessler::ACTION_FORM.to_owned()
        } else {
            format!("The object must match this JSON schema: {}", codec.schema())
        };
        let system = fill_template(SYSTEM_TEMPLATE, &[("rules", task_rules(task)), ("form", form)]);
        let world = task.world().split('@').next().unwrap_or_default();
        Self { codec, format, system: system.trim_end().to_owned(), world, has_tables }
    }

    /// Adds instructions of a user to the system message.
    pub fn add_instructions(&mut self, instructions: &str) {
        self.system.push_str("\n\nInstructions of the user:\n");
        self.system.push_str(instructions.trim());
    }

    /// Returns the version of the prompt: `kessler-2`, or `kessler-2-raw` with raw observations.
    #[must_use]
    pub fn version(&self) -> String {
        let raw = if self.format == ObservationFormat::Raw { "-raw" } else { "" };
        format!("{}-{PROMPT_VERSION}{raw}", self.world)
    }

    /// Returns the codec of the task's actions.
    #[must_use]
    pub const fn codec(&self) -> &ActionCodec {
        &self.codec
    }

    /// Returns the system message: the rules and the form of an action.
    #[must_use]
    pub fn system(&self) -> &str {
        &self.system
    }

    /// Returns the user message of a step, counted from 1.
    #[must_use]
    pub fn user(&self, step: u32, time_step: &TimeStep) -> String {
        let of = if self.has_tables { format!(" of {}", kessler::STEPS) } else { String::new() };
        let telemetry = match self.format {
            ObservationFormat::Raw => time_step.observation.to_string(),
            ObservationFormat::Compact => {
                let score = time_step.observation["total_score"].as_f64().filter(|_| self.has_tables);
                let score = score.map_or_else(String::new, |score| format!("Score so far: {score:.3}. "));
                score + &compact_observation(self.codec.task(), time_step)
            }
        };
        let values = [
            ("step", step.to_string()),
            ("of", of),
            ("reward", format!("{:.4}", time_step.reward)),
            ("telemetry", telemetry.trim_end().to_owned()),
        ];
        fill_template(USER_TEMPLATE, &values).trim_end().to_owned()
    }

    /// Returns the user message that follows a reply that was not an action.
    #[must_use]
    pub fn repair(&self, reason: &str) -> String {
        let values = [("reason", reason.to_owned()), ("hold", self.codec.hold().to_string())];
        fill_template(REPAIR_TEMPLATE, &values).trim_end().to_owned()
    }
}

/// Returns the goal and the rules of a task.
pub(crate) fn task_rules(task: &dyn TaskSpec) -> String {
    let rules = if kessler::is_kessler(task) {
        let goal = KESSLER_GOALS
            .iter()
            .find(|(id, _)| *id == task.id())
            .map_or(task.description(), |(_, goal)| goal);
        let goal = fill_template(goal.trim_end(), &[("steps", kessler::STEPS.to_string())]);
        fill_template(KESSLER_RULES, &[("goal", goal)])
    } else {
        fill_template(OTHER_RULES, &[("about", task.description().to_owned())])
    };
    rules.trim_end().to_owned()
}

/// Formats an observation as tables, or as JSON with fewer digits if the world has no tables or did not produce it.
pub(crate) fn compact_observation(task: &dyn TaskSpec, time_step: &TimeStep) -> String {
    let tables = kessler::is_kessler(task)
        .then(|| kessler::format_observation(&time_step.with_reward_and_done()))
        .flatten();
    let text = tables.unwrap_or_else(|| round_numbers(&time_step.observation).to_string());
    text.trim_end().to_owned()
}

/// Replaces each `{{name}}` by its value in one pass: names inside values are not replaced.
pub(crate) fn fill_template(template: &str, values: &[(&str, String)]) -> String {
    let mut text = String::with_capacity(template.len());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        text.push_str(before);
        let value = after
            .split_once("}}")
            .and_then(|(name, left)| Some((values.iter().find(|(known, _)| *known == name)?, left)));
        match value {
            Some(((_, value), left)) => {
                text.push_str(value);
                rest = left;
            }
            None => {
                text.push_str("{{");
                rest = after;
            }
        }
    }
    text + rest
}

/// Rounds every fraction in a value to [`SIGNIFICANT_DIGITS`].
fn round_numbers(value: &Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let digits = SIGNIFICANT_DIGITS - 1;
            let rounded = number.as_f64().and_then(|number| format!("{number:.digits$e}").parse().ok());
            rounded.and_then(Number::from_f64).map_or_else(|| value.clone(), Value::Number)
        }
        Value::Array(items) => items.iter().map(round_numbers).collect(),
        Value::Object(fields) => fields
            .iter()
            .map(|(name, value)| (name.clone(), round_numbers(value)))
            .collect::<serde_json::Map<_, _>>()
            .into(),
        other => other.clone(),
    }
}
