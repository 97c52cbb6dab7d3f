//! `/ws`: a session over one WebSocket in OpenEnv's frames. The connection has a session of its own, which only the message
//! `close` ends, or attaches to the session of `POST /mcp` that its query names.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::response::Response;
use openenv_wire::ValidationError;
use serde_json::{Map, Value, json};
use tokio::sync::Mutex;

use super::super::socket::{
    Received, close, close_for_size, limit_frames, receive, run_while_connected, send_text,
};
use super::error_message::service_error_message;
use super::error_response::request_error;
use super::fields::{FieldReader, QueryParams, misplaced_field, read_session_request};
use super::mcp;
use super::step_response;
use super::tasks::{RESET_ORDER, built_in_task};
use crate::http::state::AppState;
use crate::limits::QuotaExceeded;
use crate::sessions::{AttachedSession, ClientIdentity, Session, SessionError, SessionKey, SharedSession};

/// Capacity of the first response in bytes; later responses use the size of the previous one.
const INITIAL_CAPACITY: usize = 4 * 1024;
/// Maximum number of errors in a message.
const MAX_SHOWN_ERRORS: usize = 3;

/// Opens a session over a WebSocket, or attaches to the one that the query names.
pub(super) async fn connect(
    State(app): State<AppState>,
    client: ClientIdentity,
    query: QueryParams,
    upgrade: WebSocketUpgrade,
) -> Response {
    limit_frames(upgrade).on_upgrade(move |socket| serve(socket, app, client, query))
}

/// Session of a connection.
enum ConnectedSession {
    /// Session that ends with the connection.
    Own(SharedSession),
    /// Session that other requests use as well.
    Attached(AttachedSession),
}

impl ConnectedSession {
    /// Opens a session, or attaches to the one with a name. An error is the frame for the client.
    fn connect(app: &AppState, client: &ClientIdentity, query: &QueryParams) -> Result<Self, Value> {
        if let Some(reason) = misplaced_field(query) {
            return Err(error_frame("VALIDATION_ERROR", &reason));
        }
        let named = query.iter().find(|(name, value)| name == "session_id" && !value.is_empty());
        match named.map(|(_, value)| value.clone()) {
            None => match app.sessions.open(client) {
                Ok(session) => Ok(Self::Own(Arc::new(Mutex::new(session)))),
                Err(full) => Err(capacity_error(full)),
            },
            Some(name) => {
                let attached = app.sessions.attach(SessionKey::new(client, name));
                attached.map(Self::Attached).map_err(|error| error_frame("SESSION_ERROR", &error.to_string()))
            }
        }
    }

    /// Returns true if a request over HTTP used the session within a time.
    fn was_used_within(&self, time: Duration) -> bool {
        matches!(self, Self::Attached(attached) if attached.was_used_within(time))
    }

    const fn session(&self) -> &SharedSession {
        match self {
            Self::Own(session) => session,
            Self::Attached(attached) => attached.session(),
        }
    }
}

async fn serve(mut socket: WebSocket, app: AppState, client: ClientIdentity, query: QueryParams) {
    let connected = match ConnectedSession::connect(&app, &client, &query) {
        Ok(connected) => connected,
        Err(frame) => {
            let _ = send_text(&mut socket, frame.to_string().into_bytes()).await;
            return close(socket).await;
        }
    };
    let end = run_session(&mut socket, &app, &client, &connected).await;
    // Before the client learns of the end, so that its next request finds the session closed and the place free.
    drop(connected);
    match end {
        SessionEnd::Close => close(socket).await,
        SessionEnd::FrameTooLarge => close_for_size(socket).await,
        SessionEnd::Gone => {}
    }
}

/// Way in which a connection ends.
enum SessionEnd {
    /// The server closes the connection.
    Close,
    /// The server closes the connection because of a frame beyond the size limit.
    FrameTooLarge,
    /// The client is gone.
    Gone,
}

