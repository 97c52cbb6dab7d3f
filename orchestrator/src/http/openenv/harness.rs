//! `/harness`: the language model of the server as OpenEnv's agentic harness (RFC 005 of OpenEnv). Each message of the client is one
//! turn, in which the model acts until its episode is over; `harness_turn` runs it.

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::response::Response;
use clock::Millis;
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use llm_policy::{ActionCodec, ChatPolicy, ChatSettings, ObservationFormat, TaskPrompt};
use rollout::Endpoint;
use serde_json::{Map, Value, json};

use super::super::socket::{
    Received, close, close_for_size, limit_frames, receive, run_while_connected, send_text,
};
use super::error_message::session_error_message;
use super::fields::{FieldReader, read_session_request};
use super::harness_turn::{HarnessTurn, TurnEvent, harness_event};
use super::socket::{capacity_error, error_frame, summarize};
use super::tasks::{RESET_ORDER, built_in_task};
use crate::http::state::AppState;
use crate::sessions::{ClientIdentity, Session};

/// Name of the harness in `session_started`.
const HARNESS: &str = "chat";
/// Name whose token budget pays for the calls of all harness sessions.
const BUDGET: &str = "harness";
/// Previous exchanges in the model's conversation, as in `sparring play`.
const HISTORY: usize = 2;
/// Longest message of a client, in characters.
const MAX_MESSAGE_CHARS: usize = 20_000;

/// Fields of the query of a harness session.
const QUERY_FIELDS: [&str; 3] = ["task", "seed", "run"];

/// Query of a harness session: which scenarios it has.
#[derive(Debug, Clone)]
pub(super) struct HarnessQuery(pub(super) Vec<(String, String)>);

impl HarnessQuery {
    /// Checks that the query has no unknown or repeated field: an ignored one would lead to other episodes than the client expects.
    fn check(&self) -> Result<(), String> {
        let known = QUERY_FIELDS.join(", ");
        for (at, (name, _)) in self.0.iter().enumerate() {
            if !QUERY_FIELDS.contains(&name.as_str()) {
                let name = shorten(name, MAX_QUOTED_CHARS);
                return Err(format!(
                    "Invalid query: {name:?} is not a known field; the known fields are {known}"
                ));
            }
            if self.0[..at].iter().any(|(earlier, _)| earlier == name) {
                return Err(format!("Invalid query: {name} is repeated"));
            }
        }
        Ok(())
    }

    /// Fields of a reset. Only the first episode has the seed.
    fn fields(&self, is_first: bool) -> Map<String, Value> {
        let fields = self.0.iter().filter(|(name, _)| is_first || name != "seed");
        let value = |(name, text): &(String, String)| {
            // A text that is no number is reported as an error of the field.
            let number = text.parse::<u64>().ok().filter(|_| name == "seed");
            (name.clone(), number.map_or_else(|| json!(text), |seed| json!(seed)))
        };
        fields.map(value).collect()
    }
}

/// Opens a harness session over a WebSocket.
pub(super) async fn connect(
    State(app): State<AppState>,
    client: ClientIdentity,
    query: HarnessQuery,
    upgrade: WebSocketUpgrade,
) -> Response {
    limit_frames(upgrade).on_upgrade(move |socket| serve(socket, app, client, query))
}

/// Way in which a connection ends.
enum HarnessEnd {
    /// The server closes the connection, after this frame if there is one.
    Close(Option<Value>),
    /// The server closes the connection because of a frame beyond the size limit.
    FrameTooLarge,
    /// The client is gone.
    Gone,
}

