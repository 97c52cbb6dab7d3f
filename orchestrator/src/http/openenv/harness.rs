//! `/harness`: the language model of the server as OpenEnv's agentic harness (RFC 005 of OpenEnv). Each message of the client is one
//! turn, in which the model acts until its episode is over; `harness_turn` runs it.

use axum::extract::State;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::response::Response;
use clock::Millis;
use llm_policy::{ActionCodec, ChatPolicy, ChatSettings, ObservationFormat, TaskPrompt};
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
use crate::rollouts::Endpoint;
use crate::sessions::{ClientIdentity, Session};

/// Name of the harness in `session_started`.
const HARNESS: &str = "chat";
/// Name whose token budget pays for the calls of all harness sessions.
const BUDGET: &str = "harness";
/// Previous exchanges in the model's conversation, as in `sparring play`.
const HISTORY: usize = 2;
/// Longest message of a client, in characters.
const MAX_MESSAGE_CHARS: usize = 20_000;

/// Query of a harness session: which scenarios it has.
#[derive(Debug, Clone, serde::Deserialize)]
pub(super) struct HarnessQuery {
    task: Option<String>,
    seed: Option<String>,
    run: Option<String>,
}

impl HarnessQuery {
    /// Fields of a reset. Only the first episode has the seed.
    fn fields(&self, is_first: bool) -> Map<String, Value> {
        let seed = self.seed.as_ref().filter(|_| is_first);
        // A text that is no number is reported as an error of the field.
        let seed = seed.map(|text| text.parse::<u64>().map_or_else(|_| json!(text), |seed| json!(seed)));
        let fields = [
            ("task", self.task.as_ref().map(|task| json!(task))),
            ("seed", seed),
            ("run", self.run.as_ref().map(|run| json!(run))),
        ];
        fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
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
        if let Err(message) = self.reset(session).await {
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
            let content = match received {
                Received::Text(text) => match read_message(&text) {
                    Ok(content) => content,
                    Err(frame) => {
                        if send_text(socket, frame.to_string().into_bytes()).await.is_err() {
                            return HarnessEnd::Gone;
                        }
                        continue;
                    }
                },
                Received::Binary(_) => {
                    let frame = protocol_error("INVALID_JSON", "binary frames are not supported; send text");
                    if send_text(socket, frame.to_string().into_bytes()).await.is_err() {
                        return HarnessEnd::Gone;
                    }
                    continue;
                }
                Received::Idle => {
                    let message = "the session ended after its idle timeout";
                    return HarnessEnd::Close(Some(error_frame("SESSION_TIMEOUT", message)));
                }
                Received::Stop(reason) => {
                    return HarnessEnd::Close(Some(error_frame("SESSION_ERROR", reason.message())));
                }
                Received::TooLarge => return HarnessEnd::FrameTooLarge,
                Received::Left | Received::Gone => return HarnessEnd::Gone,
            };
            if session.view().is_ok_and(|view| view.done) {
                if let Err(message) = self.reset(session).await {
                    return HarnessEnd::Close(Some(fatal_error(&message, self.app.clock.now())));
                }
                policy = self.policy(session);
            }
            policy.instruct(&content);
            if let Some(end) = self.run_turn(socket, session, &mut policy, &mut early).await {
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
            for TurnEvent { kind, data } in events.list {
                let frame = harness_event(kind, &data, now).to_string().into_bytes();
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