/// Answers the frames of a connection until its end.
async fn run_session(
    socket: &mut WebSocket,
    app: &AppState,
    client: &ClientIdentity,
    connected: &ConnectedSession,
) -> SessionEnd {
    let idle_timeout = app.sessions.limits().idle_timeout;
    let mut closing = app.sessions.close_signal(client);
    let (mut capacity, mut early) = (INITIAL_CAPACITY, None);
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = receive(socket, idle_timeout) => received,
                reason = closing.closed() => Received::Stop(reason),
            },
        };
        // Allocated here, so that an idle session holds no buffer.
        let mut frame = Vec::with_capacity(capacity);
        match received {
            Received::Text(text) => {
                let work = respond(app, connected.session(), &text, &mut frame);
                match run_while_connected(socket, &mut early, work).await {
                    None => return SessionEnd::Gone,
                    Some(ControlFlow::Break(())) => return SessionEnd::Close,
                    Some(ControlFlow::Continue(())) => {}
                }
            }
            Received::Binary(_) => frame.extend(
                error_frame("SESSION_ERROR", "binary frames are not supported; send text")
                    .to_string()
                    .bytes(),
            ),
            // Requests over HTTP use the session, so that the connection only waits.
            Received::Idle if idle_timeout.is_some_and(|timeout| connected.was_used_within(timeout)) => {
                continue;
            }
            Received::Idle => {
                let words = "the session ended after its idle timeout";
                let _ =
                    send_text(socket, error_frame("SESSION_TIMEOUT", words).to_string().into_bytes()).await;
                return SessionEnd::Close;
            }
            Received::Stop(reason) => {
                let _ = send_text(
                    socket,
                    error_frame("SESSION_ERROR", reason.message()).to_string().into_bytes(),
                )
                .await;
                return SessionEnd::Close;
            }
            Received::TooLarge => return SessionEnd::FrameTooLarge,
            Received::Left | Received::Gone => return SessionEnd::Gone,
        }
        capacity = frame.len() + frame.len() / 8 + 64; // observations grow a little from step to step
        if send_text(socket, frame).await.is_err() {
            return SessionEnd::Gone;
        }
    }
}

/// Writes the response to one text frame into `out`. Breaks if the client closes the session.
async fn respond(app: &AppState, session: &SharedSession, text: &str, out: &mut Vec<u8>) -> ControlFlow<()> {
    let mut message = match openenv_wire::parse_python_json(text) {
        Ok(Value::Object(message)) => message,
        Ok(other) => {
            let words = "Input should be a valid dictionary";
            let fault = ValidationError {
                kind: "dict_type",
                loc: Vec::new(),
                msg: words.to_owned(),
                input: openenv_wire::echo_input(&other),
                ctx: None,
            };
            out.extend(validation_error(&[fault]).to_string().bytes());
            return ControlFlow::Continue(());
        }
        Err(reason) => {
            out.extend(error_frame("INVALID_JSON", &format!("Invalid JSON: {reason}")).to_string().bytes());
            return ControlFlow::Continue(());
        }
    };
    let session = &mut *session.lock().await;
    let result = match message.get("type").and_then(Value::as_str) {
        Some("reset") => reset(session, &mut message, out).await,
        Some("step") => step(session, &mut message, out).await,
        Some("state") => check_no_data(&message).map(|()| {
            let state = json!({"type": "state", "data": step_response::state_value(&session.status())});
            out.extend(state.to_string().bytes());
        }),
        Some("close") => match check_no_data(&message) {
            Ok(()) => return ControlFlow::Break(()),
            Err(error) => Err(error),
        },
        Some("mcp") => mcp(app, session, &mut message, out).await,
        _ => {
            let kind = message.get("type");
            let kind = kind.map_or_else(String::new, |kind| {
                kind.as_str().map_or_else(|| kind.to_string(), str::to_owned)
            });
            let kind: String = kind.chars().take(60).collect();
            Err(error_frame("UNKNOWN_TYPE", &format!("Unknown message type: {kind}")))
        }
    };
    if let Err(error) = result {
        out.clear();
        out.extend(error.to_string().bytes());
    }
    ControlFlow::Continue(())
}

async fn reset(
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let data = data(message, Some(Map::new()))?;
    let mut fields = FieldReader::new(&data, Vec::new());
    let request = read_session_request(&mut fields);
    if !fields.errors.is_empty() {
        return Err(validation_error(&fields.errors));
    }
    // openenv-core goes through its tasks. A group has one task, independent of the number of resets.
    let next = RESET_ORDER[usize::try_from(session.resets()).unwrap_or_default() % RESET_ORDER.len()];
    let default_task = built_in_task(if request.group.is_some() { RESET_ORDER[0] } else { next });
    let name = request.episode_id.clone();
    let resolved = request
        .resolve(default_task)
        .await
        .map_err(|error| validation_error(&[request_error(&error, &[])]))?;
    session.reset(resolved, name).await.map_err(|error| session_error(&error))?;
    write_observation(session, out).map_err(|error| session_error(&error))
}

