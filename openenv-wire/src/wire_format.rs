//! The interface of a task's OpenEnv protocol, and `WorldFormat`, its implementation for all worlds.

use std::sync::{LazyLock, OnceLock};

use env_core::{ActionLog, JointAction};
use serde_json::{Map, Value};

use crate::action_format::ActionFormat;
use crate::action_tool::{ActionTool, ToolFormat};
use crate::validation_error::ValidationError;

/// OpenEnv representation of a task: how actions are read and written, and the JSON Schemas of actions and observations.
pub trait WireFormat: Send + Sync {
    /// JSON Schema of an action.
    fn action_schema(&'static self) -> &'static Value;

    /// JSON Schema of an observation (with `done`, `reward` and `metadata`, as in openenv-core).
    fn observation_schema(&'static self) -> &'static Value;

    /// Reads an action (the object in a `step` message) as one step of `log`, and closes the step. Entries of agents that
    /// no episode of the task has are dropped. [`ActionLog::keep_agents`] drops those that only this episode lacks.
    ///
    /// # Errors
    /// Returns at most [`MAX_ERRORS`](crate::MAX_ERRORS) errors if the action is invalid, each located relative to the
    /// action; `log` is then unchanged.
    fn read_action(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<ValidationError>>;

    /// JSON Schema that constrains a writer of actions, such as a language model. It accepts a subset of
    /// [`action_schema`](Self::action_schema), without the inputs that readers tolerate but no writer intends.
    fn strict_schema(&'static self) -> &'static Value;

    /// Writes a step as a JSON action: values in the order of the action space, clamped as the environment clamps them.
    fn write_action(&self, step: JointAction<'_>) -> String;

    /// Tools of the Model Context Protocol that execute an action.
    fn tools(&'static self) -> &'static [ActionTool];

    /// Converts a call of a tool into an action, which [`read_action`](Self::read_action) checks.
    ///
    /// # Errors
    /// Returns the argument and what is wrong with it, if it cannot become part of an action.
    fn tool_action(&self, tool: &ActionTool, arguments: Map<String, Value>) -> Result<Value, String>;
}

/// The format of a world's tasks, whose actions have `DIM` values each.
pub(crate) struct WorldFormat<const DIM: usize> {
    actions: ActionFormat<DIM>,
    action_schema: LazyLock<Value>,
    observation_schema: LazyLock<Value>,
    strict_schema: OnceLock<Value>,
    tool_format: ToolFormat,
    tools: OnceLock<Vec<ActionTool>>,
}

impl<const DIM: usize> WorldFormat<DIM> {
    pub(crate) const fn new(
        actions: ActionFormat<DIM>,
        action_schema: fn() -> Value,
        observation_schema: fn() -> Value,
        tool_format: ToolFormat,
    ) -> Self {
        Self {
            actions,
            action_schema: LazyLock::new(action_schema),
            observation_schema: LazyLock::new(observation_schema),
            strict_schema: OnceLock::new(),
            tool_format,
            tools: OnceLock::new(),
        }
    }
}

impl<const DIM: usize> WireFormat for WorldFormat<DIM> {
    fn action_schema(&'static self) -> &'static Value {
        &self.action_schema
    }

    fn observation_schema(&'static self) -> &'static Value {
        &self.observation_schema
    }

    fn read_action(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<ValidationError>> {
        self.actions.read(action, log)
    }

    fn strict_schema(&'static self) -> &'static Value {
        self.strict_schema.get_or_init(|| self.actions.strict_schema(&self.action_schema))
    }

    fn write_action(&self, step: JointAction<'_>) -> String {
        self.actions.write(step)
    }

    fn tools(&'static self) -> &'static [ActionTool] {
        self.tools.get_or_init(|| (self.tool_format.tools)(&self.action_schema))
    }

    fn tool_action(&self, tool: &ActionTool, arguments: Map<String, Value>) -> Result<Value, String> {
        (self.tool_format.to_action)(tool, arguments)
    }
}
