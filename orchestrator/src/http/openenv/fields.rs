//! Fields of requests, read leniently as openenv-core's pydantic models do, with the location of every error.

use std::str::FromStr;

use env_core::{Scenario, TaskSpec};
use evaluation::suite::file::{BUILT_IN_SUITES, built_in_names};
use openenv_wire::{LocSegment, NumberError, ValidationError, echo_input, parse_integer, parse_number};
use serde_json::{Map, Value, json};
use store::ids::InvalidId;

use super::tasks::{RESET_ORDER, known_tasks, task_by_name};
use crate::sessions::{MAX_NAME_CHARS, SessionRequest, SuiteScenario};

/// Reads the fields of an object and collects errors.
pub(in crate::http) struct FieldReader<'a> {
    object: &'a Map<String, Value>,
    location: Vec<LocSegment>,
    pub(in crate::http) errors: Vec<ValidationError>,
}

impl<'a> FieldReader<'a> {
    /// Creates a reader of the object at a location.
    pub(in crate::http) const fn new(object: &'a Map<String, Value>, location: Vec<LocSegment>) -> Self {
        Self { object, location, errors: Vec::new() }
    }

    /// Returns the location of a field, given as a dotted path.
    fn field_location(&self, field: &str) -> Vec<LocSegment> {
        let mut location = self.location.clone();
        location.extend(field.split('.').map(|part| LocSegment::Field(part.to_owned())));
        location
    }

    /// Returns a field that is present and not null.
    pub(super) fn get(&self, field: &str) -> Option<&'a Value> {
        self.object.get(field).filter(|value| !value.is_null())
    }

    /// Adds an error of a field with its input.
    pub(super) fn add_error(
        &mut self,
        field: &str,
        kind: &'static str,
        message: impl Into<String>,
        input: &Value,
    ) {
        let error = ValidationError {
            kind,
            loc: self.field_location(field),
            msg: message.into(),
            input: echo_input(input),
            ctx: None,
        };
        self.errors.push(error);
    }

    /// Adds the error of an unknown field.
    pub(super) fn add_unknown_field(&mut self, field: &str, input: &Value) {
        let mut loc = self.location.clone();
        loc.push(LocSegment::Field(field.chars().take(MAX_NAME_CHARS).collect()));
        let msg = "Extra inputs are not permitted".to_owned();
        let input = echo_input(input);
        self.errors.push(ValidationError { kind: "extra_forbidden", loc, msg, input, ctx: None });
    }

    /// Adds an error of a bound, with the bound as context.
    fn add_bound_error(&mut self, field: &str, kind: &'static str, message: String, ctx: Value) {
        let input = self.object.get(field).map_or(Value::Null, echo_input);
        self.errors.push(ValidationError {
            kind,
            loc: self.field_location(field),
            msg: message,
            input,
            ctx: Some(ctx),
        });
    }

    /// Reads an integer from 0 to `max`.
    pub(super) fn integer(&mut self, field: &str, max: u64) -> Option<u64> {
        let value = self.get(field)?;
        let number = match parse_integer(value) {
            Ok(number) => number,
            Err(NumberError { kind, msg }) => {
                self.add_error(field, kind, msg, value);
                return None;
            }
        };
        match u64::try_from(number) {
            Err(_) => {
                let message = "Input should be greater than or equal to 0".to_owned();
                self.add_bound_error(field, "greater_than_equal", message, json!({"ge": 0}));
                None
            }
            Ok(number) if number > max => {
                let message = format!("Input should be less than or equal to {max}");
                self.add_bound_error(field, "less_than_equal", message, json!({"le": max}));
                None
            }
            Ok(number) => Some(number),
        }
    }

    /// Reads a string of at most 255 characters.
    pub(super) fn text(&mut self, field: &str) -> Option<String> {
        let value = self.get(field)?;
        let Some(text) = value.as_str() else {
            self.add_error(field, "string_type", "Input should be a valid string", value);
            return None;
        };
        if text.chars().count() > MAX_NAME_CHARS {
            let message = format!("String should have at most {MAX_NAME_CHARS} characters");
            self.add_bound_error(field, "string_too_long", message, json!({"max_length": MAX_NAME_CHARS}));
            return None;
        }
        Some(text.to_owned())
    }

    /// Reads a positive number.
    pub(super) fn positive_number(&mut self, field: &str) -> Option<f64> {
        let value = self.get(field)?;
        match parse_number(value) {
            Ok(number) if number > 0.0 => Some(number),
            Ok(_) => {
                let message = "Input should be greater than 0".to_owned();
                self.add_bound_error(field, "greater_than", message, json!({"gt": 0.0}));
                None
            }
            Err(NumberError { kind, msg }) => {
                self.add_error(field, kind, msg, value);
                None
            }
        }
    }

    /// Reads an id in its text form.
    fn id<T: FromStr<Err = InvalidId>>(&mut self, field: &str) -> Option<T> {
        let text = self.text(field)?;
        match text.parse() {
            Ok(id) => Some(id),
            Err(error) => {
                self.add_error(field, "value_error", format!("Value error, {error}"), &Value::String(text));
                None
            }
        }
    }

    /// Reads an object whose values have one type.
    fn table<T>(&mut self, field: &str, read: impl Fn(&Value) -> Result<T, NumberError>) -> Vec<(String, T)> {
        let Some(value) = self.get(field) else { return Vec::new() };
        let Some(table) = value.as_object() else {
            self.add_error(field, "dict_type", "Input should be a valid dictionary", value);
            return Vec::new();
        };
        let mut rows = Vec::new();
        for (name, value) in table {
            match read(value) {
                Ok(read) => rows.push((name.clone(), read)),
                Err(NumberError { kind, msg }) => {
                    self.add_error(&format!("{field}.{name}"), kind, msg, value);
                }
            }
        }
        rows
    }
}

