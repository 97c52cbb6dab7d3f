//! `/ws`: a session over one WebSocket, in openenv-core's frames. Nothing that a client sends ends the session but `close`.

use std::ops::ControlFlow;

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::response::Response;
use openenv_wire::ValidationError;
use serde_json::{Map, Value, json};

use super::super::socket::{Received, bounded, close, close_for_size, meanwhile, next, send};
use super::answer;
use super::mcp;
use super::read::{Fields, WALK, wish};
use super::refusal::wish_fault;
use crate::http::state::AppState;
use crate::sessions::{QuotaExceeded, Session, SessionError, ClientIdentity};

/// Room for the first answer; later ones get what the last one took.
const ROOM: usize = 4 * 1024;

/// A session over a WebSocket.
pub(super) async fn connect(State(app): State<AppState>, who: ClientIdentity, upgrade: WebSocketUpgrade) -> Response {
    bounded(upgrade).on_upgrade(move |socket| serve(socket, app, who))
}

async fn serve(mut socket: WebSocket, app: AppState, who: ClientIdentity) {
    let mut session = match app.sessions.open(&who) {
        Ok(session) => session,
        Err(full) => {
            let _ = send(&mut socket, capacity(full).to_string().into_bytes()).await;
            return close(socket).await;
        }
    };
    let mut closing = app.sessions.close_signal(&who);
    let (mut room, mut early) = (ROOM, None);
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = next(&mut socket, app.sessions.limits().idle_timeout) => received,
                why = closing.closed() => Received::Stop(why),
            },
        };
        // Not held while a session is silent.
        let mut frame = Vec::with_capacity(room);
        match received {
            Received::Text(text) => {
                let work = answered(&app, &mut session, &text, &mut frame);
                match meanwhile(&mut socket, &mut early, work).await {
                    None => return,
                    Some(ControlFlow::Break(())) => return close(socket).await,
                    Some(ControlFlow::Continue(())) => {}
                }
            }
            Received::Binary(_) => frame.extend(
                error("SESSION_ERROR", "binary frames are not read here; send text").to_string().bytes(),
            ),
            Received::Idle => {
                let words = "the session was silent for too long";
                let _ = send(&mut socket, error("SESSION_TIMEOUT", words).to_string().into_bytes()).await;
                return close(socket).await;
            }
            Received::Stop(why) => {
                let _ = send(&mut socket, error("SESSION_ERROR", why.message()).to_string().into_bytes()).await;
                return close(socket).await;
            }
            Received::TooLarge => return close_for_size(socket).await,
            Received::Left | Received::Gone => return,
        }
        room = frame.len() + frame.len() / 8 + 64; // observations grow a little from step to step
        if send(&mut socket, frame).await.is_err() {
            return;
        }
    }
}

/// Answers one frame of text into `out`; breaks where the client wants to go.
async fn answered(app: &AppState, session: &mut Session, text: &str, out: &mut Vec<u8>) -> ControlFlow<()> {
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
            out.extend(faults(&[fault]).to_string().bytes());
            return ControlFlow::Continue(());
        }
        Err(unread) => {
            out.extend(error("INVALID_JSON", &format!("Invalid JSON: {unread}")).to_string().bytes());
            return ControlFlow::Continue(());
        }
    };
    let told = match message.get("type").and_then(Value::as_str) {
        Some("reset") => reset(session, &mut message, out).await,
        Some("step") => step(session, &mut message, out).await,
        Some("state") => bare(&message).map(|()| {
            let state = json!({"type": "state", "data": answer::state(&session.status())});
            out.extend(state.to_string().bytes());
        }),
        Some("close") => match bare(&message) {
            Ok(()) => return ControlFlow::Break(()),
            Err(told) => Err(told),
        },
        Some("mcp") => mcp(app, session, &mut message, out).await,
        _ => {
            let kind = message.get("type");
            let kind = kind.map_or_else(String::new, |kind| {
                kind.as_str().map_or_else(|| kind.to_string(), str::to_owned)
            });
            let kind: String = kind.chars().take(60).collect();
            Err(error("UNKNOWN_TYPE", &format!("Unknown message type: {kind}")))
        }
    };
    if let Err(told) = told {
        out.clear();
        out.extend(told.to_string().bytes());
    }
    ControlFlow::Continue(())
}

