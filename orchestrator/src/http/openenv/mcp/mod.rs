//! The Model Context Protocol as openenv-core 0.3.0 speaks it, JSON-RPC over HTTP and WebSocket, with tools that fly.
//! Whoever plays through it can act and look, and neither begin an episode nor see what the planner knows.

pub(super) mod routes;
mod rpc;
mod tools;

use serde_json::{Map, Value, json};

pub(super) use self::routes::connect;
use self::rpc::{Failure, Request};
use super::read::WALK;
use crate::http::state::AppState;
use crate::sessions::{SessionKey, Session, ClientIdentity};

/// What a request came by.
pub(super) enum By<'a> {
    /// A connection that has a session.
    Own(&'a mut Session),
    /// A request for itself; whose.
    Itself(&'a ClientIdentity),
}

/// Answers one request.
pub(super) async fn answer(app: &AppState, request: &Value, by: By<'_>) -> Value {
    let request = match Request::read(request) {
        Ok(request) => request,
        Err(failure) => return rpc::failed(&Value::Null, &failure),
    };
    match called(app, &request, by).await {
        Ok(result) => rpc::succeeded(&request.id, &result),
        Err(failure) => rpc::failed(&request.id, &failure),
    }
}

async fn called(app: &AppState, request: &Request, by: By<'_>) -> Result<Value, Failure> {
    if request.method == "openenv/session/create" {
        return create(app, &request.params, by).await;
    }
    let (who, own) = match by {
        By::Own(session) => (session.client().clone(), Some(session)),
        By::Itself(who) => (who.clone(), None),
    };
    let at = (app, &who);
    match request.method.as_str() {
        "initialize" => Ok(initialized()),
        "notifications/initialized" | "ping" => Ok(json!({})),
        "openenv/session/close" => close(at, &request.params, own),
        "tools/list" => tools_list(at, &request.params, own).await,
        "tools/call" => tools_call(at, &request.params, own).await,
        other => Err(Failure::no_method(other)),
    }
}

/// What clients of the protocol ask first.
fn initialized() -> Value {
    json!({
        "protocolVersion": "2025-06-18",
        "capabilities": {"tools": {}},
        "serverInfo": {"name": "sparring", "version": env!("CARGO_PKG_VERSION")},
    })
}

/// Opens a session in which an episode flies: what `reset` takes may stand in `params`. A connection that has a session is told
/// its name, and an episode begins in it if none flies; while one does, there is nothing to be said about it.
async fn create(app: &AppState, params: &Map<String, Value>, by: By<'_>) -> Result<Value, Failure> {
    let who = match by {
        By::Itself(who) => who,
        By::Own(own) => {
            let flies = own.view().is_ok_and(|shown| !shown.done);
            if flies && !params.is_empty() {
                return Err(Failure::params(
                    "an episode flies in this session; it is flown to its end first",
                ));
            }
            if !flies {
                begin(own, params).await?;
            }
            return Ok(json!({"session_id": own.id()}));
        }
    };
    let id = uuid::Uuid::new_v4().to_string();
    let name = SessionKey::new(who, id.as_str());
    let session = app.sessions.get_or_open(who, &name).map_err(Failure::capacity)?;
    let began = begin(&mut *session.lock().await, params).await;
    if let Err(failure) = began {
        app.sessions.close(&name);
        return Err(failure);
    }
    Ok(json!({"session_id": id}))
}

/// Lets an episode begin.
async fn begin(session: &mut Session, params: &Map<String, Value>) -> Result<(), Failure> {
    let mut fields = super::read::Fields::new(params, Vec::new());
    let wish = super::read::wish(&mut fields);
    if let Some(fault) = fields.faults.first() {
        return Err(Failure::params(&fault.to_string()));
    }
    let name = wish.episode_id.clone();
    let wished = wish.resolve(super::usual(WALK[0])).map_err(|error| Failure::params(&error.to_string()))?;
    session
        .reset(wished, name)
        .await
        .map(|_| ())
        .map_err(|error| Failure::internal(&super::refused_in_words(&error)))
}

fn close(
    (app, who): (&AppState, &ClientIdentity),
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, Failure> {
    let name = params.get("session_id").and_then(Value::as_str);
    let name = name.ok_or_else(|| Failure::params("'session_id' is required"))?;
    if own.is_some_and(|own| own.id() == name) {
        return Err(Failure::params("this session is the connection's own, and ends with it"));
    }
    if app.sessions.close(&SessionKey::new(who, name)) {
        Ok(json!({"session_id": name, "closed": true}))
    } else {
        Err(Failure::no_session(name))
    }
}

async fn tools_list(
    at: (&AppState, &ClientIdentity),
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, Failure> {
    let tools = match (named(at, params, own.as_deref())?, own) {
        (None, Some(own)) => tools::list(own),
        (Some(session), _) => tools::list(&*session.lock().await),
        (None, None) => tools::of(super::usual(WALK[0])),
    };
    Ok(json!({"tools": tools}))
}

async fn tools_call(
    at: (&AppState, &ClientIdentity),
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, Failure> {
    let name = params.get("name").and_then(Value::as_str);
    let name = name.ok_or_else(|| Failure::params("'name' is required"))?;
    let arguments = match params.get("arguments") {
        None | Some(Value::Null) => Map::new(),
        Some(Value::Object(arguments)) => arguments.clone(),
        Some(_) => return Err(Failure::params("'arguments' must be an object")),
    };
    match (named(at, params, own.as_deref())?, own) {
        (None, Some(own)) => played(own, name, arguments).await,
        (Some(session), _) => played(&mut *session.lock().await, name, arguments).await,
        // Without a session every call would be a world of its own.
        (None, None) => Err(Failure::params("'session_id' is required: openenv/session/create gives one")),
    }
}

async fn played(session: &mut Session, name: &str, arguments: Map<String, Value>) -> Result<Value, Failure> {
    if session.status().scenario.is_none() {
        begin(session, &Map::new()).await?;
    }
    tools::call(session, name, arguments).await.map(|told| tools::result(&told))
}

/// The session of theirs that is named; none where none is, or the connection's own.
fn named(
    (app, who): (&AppState, &ClientIdentity),
    params: &Map<String, Value>,
    own: Option<&Session>,
) -> Result<Option<std::sync::Arc<tokio::sync::Mutex<Session>>>, Failure> {
    match params.get("session_id") {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(name)) if own.is_some_and(|own| own.id() == name) => Ok(None),
        Some(Value::String(name)) => {
            let known = app.sessions.get(&SessionKey::new(who, name.as_str()));
            known.map(Some).ok_or_else(|| Failure::no_session(name))
        }
        Some(other) => Err(Failure::no_session(&other.to_string())),
    }
}

/// A tool asked for by way of a step, as openenv-core's `MCPToolClient` does over `/ws`; none if it is an action.
pub(super) async fn as_step(session: &mut Session, action: &Map<String, Value>) -> Option<Value> {
    let observation = match action.get("type").and_then(Value::as_str)? {
        "list_tools" => json!({"tools": tools::list(session)}),
        "call_tool" => {
            let name = action.get("tool_name").and_then(Value::as_str).unwrap_or_default();
            let arguments = action.get("arguments").and_then(Value::as_object).cloned().unwrap_or_default();
            match tools::call(session, name, arguments).await {
                Ok(told) => json!({"tool_name": name, "result": tools::result(&told), "error": null}),
                Err(failure) => json!({"tool_name": name, "result": null, "error": failure.as_tool_error()}),
            }
        }
        _ => return None,
    };
    let shown = session.view().ok();
    let (reward, done) = shown.map_or((0.0, false), |shown| (shown.reward, shown.done));
    Some(json!({"type": "observation", "data": {"observation": observation, "reward": reward, "done": done}}))
}
