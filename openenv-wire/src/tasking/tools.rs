//! The tools of tasking: one for each kind of action, and one for the actions of several satellites.

use env_core::tasking::task::{IMAGE_ACTIONS, MAX_SATELLITES};
use serde_json::{Map, Value, json};

use super::schema::{ACTIONS, NAME, SATELLITE_ID};
use crate::action_tool::{ActionTool, integer_arguments, read_integer, whole_action};

const ACT: &str = "act";
const IMAGE: &str = "image";
const INDEX: &str = "index";
const SATELLITE_ARGUMENT: (&str, &str, [u64; 2], Option<u64>) =
    (SATELLITE_ID, "ID of the satellite", [0, MAX_SATELLITES as u64 - 1], Some(0));

/// The tools of `tasking/scanning`.
pub(super) fn scanning_tools(_: &Value) -> Vec<ActionTool> {
    let scan = own_action("scan", "Point the instrument at nadir, and store data while it does");
    std::iter::once(scan).chain(common_tools()).collect()
}

/// The tools of the tasks with targets.
pub(super) fn imaging_tools(action_schema: &Value) -> Vec<ActionTool> {
    let index = "Index of the target in the satellite's list `targets`";
    let image = ActionTool {
        name: IMAGE,
        description: format!("Point the instrument at a target and image it within its window. {RETURNS}"),
        schema: integer_arguments(&[(INDEX, index, [0, IMAGE_ACTIONS as u64 - 1], None), SATELLITE_ARGUMENT]),
    };
    let all = whole_action(ACT, action_schema);
    let description = format!("Give new actions to several satellites. {RETURNS}");
    std::iter::once(image).chain(common_tools()).chain([ActionTool { description, ..all }]).collect()
}

const RETURNS: &str =
    "The step ends when the first satellite has finished. Returns the telemetry after the step.";

fn common_tools() -> [ActionTool; 3] {
    [
        own_action("charge", "Point the solar panel at the Sun to charge the battery"),
        own_action(
            "downlink",
            "Align with the orbit, and send stored data while a ground station can be reached",
        ),
        own_action("desaturate", "Slow the wheels down by pulses of the thrusters"),
    ]
}

/// A tool whose name is that of an action.
fn own_action(name: &'static str, about: &str) -> ActionTool {
    ActionTool {
        name,
        description: format!("{about}. {RETURNS}"),
        schema: integer_arguments(&[SATELLITE_ARGUMENT]),
    }
}

/// Converts the arguments of a call into an action.
pub(super) fn to_action(tool: &ActionTool, arguments: Map<String, Value>) -> Result<Value, String> {
    if tool.name == ACT {
        return Ok(Value::Object(arguments));
    }
    let known = tool.schema["properties"].as_object();
    if let Some(unknown) = arguments.keys().find(|name| !known.is_some_and(|known| known.contains_key(*name)))
    {
        let unknown: String = unknown.chars().take(60).collect();
        return Err(format!("{unknown}: the tool has no such argument"));
    }
    let name = if tool.name == IMAGE {
        json!(read_integer(&tool.schema, &arguments, INDEX)?)
    } else {
        json!(tool.name)
    };
    let satellite = read_integer(&tool.schema, &arguments, SATELLITE_ID)?;
    Ok(json!({ACTIONS: [{SATELLITE_ID: satellite, NAME: name}]}))
}