async fn step(
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let action = data(message, None)?;
    if let Some(answer) = mcp::call_by_step(session, &action).await {
        out.extend(answer.to_string().bytes());
        return Ok(());
    }
    session.step(&Value::Object(action)).await.map_err(|error| session_error(&error))?;
    write_observation(session, out).map_err(|error| session_error(&error))
}

async fn mcp(
    app: &AppState,
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let request = data(message, None)?;
    let answer = mcp::respond(app, &Value::Object(request), mcp::RpcOrigin::Connection(session)).await;
    out.extend(json!({"type": "mcp", "data": answer}).to_string().bytes());
    Ok(())
}

fn write_observation(session: &Session, out: &mut Vec<u8>) -> Result<(), SessionError> {
    out.extend_from_slice(b"{\"type\":\"observation\",\"data\":");
    step_response::write_step(session, out)?;
    out.push(b'}');
    Ok(())
}

/// Returns the data of a message, which may have no other fields. `default` replaces missing data.
fn data(
    message: &mut Map<String, Value>,
    default: Option<Map<String, Value>>,
) -> Result<Map<String, Value>, Value> {
    let sent = message.remove("data");
    let mut fields = FieldReader::new(message, Vec::new());
    let data = match (sent, default) {
        (Some(Value::Object(data)), _) => data,
        (Some(other), _) => {
            fields.add_error("data", "dict_type", "Input should be a valid dictionary", &other);
            Map::new()
        }
        (None, Some(default)) => default,
        (None, None) => {
            let input = Value::Object(message.clone());
            fields.add_error("data", "missing", "Field required", &openenv_wire::echo_input(&input));
            Map::new()
        }
    };
    reject_unknown(&mut fields, message, &["type", "data"]);
    if fields.errors.is_empty() { Ok(data) } else { Err(validation_error(&fields.errors)) }
}

/// Checks that a message has only its type.
fn check_no_data(message: &Map<String, Value>) -> Result<(), Value> {
    let mut fields = FieldReader::new(message, Vec::new());
    reject_unknown(&mut fields, message, &["type"]);
    if fields.errors.is_empty() { Ok(()) } else { Err(validation_error(&fields.errors)) }
}

/// Adds errors of up to 16 unknown fields.
fn reject_unknown(fields: &mut FieldReader<'_>, message: &Map<String, Value>, known: &[&str]) {
    for (key, value) in message.iter().filter(|(key, _)| !known.contains(&key.as_str())).take(16) {
        fields.add_unknown_field(key, value);
    }
}

/// Returns an error frame.
pub(super) fn error_frame(code: &str, message: &str) -> Value {
    json!({"type": "error", "data": {"message": message, "code": code}})
}

/// Returns the error frame of validation errors. Its message names the fields, since OpenEnv's client shows only the message.
fn validation_error(errors: &[ValidationError]) -> Value {
    let message = format!("Invalid message: {}", summarize(errors));
    json!({"type": "error", "data": {"message": message, "code": "VALIDATION_ERROR", "errors": errors}})
}

/// Returns the first errors with their fields as one sentence.
pub(super) fn summarize(errors: &[ValidationError]) -> String {
    let mut summary: Vec<String> = errors.iter().take(MAX_SHOWN_ERRORS).map(ToString::to_string).collect();
    if errors.len() > MAX_SHOWN_ERRORS {
        summary.push(format!("and {} more", errors.len() - MAX_SHOWN_ERRORS));
    }
    summary.join("; ")
}

fn session_error(error: &SessionError) -> Value {
    match error {
        SessionError::Action(errors) => validation_error(errors),
        SessionError::Service(failure) => error_frame("EXECUTION_ERROR", &service_error_message(failure)),
        other => error_frame("EXECUTION_ERROR", &other.to_string()),
    }
}

pub(super) fn capacity_error(full: QuotaExceeded) -> Value {
    let mut frame = error_frame("CAPACITY_REACHED", &full.to_string());
    frame["data"]["active_sessions"] = json!(full.active);
    frame["data"]["max_sessions"] = json!(full.limit);
    frame
}