/// Names that clients confuse with fields of a reset, and the fields. Other unknown fields are ignored, but an episode outside
/// of the run that a client means would be lost to it.
const MISTAKEN_NAMES: [(&str, &str); 4] =
    [("run_id", "run"), ("lease", "lease_id"), ("group", "group_id"), ("task_id", "task")];

/// Fields of the data of a reset.
const RESET_FIELDS: [&str; 13] = [
    "seed",
    "task",
    "params",
    "physics",
    "scenario",
    "run",
    "lease_id",
    "group_id",
    "group_size",
    "policy_version",
    "split",
    "index",
    "episode_id",
];

/// Parameters of a query, in order.
pub(super) type QueryParams = Vec<(String, String)>;

/// Returns the reason if a query has a field of a reset, which would be ignored there: the episode would have another scenario, or be
/// lost to its run. Other parameters are ignored, as OpenEnv's server does.
pub(super) fn misplaced_field(query: &QueryParams) -> Option<String> {
    let is_mistaken = |name: &str| MISTAKEN_NAMES.iter().any(|(mistaken, _)| *mistaken == name);
    let (name, _) =
        query.iter().find(|(name, _)| RESET_FIELDS.contains(&name.as_str()) || is_mistaken(name))?;
    Some(format!("`{name}` must be sent in the data of a reset, not in the query"))
}

/// Reads the data of a reset.
pub(in crate::http) fn read_session_request(fields: &mut FieldReader<'_>) -> SessionRequest {
    for (mistaken, field) in MISTAKEN_NAMES {
        if let Some(value) = fields.get(mistaken) {
            fields.add_error(
                mistaken,
                "value_error",
                format!("Value error, must be sent as `{field}`"),
                value,
            );
        }
    }
    let seed = fields.integer("seed", env_core::seed::MAX_USER_SEED);
    let task = task(fields);
    let policy_version = fields.integer("policy_version", u64::from(u32::MAX));
    let group_size = fields.integer("group_size", u64::from(u32::MAX));
    let narrow = |number: Option<u64>| number.and_then(|number| u32::try_from(number).ok());
    let scenario = fields.get("scenario").and_then(|value| match Scenario::from_json(value) {
        Ok(scenario) => Some(scenario),
        Err(error) => {
            let field = error.field();
            let field = if field == "scenario" { field.to_owned() } else { format!("scenario.{field}") };
            fields.add_error(&field, "value_error", format!("Value error, {}", error.reason()), value);
            None
        }
    });
    let text = |value: &Value| {
        let text = value.as_str().map(str::to_owned);
        text.ok_or(NumberError { kind: "string_type", msg: "Input should be a valid string" })
    };
    let suite_scenario = suite_scenario(fields);
    SessionRequest {
        seed,
        suite_scenario,
        episode_id: fields.text("episode_id"),
        task,
        params: fields.table("params", parse_number),
        physics: fields.table("physics", text),
        scenario,
        run: fields.id("run"),
        lease: fields.id("lease_id"),
        group: fields.text("group_id"),
        group_size: narrow(group_size),
        policy_version: narrow(policy_version),
    }
}

/// Reads `split` and `index`, which select a scenario of a suite.
fn suite_scenario(fields: &mut FieldReader<'_>) -> Option<SuiteScenario> {
    let (split, index) = (fields.text("split"), fields.integer("index", u64::from(u32::MAX)));
    let field = if split.is_none() { "split" } else { "index" };
    let suite = match (split, index) {
        (Some(split), Some(_)) => split,
        (None, None) => return None,
        _ => {
            if fields.errors.is_empty() {
                let message = "Value error, is required: a scenario of a suite has a split and an index";
                fields.add_error(field, "value_error", message, &Value::Null);
            }
            return None;
        }
    };
    let Some(suite) = BUILT_IN_SUITES.iter().find(|known| known.name == suite) else {
        let message = format!("Value error, must be one of {}", built_in_names());
        fields.add_error("split", "value_error", message, &Value::String(suite));
        return None;
    };
    Some(SuiteScenario { suite: suite.name, index: index.and_then(|index| usize::try_from(index).ok())? })
}

/// Reads a task: its id, its name in the first world, or its number in the public kessler-env, from 1.
fn task(fields: &mut FieldReader<'_>) -> Option<&'static dyn TaskSpec> {
    let value = fields.get("task")?;
    let by_number = value.as_u64().and_then(|n| n.checked_sub(1)).and_then(|n| usize::try_from(n).ok());
    let id = match value {
        Value::Number(_) => by_number.and_then(|n| RESET_ORDER.get(n)).map(|id| (*id).to_owned()),
        Value::String(name) => Some(name.clone()),
        _ => None,
    };
    let task = id.as_deref().and_then(task_by_name);
    if task.is_none() {
        let message = format!("Value error, must be one of {}", known_tasks());
        fields.add_error("task", "value_error", message, value);
    }
    task
}
