//! The Model Context Protocol of openenv-core 0.3.0: JSON-RPC over HTTP and WebSocket, with tools that act in an episode.
//!
//! A client can act and observe through tools, but cannot begin an episode by a tool or see the planner's knowledge.
//! `routes` has the transports, `rpc` the messages, `tools` the tools. Start reading at [`respond`].

pub(super) mod routes;
pub(in crate::http) mod rpc;
mod tools;

use serde_json::{Map, Value, json};

pub(super) use self::routes::connect;
use self::rpc::{RpcError, RpcRequest};
use super::error_message::session_error_message;
use super::fields::{FieldReader, read_session_request};
use super::tasks::{RESET_ORDER, built_in_task};
use crate::http::state::AppState;
use crate::sessions::{ClientIdentity, Session, SessionKey, SharedSession};

/// Origin of a request.
pub(super) enum RpcOrigin<'a> {
    /// Connection that has a session.
    Connection(&'a mut Session),
    /// Single HTTP request of a client.
    Single(&'a ClientIdentity),
}

/// Client of a request, with the server's state.
#[derive(Clone, Copy)]
struct RpcContext<'a> {
    app: &'a AppState,
    client: &'a ClientIdentity,
}

/// Returns the response to one request.
pub(super) async fn respond(app: &AppState, request: &Value, origin: RpcOrigin<'_>) -> Value {
    let request = match RpcRequest::parse(request) {
        Ok(request) => request,
        Err(error) => return rpc::error_response(&Value::Null, &error),
    };
    match dispatch(app, &request, origin).await {
        Ok(result) => rpc::result_response(&request.id, &result),
        Err(error) => rpc::error_response(&request.id, &error),
    }
}

/// Calls the method of a request.
async fn dispatch(app: &AppState, request: &RpcRequest, origin: RpcOrigin<'_>) -> Result<Value, RpcError> {
    if request.method == "openenv/session/create" {
        return create_session(app, &request.params, origin).await;
    }
    let (client, own) = match origin {
        RpcOrigin::Connection(session) => (session.client().clone(), Some(session)),
        RpcOrigin::Single(client) => (client.clone(), None),
    };
    let context = RpcContext { app, client: &client };
    match request.method.as_str() {
        "initialize" => Ok(server_info()),
        "notifications/initialized" | "ping" => Ok(json!({})),
        "openenv/session/close" => close_session(context, &request.params, own),
        "tools/list" => list_tools(context, &request.params, own).await,
        "tools/call" => call_tool(context, &request.params, own).await,
        other => Err(RpcError::no_method(other)),
    }
}

/// Returns the result of `initialize`, a client's first request.
fn server_info() -> Value {
    json!({
        "protocolVersion": "2025-06-18",
        "capabilities": {"tools": {}},
        "serverInfo": {"name": "sparring", "version": env!("CARGO_PKG_VERSION")},
    })
}

/// Opens a session with an episode; `params` may have the fields of a reset.
///
/// A connection that has a session receives its id. An episode begins in it unless one is running; `params` must then be
/// empty.
async fn create_session(
    app: &AppState,
    params: &Map<String, Value>,
    origin: RpcOrigin<'_>,
) -> Result<Value, RpcError> {
    let client = match origin {
        RpcOrigin::Single(client) => client,
        RpcOrigin::Connection(own) => {
            let is_running = own.view().is_ok_and(|view| !view.done);
            if is_running && !params.is_empty() {
                return Err(RpcError::params("the session has an unfinished episode; finish it first"));
            }
            if !is_running {
                begin_episode(own, params).await?;
            }
            return Ok(json!({"session_id": own.id()}));
        }
    };
    let id = uuid::Uuid::new_v4().to_string();
    let key = SessionKey::new(client, id.as_str());
    let session = app.sessions.get_or_open(client, &key).map_err(RpcError::capacity)?;
    let begun = begin_episode(&mut *session.lock().await, params).await;
    if let Err(error) = begun {
        app.sessions.close(&key);
        return Err(error);
    }
    Ok(json!({"session_id": id}))
}

