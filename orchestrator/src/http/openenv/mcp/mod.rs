//! The Model Context Protocol: JSON-RPC over HTTP and WebSocket, with tools that act in an episode.
//!
//! Requests over HTTP are those of the protocol's transport *Streamable HTTP* and those of OpenEnv, which name their session in
//! the params. A client can act and observe through tools, but cannot begin an episode by a tool or see the planner's knowledge.
//! `routes` and `streamable` have the transports, `rpc` the messages, `tools` the tools. Start reading at [`respond`].

pub(super) mod routes;
pub(in crate::http) mod rpc;
mod streamable;
mod tools;

use serde_json::{Map, Value, json};

pub(super) use self::routes::connect;
use self::rpc::{RpcError, RpcRequest};
use super::error_message::session_error_message;
use super::fields::{FieldReader, read_session_request};
use super::tasks::{RESET_ORDER, built_in_task};
use crate::http::state::AppState;
use crate::sessions::{ClientIdentity, CloseOutcome, Session, SessionKey, SharedSession};

/// Versions of the protocol that the server speaks, newest first.
const PROTOCOL_VERSIONS: [&str; 4] = ["2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05"];

/// Origin of a request.
pub(super) enum RpcOrigin<'a> {
    /// Connection that has a session.
    Connection(&'a mut Session),
    /// Single HTTP request of a client.
    Single {
        /// Client of the request.
        client: &'a ClientIdentity,
        /// Name of the session in a header of the request.
        session: Option<&'a str>,
    },
}

/// Client of a request, with the server's state.
#[derive(Clone, Copy)]
struct RpcContext<'a> {
    app: &'a AppState,
    client: &'a ClientIdentity,
    /// Session of a request that names none in its params.
    default_session: Option<&'a str>,
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
    let (client, default_session, own) = match origin {
        RpcOrigin::Connection(session) => (session.client().clone(), None, Some(session)),
        RpcOrigin::Single { client, session } => (client.clone(), session, None),
    };
    let context = RpcContext { app, client: &client, default_session };
    match request.method.as_str() {
        "initialize" => Ok(server_info(&request.params)),
        "notifications/initialized" | "ping" => Ok(json!({})),
        "openenv/session/close" => close_session(context, &request.params, own),
        "tools/list" => list_tools(context, &request.params, own).await,
        "tools/call" => call_tool(context, &request.params, own).await,
        other => Err(RpcError::no_method(other)),
    }
}

/// Returns the result of `initialize`, a client's first request: the client's version of the protocol if the server knows it,
/// else the newest.
fn server_info(params: &Map<String, Value>) -> Value {
    let requested = params.get("protocolVersion").and_then(Value::as_str);
    let known = requested.filter(|version| PROTOCOL_VERSIONS.contains(version));
    json!({
        "protocolVersion": known.unwrap_or(PROTOCOL_VERSIONS[0]),
        "capabilities": {"tools": {}},
        "serverInfo": {"name": "sparring", "title": "Sparring", "version": env!("CARGO_PKG_VERSION")},
        "instructions": "You operate satellites in a simulation. Read the mission and the state with `telemetry`, act with the \
                         tools that tools/list describes, and let time pass with `hold`, until `done` is true.",
    })
}

/// Opens a session; `params` may have the fields of a reset, which begins an episode. Without any, the first tool call or a
/// reset begins it.
///
/// A connection that has a session receives its id. An episode begins in it unless one is running; `params` must then be
/// empty.
async fn create_session(
    app: &AppState,
    params: &Map<String, Value>,
    origin: RpcOrigin<'_>,
) -> Result<Value, RpcError> {
    let client = match origin {
        RpcOrigin::Single { client, .. } => client,
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
    if !params.is_empty()
        && let Err(error) = begin_episode(&mut *session.lock().await, params).await
    {
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
        .await
        .map_err(|error| RpcError::params(&error.to_string()))?;
    session
        .reset(resolved, name)
        .await
        .map(|_| ())
        .map_err(|error| RpcError::internal(&session_error_message(&error)))
}

fn close_session(
    RpcContext { app, client, .. }: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&mut Session>,
) -> Result<Value, RpcError> {
    let name = params.get("session_id").and_then(Value::as_str);
    let name = name.ok_or_else(|| RpcError::params("'session_id' is required"))?;
    match app.sessions.close(&SessionKey::new(client, name)) {
        CloseOutcome::Unknown if own.is_some_and(|own| own.id() == name) => Err(RpcError::params(
            "this session belongs to the connection and ends with it; close the connection",
        )),
        CloseOutcome::Closed => Ok(json!({"session_id": name, "closed": true})),
        CloseOutcome::Closing => Ok(json!({"session_id": name, "closed": false, "closing": true})),
        CloseOutcome::Unknown => Err(RpcError::no_session(name)),
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
    let called = match (named_session(context, params, own.as_deref())?, own) {
        (None, Some(own)) => call_in_session(own, name, arguments).await,
        (Some(session), _) => call_in_session(&mut *session.lock().await, name, arguments).await,
        // Without a session, every call would have its own world.
        (None, None) => Err(RpcError::params(
            "'session_id' is required: send the header Mcp-Session-Id of the response to `initialize`, or the session_id that \
             openenv/session/create returns",
        )),
    };
    // The protocol shows a model the errors of its calls as results. OpenEnv's clients, which name their session in the params,
    // raise the errors of JSON-RPC.
    let shows_errors = context.default_session.is_some() && !params.contains_key("session_id");
    called.or_else(|error| if shows_errors { Ok(tools::error_result(&error)) } else { Err(error) })
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
    RpcContext { app, client, default_session }: RpcContext<'_>,
    params: &Map<String, Value>,
    own: Option<&Session>,
) -> Result<Option<SharedSession>, RpcError> {
    let name = match params.get("session_id") {
        None | Some(Value::Null) => default_session,
        Some(Value::String(name)) => Some(name.as_str()),
        Some(other) => return Err(RpcError::no_session(&other.to_string())),
    };
    let Some(name) = name.filter(|name| own.is_none_or(|own| own.id() != *name)) else { return Ok(None) };
    // Two connections that use each other's sessions would wait for each other.
    if let Some(own) = own {
        let message =
            format!("session_id: the connection has the session {}; leave the parameter out", own.id());
        return Err(RpcError::params(&message));
    }
    let known = app.sessions.get(&SessionKey::new(client, name));
    known.map(Some).ok_or_else(|| RpcError::no_session(name))
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
