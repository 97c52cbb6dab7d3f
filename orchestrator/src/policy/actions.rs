//! What an action looks like on the wire: how doing nothing is said, how a built-in policy's action is, and what is meant by
//! what a model says. What is an action is the world's own to judge ([`env_core::wire::Wire`]).

use std::sync::Arc;

use env_core::log::{ActionLog, Precision};
use env_core::wire::integer;
use env_core::{JointAction, TaskSpec};
use serde_json::Value;

/// Actions of a task.
#[derive(Clone)]
pub struct Actions {
    task: &'static dyn TaskSpec,
    schema: Arc<Value>,
}

impl std::fmt::Debug for Actions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Actions").field(&self.task.id()).finish()
    }
}

impl Actions {
    /// The actions of a task.
    #[must_use]
    pub fn new(task: &'static dyn TaskSpec) -> Self {
        Self { task, schema: Arc::new(task.wire().strict_schema().clone()) }
    }

    /// The task.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.task
    }

    /// The JSON schema that answers are held to.
    #[must_use]
    pub const fn schema(&self) -> &Arc<Value> {
        &self.schema
    }

    /// Doing nothing.
    #[must_use]
    pub fn hold(&self) -> Value {
        self.value(JointAction::HOLD)
    }

    /// A step as an action.
    #[must_use]
    pub fn value(&self, step: JointAction<'_>) -> Value {
        // What the world writes is JSON.
        serde_json::from_str(&self.task.wire().write_action(step)).unwrap_or(Value::Null)
    }

    /// An action as text, its fields in the order in which who is held to the schema writes them.
    #[must_use]
    pub fn text(&self, action: &Value) -> String {
        let log = self.log(action);
        log.map_or_else(|_| action.to_string(), |log| self.task.wire().write_action(log.step(0)))
    }

    /// The action that is meant, where an object has to do with actions at all: an action within `action`, a bare list of
    /// entries, numbers beyond their bounds (environments clamp them); what nobody knows is left out.
    ///
    /// # Errors
    /// What is wrong with it, in half a sentence that the model can act on.
    #[must_use]
    pub fn meant(&self, mut value: Value) -> Option<Result<Value, String>> {
        let list = self.list();
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
        Some(self.read(entries))
    }

    /// The field that actions consist of.
    pub(super) fn list(&self) -> &str {
        self.schema["required"][0].as_str().unwrap_or_default()
    }

    fn read(&self, entries: Value) -> Result<Value, String> {
        let list = self.list();
        // The environment drops what nobody can do; a model had better know.
        let stranger = self.stranger(&entries);
        let action: Value = [(list.to_owned(), entries)].into_iter().collect();
        let log = self.log(&action)?;
        stranger.map_or_else(|| Ok(self.value(log.step(0))), Err)
    }

    /// An entry of somebody who is not there, in words.
    fn stranger(&self, entries: &Value) -> Option<String> {
        let list = self.list();
        let items = &self.schema["properties"][list]["items"];
        let agent = items["required"][0].as_str()?;
        let last = items["properties"][agent]["maximum"].as_i64()?;
        entries.as_array()?.iter().enumerate().find_map(|(at, entry)| {
            let who = integer(entry.get(agent)?).ok().filter(|who| !(0..=last).contains(who))?;
            Some(format!("{list}.{at}.{agent}: {who} is outside 0 to {last}"))
        })
    }

    /// An action as the one step of a log.
    fn log(&self, action: &Value) -> Result<ActionLog, String> {
        let mut log = ActionLog::new(self.task.action_space().columns.len(), Precision::F64);
        match self.task.wire().read_action(action, &mut log) {
            Ok(()) => Ok(log),
            Err(faults) => Err(faults.first().map_or_else(|| "it is none".to_owned(), ToString::to_string)),
        }
    }
}
