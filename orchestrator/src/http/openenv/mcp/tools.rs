//! Tools of the Model Context Protocol: act, wait, observe, and predict conjunctions. No tool begins an episode.

use env_core::TaskSpec;
use env_core::log::{ActionLog, Precision};
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde_json::{Map, Value, json};

use super::super::error_message::session_error_message;
use super::super::step_response;
use super::super::tasks::{RESET_ORDER, built_in_task};
use super::rpc::RpcError;
use crate::sessions::{Session, SessionError};

const HOLD: &str = "hold";
const TELEMETRY: &str = "telemetry";
const CONJUNCTIONS: &str = "conjunctions";
/// Maximum number of steps that one call of `hold` waits.
const MAX_HOLD_STEPS: u64 = 1000;

/// Returns the tools of a session.
pub(super) fn session_tools(session: &Session) -> Value {
    task_tools(session_task(session))
}

/// Returns the task of a session's episode, or of the episode that a call would begin.
fn session_task(session: &Session) -> &'static dyn TaskSpec {
    let task = session.status().scenario.map(env_core::Scenario::task);
    task.unwrap_or_else(|| built_in_task(RESET_ORDER[0]))
}

/// Returns true if a task has a tool of that name.
pub(super) fn is_tool(name: &str) -> bool {
    let has_tool = |task| openenv_wire::wire_format(task).tools().iter().any(|tool| tool.name == name);
    [HOLD, TELEMETRY, CONJUNCTIONS].contains(&name) || env_core::tasks().any(has_tool)
}

/// Returns the tools of a task.
pub(super) fn task_tools(task: &'static dyn TaskSpec) -> Value {
    let nothing = json!({"type": "object", "properties": {}, "additionalProperties": false});
    let steps = json!({
        "type": "object",
        "properties": {
            "steps": {"type": "integer", "minimum": 1, "maximum": MAX_HOLD_STEPS, "default": 1,
                      "description": "Number of steps to hold; fewer if the episode ends before"}
        },
        "additionalProperties": false
    });
    let tool = |name: &str, about: &str, schema: &Value| json!({"name": name, "description": about, "inputSchema": schema, "input_schema": schema});
    let actions = openenv_wire::wire_format(task).tools();
    let mut tools: Vec<_> =
        actions.iter().map(|action| tool(action.name, &action.description, &action.schema)).collect();
    tools.push(tool(
        HOLD,
        "Hold for some steps, without new actions. Returns the telemetry after the last step.",
        &steps,
    ));
    tools.push(tool(TELEMETRY, "Return the current telemetry. No time passes.", &nothing));
    if task.world().starts_with("kessler") {
        let about = "Predict the close passes of debris within 15 steps if no satellite burns: satellite, debris, time, \
                     miss distance, relative speed and probability of a collision. No time passes.";
        tools.push(tool(CONJUNCTIONS, about, &nothing));
    }
    Value::Array(tools)
}

/// Calls a tool and returns its result.
pub(super) async fn call(
    session: &mut Session,
    name: &str,
    arguments: Map<String, Value>,
) -> Result<Value, RpcError> {
    match name {
        HOLD => hold(session, &arguments).await,
        TELEMETRY => observe(session, &arguments),
        CONJUNCTIONS => {
            check_no_arguments(&arguments)?;
            let shown = session.view().map_err(|error| rpc_error(&error))?;
            let conjunctions = shown.episode.conjunctions();
            let conjunctions =
                conjunctions.ok_or_else(|| RpcError::params("the world predicts no conjunctions"))?;
            Ok(json!({"conjunctions": conjunctions}))
        }
        name => act(session, name, arguments).await,
    }
}

/// Returns a result in the protocol's format, with `data` for openenv-core's client.
pub(super) fn result(value: &Value) -> Value {
    json!({
        "content": [{"type": "text", "text": value.to_string()}],
        "structuredContent": value,
        "data": value,
        "isError": false,
    })
}

/// Returns the error of a call as a result.
pub(super) fn error_result(error: &RpcError) -> Value {
    json!({"content": [{"type": "text", "text": error.message()}], "isError": true})
}

/// Calls a tool that executes an action.
async fn act(session: &mut Session, name: &str, arguments: Map<String, Value>) -> Result<Value, RpcError> {
    let format = openenv_wire::wire_format(session_task(session));
    let Some(tool) = format.tools().iter().find(|tool| tool.name == name) else {
        let name: String = name.chars().take(60).collect();
        return Err(RpcError::params(&format!("tool {name:?} does not exist; tools/list returns all tools")));
    };
    let action = format.tool_action(tool, arguments).map_err(|reason| RpcError::params(&reason))?;
    check_agents(session, &action)?;
    session.step(&action).await.map_err(|error| rpc_error(&error))?;
    telemetry(session)
}

/// Checks that the agents of an action exist. A step leaves out agents that do not, as OpenEnv does; a model learns more from an error.
fn check_agents(session: &Session, action: &Value) -> Result<(), RpcError> {
    let Some(scenario) = session.status().scenario else { return Ok(()) };
    let task = scenario.task();
    let mut log = ActionLog::new(task.action_space().dim(), Precision::F64);
    if openenv_wire::wire_format(task).read_action(action, &mut log).is_err() {
        return Ok(()); // the step reports the errors
    }
    let count = task.agents(scenario.recipe());
    match log.step(0).agents.iter().find(|agent| **agent >= count) {
        None => Ok(()),
        Some(agent) => {
            let last = count.saturating_sub(1);
            Err(RpcError::params(&format!(
                "agent {agent} does not exist: the episode has the agents 0 to {last}"
            )))
        }
    }
}

async fn hold(session: &mut Session, arguments: &Map<String, Value>) -> Result<Value, RpcError> {
    let steps = match arguments.get("steps") {
        None | Some(Value::Null) => 1,
        Some(steps) => {
            let number = steps.as_u64().filter(|steps| (1..=MAX_HOLD_STEPS).contains(steps));
            number.ok_or_else(|| {
                let steps = shorten(&steps.to_string(), MAX_QUOTED_CHARS);
                RpcError::params(&format!(
                    "steps: must be an integer from 1 to {MAX_HOLD_STEPS}, got {steps}"
                ))
            })?
        }
    };
    for _ in 0..steps {
        let shown = session.step(&json!({})).await.map_err(|error| rpc_error(&error))?;
        if shown.done {
            break;
        }
    }
    telemetry(session)
}

fn observe(session: &Session, arguments: &Map<String, Value>) -> Result<Value, RpcError> {
    check_no_arguments(arguments)?;
    telemetry(session)
}

/// Returns the last step with its number.
fn telemetry(session: &Session) -> Result<Value, RpcError> {
    let shown = session.view().map_err(|error| rpc_error(&error))?;
    let mut telemetry = step_response::step_value(&shown);
    telemetry["step"] = json!(session.status().steps);
    Ok(telemetry)
}

/// Checks that a tool without parameters has no arguments.
fn check_no_arguments(arguments: &Map<String, Value>) -> Result<(), RpcError> {
    match arguments.keys().next() {
        None => Ok(()),
        Some(key) => {
            let key: String = key.chars().take(60).collect();
            Err(RpcError::params(&format!("{key}: the tool has no arguments; leave it out")))
        }
    }
}

fn rpc_error(error: &SessionError) -> RpcError {
    match error {
        SessionError::Action(errors) => {
            let messages = errors.iter().map(ToString::to_string).collect::<Vec<_>>();
            RpcError::params(&messages.join("; "))
        }
        other => RpcError::internal(&session_error_message(other)),
    }
}
