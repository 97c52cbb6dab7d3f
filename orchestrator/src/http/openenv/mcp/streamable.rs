//! The transport *Streamable HTTP* of the Model Context Protocol: sessions by header, notifications, and event streams.

use std::convert::Infallible;

use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use serde_json::Value;
use uuid::Uuid;

use super::super::simulation::SESSION_HEADER;
use super::rpc::{self, RpcError, RpcRequest};
use super::{PROTOCOL_VERSIONS, RpcOrigin, tools};
use crate::http::state::AppState;
use crate::limits::QuotaExceeded;
use crate::sessions::{ClientIdentity, MAX_NAME_CHARS, SessionKey};

/// Header with the session of the protocol, which the response to `initialize` sets.
const PROTOCOL_SESSION_HEADER: HeaderName = HeaderName::from_static("mcp-session-id");
/// Header with the version of the protocol.
const VERSION_HEADER: &str = "mcp-protocol-version";

/// Answers a message of a client.
pub(super) async fn answer(
    app: AppState,
    client: ClientIdentity,
    headers: &HeaderMap,
    message: Value,
) -> Response {
    if let Some(problem) = unknown_version(headers) {
        return (StatusCode::BAD_REQUEST, axum::Json(rpc::error_response(&Value::Null, &problem)))
            .into_response();
    }
    let named = protocol_session(headers).map(str::to_owned);
    if let Some(name) = &named
        && app.sessions.get(&SessionKey::new(&client, name.as_str())).is_none()
    {
        let body =
            rpc::error_response(message.get("id").unwrap_or(&Value::Null), &RpcError::no_session(name));
        return (StatusCode::NOT_FOUND, axum::Json(body)).into_response();
    }
    if expects_no_answer(&message, named.is_some()) {
        return StatusCode::ACCEPTED.into_response();
    }
    let is_in_session = named.is_some();
    match message.get("method").and_then(Value::as_str) {
        Some("initialize") if named.is_none() && message.get("id").is_some() => {
            initialize(&app, &client, headers, &message).await
        }
        _ => {
            let session = match named
                .map_or_else(|| openenv_session(&app, &client, headers, &message), |name| Ok(Some(name)))
            {
                Ok(session) => session,
                Err(full) => {
                    let id = message.get("id").unwrap_or(&Value::Null);
                    return axum::Json(rpc::error_response(id, &RpcError::capacity(full))).into_response();
                }
            };
            let accepts_events = accepts_events(headers);
            let response = async move {
                let origin = RpcOrigin::Single { client: &client, session: session.as_deref() };
                let mut response = super::respond(&app, &message, origin).await;
                // OpenEnv's server answers invalid requests without their id; a client of the protocol would wait for ever.
                if is_in_session && matches!(message["id"], Value::String(_) | Value::Number(_)) {
                    response["id"] = message["id"].clone();
                }
                response
            };
            if accepts_events { event_stream(response) } else { axum::Json(response.await).into_response() }
        }
    }
}

/// Answers `initialize` and opens a session, whose name is in a header of the response.
async fn initialize(
    app: &AppState,
    client: &ClientIdentity,
    headers: &HeaderMap,
    message: &Value,
) -> Response {
    let response = super::respond(app, message, RpcOrigin::Single { client, session: None }).await;
    let mut session = None;
    let response = if response.get("result").is_some() {
        let name = Uuid::new_v4().to_string();
        match app.sessions.get_or_open(client, &SessionKey::new(client, name.as_str())) {
            Ok(_) => {
                session = HeaderValue::from_str(&name).ok();
                response
            }
            Err(full) => {
                rpc::error_response(message.get("id").unwrap_or(&Value::Null), &RpcError::capacity(full))
            }
        }
    } else {
        response
    };
    let mut response = if accepts_events(headers) {
        event_stream(std::future::ready(response))
    } else {
        axum::Json(response).into_response()
    };
    if let Some(session) = session {
        response.headers_mut().insert(PROTOCOL_SESSION_HEADER, session);
    }
    response
}

/// Returns an event stream with one message. Comments keep the connection open while a tool works.
fn event_stream(message: impl Future<Output = Value> + Send + 'static) -> Response {
    let event =
        async move { Ok::<_, Infallible>(Event::default().event("message").data(message.await.to_string())) };
    Sse::new(stream::once(event)).keep_alive(KeepAlive::default()).into_response()
}

/// Returns the name of the protocol's session that a request names.
pub(super) fn protocol_session(headers: &HeaderMap) -> Option<&str> {
    headers.get(PROTOCOL_SESSION_HEADER).map(|name| name.to_str().unwrap_or_default())
}

/// Returns the name of the session in OpenEnv's header, if it is valid and the session exists. A call of a tool opens the
/// session, as `/reset` does.
fn openenv_session(
    app: &AppState,
    client: &ClientIdentity,
    headers: &HeaderMap,
    message: &Value,
) -> Result<Option<String>, QuotaExceeded> {
    let name = headers.get(SESSION_HEADER).and_then(|name| name.to_str().ok());
    let Some(name) = name.filter(|name| (1..=MAX_NAME_CHARS).contains(&name.len())) else { return Ok(None) };
    let key = SessionKey::new(client, name);
    if is_valid_call(message) {
        app.sessions.get_or_open(client, &key)?;
        return Ok(Some(name.to_owned()));
    }
    Ok(app.sessions.get(&key).map(|_| name.to_owned()))
}

/// Returns the error of a request with an unknown version of the protocol.
fn unknown_version(headers: &HeaderMap) -> Option<RpcError> {
    let version = headers.get(VERSION_HEADER)?;
    let is_known = PROTOCOL_VERSIONS.iter().any(|known| version == known);
    let requested = String::from_utf8_lossy(version.as_bytes());
    (!is_known).then(|| RpcError::unsupported_version(&requested, &PROTOCOL_VERSIONS))
}

/// Returns true for a call of a tool that exists, in the session that a header names.
fn is_valid_call(message: &Value) -> bool {
    RpcRequest::parse(message).is_ok_and(|request| {
        let tool = request.params.get("name").and_then(Value::as_str);
        request.method == "tools/call"
            && !request.params.contains_key("session_id")
            && tool.is_some_and(tools::is_tool)
    })
}

/// Returns true for a notification, and for a client's response to a request of the server. OpenEnv's server answers requests
/// without an id; in a session of the protocol they are notifications.
fn expects_no_answer(message: &Value, is_in_session: bool) -> bool {
    let method = message.get("method").and_then(Value::as_str);
    let is_notification = method.is_some_and(|method| is_in_session || method.starts_with("notifications/"));
    let is_response = method.is_none() && (message.get("result").is_some() || message.get("error").is_some());
    (is_notification && message.get("id").is_none()) || is_response
}

/// Returns true if a request accepts an event stream.
fn accepts_events(headers: &HeaderMap) -> bool {
    let values = headers.get_all(header::ACCEPT).into_iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|range| {
        let mut parts = range.split(';').map(str::trim);
        let is_stream = parts.next().is_some_and(|essence| essence.eq_ignore_ascii_case("text/event-stream"));
        let weight = parts.find_map(|part| part.strip_prefix("q=")?.parse::<f32>().ok());
        is_stream && weight != Some(0.0)
    })
}
