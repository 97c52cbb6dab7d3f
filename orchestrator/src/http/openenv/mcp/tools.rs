//! What an agent can do through MCP: act, wait, look, and see what comes. None of it begins an episode.

use env_core::TaskSpec;
use serde_json::{Map, Value, json};

use super::rpc::Failure;
use crate::sessions::{Session, SessionError};

/// Most steps that one call waits.
const MOST_STEPS: u64 = 1000;

/// The tools of a session.
pub(super) fn list(session: &Session) -> Value {
    let flown = session.status().scenario.map(env_core::Scenario::task);
    of(flown.unwrap_or_else(|| super::super::usual(super::WALK[0])))
}

/// The tools of a task.
pub(super) fn of(task: &'static dyn TaskSpec) -> Value {
    let mut action = openenv_wire::wire_format(task).action_schema().clone();
    if let Some(properties) = action.get_mut("properties").and_then(Value::as_object_mut) {
        properties.remove("metadata");
    }
    let nothing = json!({"type": "object", "properties": {}, "additionalProperties": false});
    let steps = json!({
        "type": "object",
        "properties": {
            "steps": {"type": "integer", "minimum": 1, "maximum": MOST_STEPS, "default": 1,
                      "description": "How many steps to wait; it stops early when the episode ends"}
        },
        "additionalProperties": false
    });
    let tool = |name: &str, about: &str, schema: &Value| json!({"name": name, "description": about, "inputSchema": schema, "input_schema": schema});
    let mut tools = vec![
        tool("fire_thrusters", "Act, and let one step pass. Answers with the telemetry after it.", &action),
        tool("hold", "Do nothing new for some steps. Answers with the telemetry after them.", &steps),
        tool("telemetry", "Look: what the sensors see now. No time passes.", &nothing),
    ];
    if task.world().starts_with("kessler") {
        let about = "Foresee: which debris will pass which satellite within 15 steps if nobody burns, when, how near, how \
                     fast, and with what probability of a collision. No time passes.";
        tools.push(tool("conjunctions", about, &nothing));
    }
    Value::Array(tools)
}

/// Calls a tool; what it tells.
pub(super) async fn call(
    session: &mut Session,
    name: &str,
    arguments: Map<String, Value>,
) -> Result<Value, Failure> {
    match name {
        "fire_thrusters" => act(session, &Value::Object(arguments)).await,
        "hold" => hold(session, &arguments).await,
        "telemetry" => looked(session, &arguments),
        "conjunctions" => {
            nothing(&arguments)?;
            let shown = session.view().map_err(|error| failed(&error))?;
            let foreseen = shown.episode.conjunctions();
            let foreseen = foreseen.ok_or_else(|| Failure::params("this world foresees none"))?;
            Ok(json!({"conjunctions": foreseen}))
        }
        other => {
            let other: String = other.chars().take(60).collect();
            Err(Failure::params(&format!("there is no tool {other:?}; tools/list tells them")))
        }
    }
}

/// A result as the protocol has it, and as openenv-core's client reads it (`data`).
pub(super) fn result(told: &Value) -> Value {
    json!({
        "content": [{"type": "text", "text": told.to_string()}],
        "structuredContent": told,
        "data": told,
        "isError": false,
    })
}

async fn act(session: &mut Session, action: &Value) -> Result<Value, Failure> {
    session.step(action).await.map_err(|error| failed(&error))?;
    told(session)
}

async fn hold(session: &mut Session, arguments: &Map<String, Value>) -> Result<Value, Failure> {
    let steps = match arguments.get("steps") {
        None | Some(Value::Null) => 1,
        Some(steps) => {
            let steps = steps.as_u64().filter(|steps| (1..=MOST_STEPS).contains(steps));
            steps.ok_or_else(|| {
                Failure::params(&format!("steps: a whole number from 1 to {MOST_STEPS} is wanted"))
            })?
        }
    };
    for _ in 0..steps {
        let shown = session.step(&json!({})).await.map_err(|error| failed(&error))?;
        if shown.done {
            break;
        }
    }
    told(session)
}

fn looked(session: &Session, arguments: &Map<String, Value>) -> Result<Value, Failure> {
    nothing(arguments)?;
    told(session)
}

fn told(session: &Session) -> Result<Value, Failure> {
    let shown = session.view().map_err(|error| failed(&error))?;
    let mut told = super::super::answer::value(&shown);
    told["step"] = json!(session.status().steps);
    Ok(told)
}

fn nothing(arguments: &Map<String, Value>) -> Result<(), Failure> {
    match arguments.keys().next() {
        None => Ok(()),
        Some(key) => {
            let key: String = key.chars().take(60).collect();
            Err(Failure::params(&format!("{key}: this tool takes no arguments")))
        }
    }
}

fn failed(error: &SessionError) -> Failure {
    match error {
        SessionError::Action(faults) => {
            let told = faults.iter().map(ToString::to_string).collect::<Vec<_>>();
            Failure::params(&told.join("; "))
        }
        other => Failure::internal(&super::super::refused_in_words(other)),
    }
}