async fn serve(mut socket: WebSocket, app: AppState, client: ClientIdentity, query: HarnessQuery) {
    let end = match open(&app, &client) {
        Ok((mut session, endpoint)) => {
            let harness = Harness { app: &app, endpoint: &endpoint, query, client: &client };
            // The session is dropped before the client learns of the end, so that its next request finds the place free.
            harness.run(&mut socket, &mut session).await
        }
        Err(frame) => HarnessEnd::Close(Some(frame)),
    };
    match end {
        HarnessEnd::Close(frame) => {
            if let Some(frame) = frame {
                let _ = send_text(&mut socket, frame.to_string().into_bytes()).await;
            }
            close(socket).await;
        }
        HarnessEnd::FrameTooLarge => close_for_size(socket).await,
        HarnessEnd::Gone => {}
    }
}

/// Opens a session for the server's language model. An error is the frame for the client.
fn open(app: &AppState, client: &ClientIdentity) -> Result<(Session, Endpoint), Value> {
    let Some(endpoint) = app.endpoint.clone() else {
        let message = "the server has no language model for harness sessions; start it with --policy-url and --policy-model";
        return Err(error_frame("FACTORY_ERROR", message));
    };
    let session = app.sessions.open(client).map_err(capacity_error)?;
    Ok((session, endpoint))
}

/// Harness session of one connection.
struct Harness<'a> {
    app: &'a AppState,
    endpoint: &'a Endpoint,
    query: HarnessQuery,
    client: &'a ClientIdentity,
}

impl Harness<'_> {
    /// Begins an episode and answers messages until the connection ends.
    async fn run(&self, socket: &mut WebSocket, session: &mut Session) -> HarnessEnd {
        let begun = match self.query.check() {
            Ok(()) => self.reset(session).await,
            Err(message) => Err(message),
        };
        if let Err(message) = begun {
            return HarnessEnd::Close(Some(error_frame("SESSION_ERROR", &message)));
        }
        let mut policy = self.policy(session);
        let started =
            json!({"type": "session_started", "data": {"session_id": session.id(), "harness": HARNESS}});
        if send_text(socket, started.to_string().into_bytes()).await.is_err() {
            return HarnessEnd::Gone;
        }
        let idle_timeout = self.app.sessions.limits().idle_timeout;
        let mut closing = self.app.sessions.close_signal(self.client);
        let mut early = None;
        loop {
            let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
                Some(received) => received,
                None => tokio::select! {
                    received = receive(socket, idle_timeout) => received,
                    reason = closing.closed() => Received::Stop(reason),
                },
            };
            let content = match read_received(socket, received).await {
                Ok(Some(content)) => content,
                Ok(None) => continue,
                Err(end) => return end,
            };
            if session.view().is_ok_and(|view| view.done) {
                if let Err(message) = self.reset(session).await {
                    return HarnessEnd::Close(Some(fatal_error(&message, self.app.clock.now())));
                }
                policy = self.policy(session);
            }
            policy.instruct(&content);
            let turn = self.run_turn(socket, session, &mut policy, &mut early);
            let end = tokio::select! {
                end = turn => end,
                reason = closing.closed() => {
                    Some(HarnessEnd::Close(Some(fatal_error(reason.message(), self.app.clock.now()))))
                }
            };
            if let Some(end) = end {
                return end;
            }
        }
    }

    /// Begins the next episode.
    async fn reset(&self, session: &mut Session) -> Result<(), String> {
        let fields = self.query.fields(session.resets() == 0);
        let mut fields = FieldReader::new(&fields, Vec::new());
        let request = read_session_request(&mut fields);
        if !fields.errors.is_empty() {
            return Err(format!("Invalid query: {}", summarize(&fields.errors)));
        }
        let source = request.resolve(built_in_task(RESET_ORDER[0])).await;
        let source = source.map_err(|error| format!("Invalid query: {error}"))?;
        session.reset(source, None).await.map(|_| ()).map_err(|error| session_error_message(&error))
    }

    /// Runs a turn and sends its events as they occur. Returns how the connection ends, if it does.
    async fn run_turn(
        &self,
        socket: &mut WebSocket,
        session: &mut Session,
        policy: &mut ChatPolicy,
        early: &mut Option<Received>,
    ) -> Option<HarnessEnd> {
        let mut turn = HarnessTurn::new(session, policy);
        loop {
            let Some(events) = run_while_connected(socket, early, turn.next()).await else {
                return Some(HarnessEnd::Gone);
            };
            let now = self.app.clock.now();
            for TurnEvent { kind, data, ago } in events.list {
                let frame = harness_event(kind, &data, now - ago).to_string().into_bytes();
                if send_text(socket, frame).await.is_err() {
                    return Some(HarnessEnd::Gone);
                }
            }
            match events.end {
                None => {}
                Some(Ok(())) => return None,
                Some(Err(message)) => return Some(HarnessEnd::Close(Some(fatal_error(&message, now)))),
            }
        }
    }

    /// Creates the policy of the session's episode.
    fn policy(&self, session: &Session) -> ChatPolicy {
        let status = session.status();
        let task = status.scenario.map_or_else(|| built_in_task(RESET_ORDER[0]), |scenario| scenario.task());
        let prompt = TaskPrompt::new(ActionCodec::new(task), ObservationFormat::Compact);
        let settings = ChatSettings {
            run: BUDGET.to_owned(),
            history: HISTORY,
            temperature: self.endpoint.temperature,
            max_tokens: self.endpoint.llm.config().max_tokens,
        };
        ChatPolicy::new(self.endpoint.llm.clone(), prompt, settings)
    }
}

