//! Tools by which an agent of the Model Context Protocol acts.

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde_json::{Map, Value, json};

/// A tool that executes an action for one step.
#[derive(Debug)]
pub struct ActionTool {
    /// Name of the tool.
    pub name: &'static str,
    /// Description for a language model.
    pub description: String,
    /// JSON Schema of the arguments.
    pub schema: Value,
}

/// The tools of a world: their descriptions, and how a call becomes an action.
#[derive(Debug)]
pub(crate) struct ToolFormat {
    /// Builds the tools from the schema of an action.
    pub(crate) tools: fn(action_schema: &Value) -> Vec<ActionTool>,
    /// Converts the arguments of a call into an action.
    pub(crate) to_action: fn(tool: &ActionTool, arguments: Map<String, Value>) -> Result<Value, String>,
}

/// One tool whose arguments are the action itself.
pub(crate) const FIRE_THRUSTERS: ToolFormat = ToolFormat {
    tools: |schema| vec![whole_action("fire_thrusters", schema)],
    to_action: |_, arguments| Ok(Value::Object(arguments)),
};

/// A tool whose arguments are a whole action.
pub(crate) fn whole_action(name: &'static str, action_schema: &Value) -> ActionTool {
    let mut schema = action_schema.clone();
    if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
        properties.remove("metadata");
    }
    let description = "Execute an action for one step. Returns the telemetry after the step.".to_owned();
    ActionTool { name, description, schema }
}

/// JSON Schema of arguments: optional integers within bounds, each with its description, its range and its default.
pub(crate) fn integer_arguments(arguments: &[(&str, &str, [u64; 2], Option<u64>)]) -> Value {
    let required: Vec<_> =
        arguments.iter().filter(|argument| argument.3.is_none()).map(|argument| argument.0).collect();
    let properties: Map<_, _> = arguments
        .iter()
        .map(|(name, description, [low, high], default)| {
            let mut schema =
                json!({"type": "integer", "minimum": low, "maximum": high, "description": description});
            if let Some(default) = default {
                schema["default"] = json!(default);
            }
            ((*name).to_owned(), schema)
        })
        .collect();
    json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
}

/// Reads an argument that `schema` describes by [`integer_arguments`].
pub(crate) fn read_integer(
    schema: &Value,
    arguments: &Map<String, Value>,
    name: &str,
) -> Result<u64, String> {
    let spec = &schema["properties"][name];
    let bound = |key: &str| spec[key].as_u64().unwrap_or_default();
    let range = bound("minimum")..=bound("maximum");
    match (arguments.get(name), spec["default"].as_u64()) {
        (None | Some(Value::Null), Some(default)) => Ok(default),
        (None, None) => Err(format!("{name}: is required")),
        (Some(value), _) => value.as_u64().filter(|value| range.contains(value)).ok_or_else(|| {
            let value = shorten(&value.to_string(), MAX_QUOTED_CHARS);
            format!("{name}: must be an integer from {} to {}, got {value}", range.start(), range.end())
        }),
    }
}