/// Begins an episode in a session.
async fn begin_episode(session: &mut Session, params: &Map<String, Value>) -> Result<(), RpcError> {
    let mut fields = FieldReader::new(params, Vec::new());
    let request = read_session_request(&mut fields);
    if let Some(error) = fields.errors.first() {
        return Err(RpcError::params(&error.to_string()));
    }
    let name = request.episode_id.clone();
    let resolved = request
        .resolve(built_in_task(RESET_ORDER[0]))
        .map_err(|error| RpcError::params(&error.to_string()))?;
    session
        .reset(resolved, name)
        .await
        .map(|_| ())
        .map_err(|error| RpcError::internal(&session_error_message(&error)))
}

fn close_session(
    RpcContext { app, client }: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, RpcError> {
    let name = params.get("session_id").and_then(Value::as_str);
    let name = name.ok_or_else(|| RpcError::params("'session_id' is required"))?;
    if own.is_some_and(|own| own.id() == name) {
        return Err(RpcError::params(
            "this session belongs to the connection and ends with it; close the connection",
        ));
    }
    if app.sessions.close(&SessionKey::new(client, name)) {
        Ok(json!({"session_id": name, "closed": true}))
    } else {
        Err(RpcError::no_session(name))
    }
}

async fn list_tools(
    context: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, RpcError> {
    let tools = match (named_session(context, params, own.as_deref())?, own) {
        (None, Some(own)) => tools::session_tools(own),
        (Some(session), _) => tools::session_tools(&*session.lock().await),
        (None, None) => tools::task_tools(built_in_task(RESET_ORDER[0])),
    };
    Ok(json!({"tools": tools}))
}

async fn call_tool(
    context: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, RpcError> {
    let name = params.get("name").and_then(Value::as_str);
    let name = name.ok_or_else(|| RpcError::params("'name' is required"))?;
    let arguments = match params.get("arguments") {
        None | Some(Value::Null) => Map::new(),
        Some(Value::Object(arguments)) => arguments.clone(),
        Some(_) => return Err(RpcError::params("'arguments' must be an object")),
    };
    match (named_session(context, params, own.as_deref())?, own) {
        (None, Some(own)) => call_in_session(own, name, arguments).await,
        (Some(session), _) => call_in_session(&mut *session.lock().await, name, arguments).await,
        // Without a session, every call would have its own world.
        (None, None) => Err(RpcError::params("'session_id' is required; openenv/session/create returns one")),
    }
}

/// Calls a tool in a session, and begins an episode if it never had one.
async fn call_in_session(
    session: &mut Session,
    name: &str,
    arguments: Map<String, Value>,
) -> Result<Value, RpcError> {
    if session.status().scenario.is_none() {
        begin_episode(session, &Map::new()).await?;
    }
    tools::call(session, name, arguments).await.map(|result| tools::result(&result))
}

/// Returns the session that the request names; `None` if it names none, or the connection's own.
fn named_session(
    RpcContext { app, client }: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&Session>,
) -> Result<Option<SharedSession>, RpcError> {
    match params.get("session_id") {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(name)) if own.is_some_and(|own| own.id() == name) => Ok(None),
        Some(Value::String(name)) => {
            let known = app.sessions.get(&SessionKey::new(client, name.as_str()));
            known.map(Some).ok_or_else(|| RpcError::no_session(name))
        }
        Some(other) => Err(RpcError::no_session(&other.to_string())),
    }
}

/// Calls a tool by a step, as openenv-core's `MCPToolClient` does over `/ws`. Returns `None` if the step is an action.
pub(super) async fn call_by_step(session: &mut Session, action: &Map<String, Value>) -> Option<Value> {
    let observation = match action.get("type").and_then(Value::as_str)? {
        "list_tools" => json!({"tools": tools::session_tools(session)}),
        "call_tool" => {
            let name = action.get("tool_name").and_then(Value::as_str).unwrap_or_default();
            let arguments = action.get("arguments").and_then(Value::as_object).cloned().unwrap_or_default();
            match tools::call(session, name, arguments).await {
                Ok(result) => json!({"tool_name": name, "result": tools::result(&result), "error": null}),
                Err(error) => json!({"tool_name": name, "result": null, "error": error.as_tool_error()}),
            }
        }
        _ => return None,
    };
    let view = session.view().ok();
    let (reward, done) = view.map_or((0.0, false), |view| (view.reward, view.done));
    Some(json!({"type": "observation", "data": {"observation": observation, "reward": reward, "done": done}}))
}