async fn reset(
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let data = data(message, Some(Map::new()))?;
    let mut fields = Fields::new(&data, Vec::new());
    let wish = wish(&mut fields);
    if !fields.faults.is_empty() {
        return Err(faults(&fields.faults));
    }
    // The original walks through its tasks; a group is of one, however often it was reset before.
    let walked = WALK[usize::try_from(session.resets()).unwrap_or_default() % WALK.len()];
    let usual = super::usual(if wish.group.is_some() { WALK[0] } else { walked });
    let name = wish.episode_id.clone();
    let wished = wish.resolve(usual).map_err(|error| faults(&[wish_fault(&error, &[])]))?;
    let shown = session.reset(wished, name).await.map_err(|error| refused(&error))?;
    observation(&shown, out);
    Ok(())
}

async fn step(
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let action = data(message, None)?;
    if let Some(answer) = mcp::as_step(session, &action).await {
        out.extend(answer.to_string().bytes());
        return Ok(());
    }
    let shown = session.step(&Value::Object(action)).await.map_err(|error| refused(&error))?;
    observation(&shown, out);
    Ok(())
}

async fn mcp(
    app: &AppState,
    session: &mut Session,
    message: &mut Map<String, Value>,
    out: &mut Vec<u8>,
) -> Result<(), Value> {
    let request = data(message, None)?;
    let answer = mcp::answer(app, &Value::Object(request), mcp::By::Own(session)).await;
    out.extend(json!({"type": "mcp", "data": answer}).to_string().bytes());
    Ok(())
}

fn observation(shown: &crate::sessions::StepView<'_>, out: &mut Vec<u8>) {
    out.extend_from_slice(b"{\"type\":\"observation\",\"data\":");
    answer::observation(shown, out);
    out.push(b'}');
}

/// The data of a message that may have nothing else.
fn data(
    message: &mut Map<String, Value>,
    otherwise: Option<Map<String, Value>>,
) -> Result<Map<String, Value>, Value> {
    let told = message.remove("data");
    let mut fields = Fields::new(message, Vec::new());
    let data = match (told, otherwise) {
        (Some(Value::Object(data)), _) => data,
        (Some(other), _) => {
            fields.fault("data", "dict_type", "Input should be a valid dictionary", &other);
            Map::new()
        }
        (None, Some(otherwise)) => otherwise,
        (None, None) => {
            let input = Value::Object(message.clone());
            fields.fault("data", "missing", "Field required", &openenv_wire::echo_input(&input));
            Map::new()
        }
    };
    extra(&mut fields, message, &["type", "data"]);
    if fields.faults.is_empty() { Ok(data) } else { Err(faults(&fields.faults)) }
}

/// A message that has nothing but its type.
fn bare(message: &Map<String, Value>) -> Result<(), Value> {
    let mut fields = Fields::new(message, Vec::new());
    extra(&mut fields, message, &["type"]);
    if fields.faults.is_empty() { Ok(()) } else { Err(faults(&fields.faults)) }
}

fn extra(fields: &mut Fields<'_>, message: &Map<String, Value>, known: &[&str]) {
    for (key, value) in message.iter().filter(|(key, _)| !known.contains(&key.as_str())).take(16) {
        fields.extra(key, value);
    }
}

/// An error frame.
fn error(code: &str, words: &str) -> Value {
    json!({"type": "error", "data": {"message": words, "code": code}})
}

fn faults(faults: &[ValidationError]) -> Value {
    json!({"type": "error", "data": {"message": "Invalid message", "code": "VALIDATION_ERROR", "errors": faults}})
}

fn refused(refusal: &SessionError) -> Value {
    match refusal {
        SessionError::Action(found) => faults(found),
        SessionError::Service(failure) => error("EXECUTION_ERROR", &super::in_words(failure)),
        other => error("EXECUTION_ERROR", &other.to_string()),
    }
}

fn capacity(full: QuotaExceeded) -> Value {
    let mut told = error("CAPACITY_REACHED", &full.to_string());
    told["data"]["active_sessions"] = json!(full.active);
    told["data"]["max_sessions"] = json!(full.limit);
    told
}
