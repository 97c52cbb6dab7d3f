//! What a model is told. The words are files in `prompts/`, one folder a version; whatever changes there gets a new
//! version, so that episodes can be told apart by the prompt that led to them.

use env_core::TaskSpec;
use serde_json::{Number, Value};

use super::actions::Actions;
use super::chat::Seen;
use super::kessler;

/// The version of the words.
const VERSION: &str = "1";
const SYSTEM: &str = include_str!("../../prompts/1/system.md");
const USER: &str = include_str!("../../prompts/1/user.md");
const REPAIR: &str = include_str!("../../prompts/1/repair.md");
const OTHER: &str = include_str!("../../prompts/1/other.md");
const KESSLER: &str = include_str!("../../prompts/1/kessler.md");
const GOALS: [(&str, &str); 4] = [
    ("kessler/survival", include_str!("../../prompts/1/kessler-survival.md")),
    ("kessler/eco_station", include_str!("../../prompts/1/kessler-eco_station.md")),
    ("kessler/rendezvous", include_str!("../../prompts/1/kessler-rendezvous.md")),
    ("kessler/formation", include_str!("../../prompts/1/kessler-formation.md")),
];
/// Significant digits of numbers in a compact observation of a world without tables.
const DIGITS: usize = 4;

/// How observations are told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telemetry {
    /// As tables of what matters; of a world without tables as JSON with fewer digits.
    Compact,
    /// As JSON, as the environment says it.
    Raw,
}

/// What a model is told of one task.
#[derive(Debug, Clone)]
pub struct Briefing {
    actions: Actions,
    telemetry: Telemetry,
    system: String,
    world: &'static str,
    tables: bool,
}

impl Briefing {
    /// A briefing on the task with these actions.
    #[must_use]
    pub fn new(actions: Actions, telemetry: Telemetry) -> Self {
        let task = actions.task();
        let tables = kessler::flies(task);
        let form = if tables {
            kessler::FORM.to_owned()
        } else {
            format!("It keeps to this JSON schema: {}", actions.schema())
        };
        let system = fill(SYSTEM, &[("rules", rules(task)), ("form", form)]);
        let world = task.world().split('@').next().unwrap_or_default();
        Self { actions, telemetry, system: system.trim_end().to_owned(), world, tables }
    }

    /// The version of the words, as `kessler-1`; `kessler-1-raw` where observations are raw.
    #[must_use]
    pub fn version(&self) -> String {
        let raw = if self.telemetry == Telemetry::Raw { "-raw" } else { "" };
        format!("{}-{VERSION}{raw}", self.world)
    }

    /// The task's actions.
    #[must_use]
    pub const fn actions(&self) -> &Actions {
        &self.actions
    }

    /// The rules.
    #[must_use]
    pub fn system(&self) -> &str {
        &self.system
    }

    /// What a step, counted from 1, looks like.
    #[must_use]
    pub fn user(&self, step: u32, seen: &Seen) -> String {
        let of = if self.tables { format!(" of {}", kessler::STEPS) } else { String::new() };
        let telemetry = match self.telemetry {
            Telemetry::Raw => seen.observation.to_string(),
            Telemetry::Compact => {
                let score = seen.observation["total_score"].as_f64().filter(|_| self.tables);
                let score = score.map_or_else(String::new, |score| format!("Score so far: {score:.3}. "));
                score + &compact(self.actions.task(), seen)
            }
        };
        let of = [
            ("step", step.to_string()),
            ("of", of),
            ("reward", format!("{:.4}", seen.reward)),
            ("telemetry", telemetry.trim_end().to_owned()),
        ];
        fill(USER, &of).trim_end().to_owned()
    }

    /// What is said of an answer that was no action.
    #[must_use]
    pub fn repair(&self, reason: &str) -> String {
        let of = [("reason", reason.to_owned()), ("hold", self.actions.hold().to_string())];
        fill(REPAIR, &of).trim_end().to_owned()
    }
}

/// What a task is about, and by which rules it is flown.
pub(crate) fn rules(task: &dyn TaskSpec) -> String {
    let rules = if kessler::flies(task) {
        let goal = GOALS.iter().find(|(id, _)| *id == task.id()).map_or(task.about(), |(_, goal)| goal);
        let goal = fill(goal.trim_end(), &[("steps", kessler::STEPS.to_string())]);
        fill(KESSLER, &[("goal", goal)])
    } else {
        fill(OTHER, &[("about", task.about().to_owned())])
    };
    rules.trim_end().to_owned()
}

/// An observation as tables; of a world without tables, or where it is none of its world, as JSON with fewer digits.
pub(crate) fn compact(task: &dyn TaskSpec, seen: &Seen) -> String {
    let tables = kessler::flies(task).then(|| kessler::compact(&seen.whole())).flatten();
    let told = tables.unwrap_or_else(|| rounded(&seen.observation).to_string());
    told.trim_end().to_owned()
}

/// Puts values in the places of their names, once: what a value says is never a place.
pub(crate) fn fill(template: &str, values: &[(&str, String)]) -> String {
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

/// A value with its fractions in so many significant digits.
fn rounded(value: &Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let short = number.as_f64().and_then(|number| format!("{number:.*e}", DIGITS - 1).parse().ok());
            short.and_then(Number::from_f64).map_or_else(|| value.clone(), Value::Number)
        }
        Value::Array(items) => items.iter().map(rounded).collect(),
        Value::Object(fields) => fields
            .iter()
            .map(|(name, value)| (name.clone(), rounded(value)))
            .collect::<serde_json::Map<_, _>>()
            .into(),
        other => other.clone(),
    }
}