/// Reads the instruction in a frame. Returns `None` if the frame was invalid and the client has received the reason, and an error if
/// the connection ends.
async fn read_received(socket: &mut WebSocket, received: Received) -> Result<Option<String>, HarnessEnd> {
    let invalid = match received {
        Received::Text(text) => match read_message(&text) {
            Ok(content) => return Ok(Some(content)),
            Err(frame) => frame,
        },
        Received::Binary(_) => protocol_error("INVALID_JSON", "binary frames are not supported; send text"),
        Received::Idle => {
            let message = "the session ended after its idle timeout";
            return Err(HarnessEnd::Close(Some(error_frame("SESSION_TIMEOUT", message))));
        }
        Received::Stop(reason) => {
            return Err(HarnessEnd::Close(Some(error_frame("SESSION_ERROR", reason.message()))));
        }
        Received::TooLarge => return Err(HarnessEnd::FrameTooLarge),
        Received::Left | Received::Gone => return Err(HarnessEnd::Gone),
    };
    match send_text(socket, invalid.to_string().into_bytes()).await {
        Ok(()) => Ok(None),
        Err(_) => Err(HarnessEnd::Gone),
    }
}

/// Reads the message of a client: `{"type": "message", "content": TEXT}`. An error is the frame for the client.
fn read_message(text: &str) -> Result<String, Value> {
    let message = openenv_wire::parse_python_json(text)
        .map_err(|reason| protocol_error("INVALID_JSON", &format!("Invalid JSON: {reason}")))?;
    let invalid = |reason: &str| protocol_error("VALIDATION_ERROR", &format!("Invalid message: {reason}"));
    let Value::Object(message) = message else { return Err(invalid("it must be an object")) };
    if message.get("type").and_then(Value::as_str) != Some("message") {
        return Err(invalid("type: must be \"message\""));
    }
    let content = message.get("content").and_then(Value::as_str);
    let content = content.ok_or_else(|| invalid("content: must be a string"))?;
    if content.chars().count() > MAX_MESSAGE_CHARS {
        return Err(invalid(&format!("content: must have at most {MAX_MESSAGE_CHARS} characters")));
    }
    Ok(content.to_owned())
}

/// Returns the frame for an invalid message, after which the connection continues.
fn protocol_error(code: &str, message: &str) -> Value {
    json!({"type": "protocol_error", "data": {"message": message, "code": code}})
}

/// Returns the event after which the session ends.
fn fatal_error(message: &str, now: Millis) -> Value {
    harness_event("error", &json!({"message": message, "recoverable": false}), now)
}
