//! What stands around an action, read as openenv-core's pydantic models read it: leniently, with every fault told by place.

use std::str::FromStr;

use openenv_wire::{LocSegment, NumberError, ValidationError, echo_input, parse_integer, parse_number};
use env_core::{Scenario, TaskSpec};
use serde_json::{Map, Value, json};

use crate::ids::InvalidId;
use crate::sessions::{MAX_NAME_CHARS, SessionRequest};

/// The public kessler-env's tasks, in the order in which its resets walk through them.
pub(super) const WALK: [&str; 3] = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];

/// Reads fields of an object, collecting faults.
pub(super) struct Fields<'a> {
    of: &'a Map<String, Value>,
    at: Vec<LocSegment>,
    pub(super) faults: Vec<ValidationError>,
}

impl<'a> Fields<'a> {
    /// Of the object at a place.
    pub(super) const fn new(of: &'a Map<String, Value>, at: Vec<LocSegment>) -> Self {
        Self { of, at, faults: Vec::new() }
    }

    pub(super) fn place(&self, field: &str) -> Vec<LocSegment> {
        let mut place = self.at.clone();
        place.extend(field.split('.').map(|part| LocSegment::Field(part.to_owned())));
        place
    }

    /// What is there and not null.
    pub(super) fn get(&self, field: &str) -> Option<&'a Value> {
        self.of.get(field).filter(|value| !value.is_null())
    }

    pub(super) fn fault(&mut self, field: &str, kind: &'static str, words: impl Into<String>, input: &Value) {
        let fault =
            ValidationError { kind, loc: self.place(field), msg: words.into(), input: echo_input(input), ctx: None };
        self.faults.push(fault);
    }

    /// A field that nobody asked for.
    pub(super) fn extra(&mut self, field: &str, input: &Value) {
        let mut loc = self.at.clone();
        loc.push(LocSegment::Field(field.chars().take(MAX_NAME_CHARS).collect()));
        let msg = "Extra inputs are not permitted".to_owned();
        let input = echo_input(input);
        self.faults.push(ValidationError { kind: "extra_forbidden", loc, msg, input, ctx: None });
    }

    fn bounded(&mut self, field: &str, kind: &'static str, words: String, ctx: Value) {
        let input = self.of.get(field).map_or(Value::Null, echo_input);
        self.faults.push(ValidationError { kind, loc: self.place(field), msg: words, input, ctx: Some(ctx) });
    }

    /// A whole number from 0 to a bound.
    pub(super) fn whole(&mut self, field: &str, most: u64) -> Option<u64> {
        let value = self.get(field)?;
        let number = match parse_integer(value) {
            Ok(number) => number,
            Err(NumberError { kind, msg }) => {
                self.fault(field, kind, msg, value);
                return None;
            }
        };
        match u64::try_from(number) {
            Err(_) => {
                let words = "Input should be greater than or equal to 0".to_owned();
                self.bounded(field, "greater_than_equal", words, json!({"ge": 0}));
                None
            }
            Ok(number) if number > most => {
                let words = format!("Input should be less than or equal to {most}");
                self.bounded(field, "less_than_equal", words, json!({"le": most}));
                None
            }
            Ok(number) => Some(number),
        }
    }

    /// A text of at most 255 characters.
    pub(super) fn text(&mut self, field: &str) -> Option<String> {
        let value = self.get(field)?;
        let Some(text) = value.as_str() else {
            self.fault(field, "string_type", "Input should be a valid string", value);
            return None;
        };
        if text.chars().count() > MAX_NAME_CHARS {
            let words = format!("String should have at most {MAX_NAME_CHARS} characters");
            self.bounded(field, "string_too_long", words, json!({"max_length": MAX_NAME_CHARS}));
            return None;
        }
        Some(text.to_owned())
    }

    /// A number above 0.
    pub(super) fn above_zero(&mut self, field: &str) -> Option<f64> {
        let value = self.get(field)?;
        match parse_number(value) {
            Ok(number) if number > 0.0 => Some(number),
            Ok(_) => {
                let words = "Input should be greater than 0".to_owned();
                self.bounded(field, "greater_than", words, json!({"gt": 0.0}));
                None
            }
            Err(NumberError { kind, msg }) => {
                self.fault(field, kind, msg, value);
                None
            }
        }
    }

    fn id<T: FromStr<Err = InvalidId>>(&mut self, field: &str) -> Option<T> {
        let text = self.text(field)?;
        match text.parse() {
            Ok(id) => Some(id),
            Err(error) => {
                self.fault(field, "value_error", format!("Value error, {error}"), &Value::String(text));
                None
            }
        }
    }

    fn table<T>(&mut self, field: &str, read: impl Fn(&Value) -> Result<T, NumberError>) -> Vec<(String, T)> {
        let Some(value) = self.get(field) else { return Vec::new() };
        let Some(table) = value.as_object() else {
            self.fault(field, "dict_type", "Input should be a valid dictionary", value);
            return Vec::new();
        };
        let mut rows = Vec::new();
        for (name, value) in table {
            match read(value) {
                Ok(read) => rows.push((name.clone(), read)),
                Err(NumberError { kind, msg }) => self.fault(&format!("{field}.{name}"), kind, msg, value),
            }
        }
        rows
    }
}

/// The data of a reset as a wish.
pub(super) fn wish(fields: &mut Fields<'_>) -> SessionRequest {
    let seed = fields.whole("seed", env_core::seed::MAX_USER_SEED);
    let task = task(fields);
    let policy_version = fields.whole("policy_version", u64::from(u32::MAX));
    let group_size = fields.whole("group_size", u64::from(u32::MAX));
    let narrow = |number: Option<u64>| number.and_then(|number| u32::try_from(number).ok());
    let scenario = fields.get("scenario").and_then(|value| match Scenario::from_json(value) {
        Ok(scenario) => Some(scenario),
        Err(error) => {
            let field = error.field();
            let field = if field == "scenario" { field.to_owned() } else { format!("scenario.{field}") };
            fields.fault(&field, "value_error", format!("Value error, {error}"), value);
            None
        }
    });
    let text = |value: &Value| {
        let word = value.as_str().map(str::to_owned);
        word.ok_or(NumberError { kind: "string_type", msg: "Input should be a valid string" })
    };
    SessionRequest {
        seed,
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

/// A task by its id, or by its name in the first world.
pub(in super::super) fn named(name: &str) -> Option<&'static dyn TaskSpec> {
    if name.contains('/') {
        return env_core::task(name);
    }
    env_core::default_tasks().into_iter().find(|task| task.id().split('/').next_back() == Some(name))
}

/// All tasks, for messages.
pub(in super::super) fn known() -> String {
    env_core::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", ")
}

/// A task by its id, by its name in the first world, or by its number in the original's walk, from 1.
fn task(fields: &mut Fields<'_>) -> Option<&'static dyn TaskSpec> {
    let value = fields.get("task")?;
    let by_number = value.as_u64().and_then(|n| n.checked_sub(1)).and_then(|n| usize::try_from(n).ok());
    let id = match value {
        Value::Number(_) => by_number.and_then(|n| WALK.get(n)).map(|id| (*id).to_owned()),
        Value::String(name) => Some(name.clone()),
        _ => None,
    };
    let task = id.as_deref().and_then(named);
    if task.is_none() {
        let words = format!("Value error, there is no such task; known are {}", known());
        fields.fault("task", "value_error", words, value);
    }
    task
}
