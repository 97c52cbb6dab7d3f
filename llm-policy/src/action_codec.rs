//! Conversion of a task's actions between steps of a log, JSON and the objects that models write. The
//! wire format of the task decides which values are an action ([`openenv_wire::WireFormat`]).

use std::sync::Arc;

use env_core::log::{ActionLog, Precision};
use env_core::{JointAction, TaskSpec};
use openenv_wire::{parse_integer, wire_format};
use serde_json::Value;

/// Encoder and decoder of the actions of one task.
#[derive(Clone)]
pub struct ActionCodec {
    task: &'static dyn TaskSpec,
    schema: Arc<Value>,
}

impl std::fmt::Debug for ActionCodec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("ActionCodec").field(&self.task.id()).finish()
    }
}

impl ActionCodec {
    /// Creates the codec of a task.
    #[must_use]
    pub fn new(task: &'static dyn TaskSpec) -> Self {
        Self { task, schema: Arc::new(wire_format(task).strict_schema().clone()) }
    }

    /// Returns the task whose actions are converted.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// Returns the JSON schema that a model's reply must match.
    #[must_use]
    pub const fn schema(&self) -> &Arc<Value> {
        &self.schema
    }

    /// Returns the action *hold*, in which no agent does anything.
    #[must_use]
    pub fn hold(&self) -> Value {
        self.encode(JointAction::HOLD)
    }

    /// Encodes a step of a log as JSON.
    #[must_use]
    pub fn encode(&self, step: JointAction<'_>) -> Value {
        // The wire format writes valid JSON.
        serde_json::from_str(&wire_format(self.task).write_action(step)).unwrap_or(Value::Null)
    }

    /// Writes an action as text, with its fields in the order of the schema.
    #[must_use]
    pub fn to_text(&self, action: &Value) -> String {
        let log = self.to_log(action);
        log.map_or_else(|_| action.to_string(), |log| wire_format(self.task).write_action(log.step(0)))
    }

    /// Extracts the action from a value that a model wrote; `None` if the value has nothing to do with actions.
    ///
    /// Accepts an action inside a field `action`, a bare list of entries, and numbers beyond their bounds, which the
    /// environment clamps. Unknown fields are dropped.
    ///
    /// # Errors
    /// Returns the reason why the action is invalid, as half a sentence that the model can act on.
    #[must_use]
    pub fn extract(&self, mut value: Value) -> Option<Result<Value, String>> {
        let list = self.list_field();
        if value.get(list).is_none()
            && let Some(inner) = value.get_mut("action").filter(|inner| inner.is_object())
        {
            value = inner.take();
        }
        let entries = match &mut value {
            Value::Array(items) if items.iter().all(Value::is_object) => value,
            Value::Object(fields) => fields.remove(list)?,
            _ => return None,
        };
        Some(self.normalize(entries))
    }

    /// Returns the name of the field that holds the entries of an action.
    pub(super) fn list_field(&self) -> &str {
        self.schema["required"][0].as_str().unwrap_or_default()
    }

    /// Validates the entries of an action and returns the action in its canonical form.
    fn normalize(&self, entries: Value) -> Result<Value, String> {
        // The environment ignores entries of unknown agents; an error helps the model more.
        let unknown_agent = self.find_unknown_agent(&entries);
        let action: Value = [(self.list_field().to_owned(), entries)].into_iter().collect();
        let log = self.to_log(&action)?;
        unknown_agent.map_or_else(|| Ok(self.encode(log.step(0))), Err)
    }

    /// Returns an error message for the first entry whose agent does not exist.
    fn find_unknown_agent(&self, entries: &Value) -> Option<String> {
        let list = self.list_field();
        let items = &self.schema["properties"][list]["items"];
        let field = items["required"][0].as_str()?;
        let last = items["properties"][field]["maximum"].as_i64()?;
        entries.as_array()?.iter().enumerate().find_map(|(index, entry)| {
            let agent = parse_integer(entry.get(field)?).ok().filter(|agent| !(0..=last).contains(agent))?;
            Some(format!("{list}.{index}.{field}: must be from 0 to {last}, got {agent}"))
        })
    }

    /// Reads an action into a log of one step.
    fn to_log(&self, action: &Value) -> Result<ActionLog, String> {
        let mut log = ActionLog::new(self.task.action_space().dim(), Precision::F64);
        match wire_format(self.task).read_action(action, &mut log) {
            Ok(()) => Ok(log),
            Err(errors) => Err(errors.first().map_or_else(|| "it is none".to_owned(), ToString::to_string)),
        }
    }
}
