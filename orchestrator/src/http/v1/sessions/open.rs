//! First message of a connection: it opens or resumes a session.

use axum::body::Bytes;
use serde::Deserialize;
use serde_json::{Map, Value};
use store::ids::RunId;
use store::shard::Shard;

use super::error_message::ErrorMessage;
use super::{SessionRoute, messages, session_request};
use crate::http::state::AppState;
use crate::limits::constants::ORDINARY_INPUT_LIMITS;
use crate::sessions::vector::frame::FRAME_VERSION;
use crate::sessions::{ClientIdentity, ResumableSession, ResumeError, SessionAttachment, SingleSession};
use strict_input::{InputError, ParsedInput, from_value, parse_json};

/// Fields of an `open` message that a reset does not have.
const OPEN_FIELDS: &str = "version, vector";

/// Opened or resumed session, with the first messages to send.
pub(super) struct OpenedSession {
    /// Attachment of the connection to the session.
    pub(super) attachment: SessionAttachment,
    /// First text message of a connection.
    pub(super) text: Vec<u8>,
    /// Frame with the first observations of a vector session.
    pub(super) frame: Option<Bytes>,
    /// True if the client already has the token to resume the session.
    pub(super) is_resumable: bool,
}

/// Fields of the parsed message.
pub(in crate::http) struct ClientMessage {
    /// Field `type` of the message.
    pub(in crate::http) kind: String,
    /// Field `id`, if it is a number.
    pub(in crate::http) id: Option<u64>,
    /// All fields except `type`.
    pub(in crate::http) fields: Map<String, Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VersionField {
    version: u16,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ResumeFields {
    session: String,
    version: Option<u16>,
}

/// Parses a message and its common fields.
pub(in crate::http) fn parse_message(text: &str) -> Result<ClientMessage, (Option<u64>, ErrorMessage)> {
    let parsed = parse_json(text.as_bytes(), ORDINARY_INPUT_LIMITS);
    let ParsedInput { value: message, non_finite } = parsed.map_err(|error| match error {
        InputError::Field(fault) => (None, fault.into()),
        InputError::TooLarge(why) => (None, ErrorMessage::invalid("message", why)),
        InputError::Malformed(why) => {
            let why: String = why.chars().take(200).collect();
            (
                None,
                ErrorMessage::new("malformed_json", format!("the message must be JSON: {why}")).at("message"),
            )
        }
    })?;
    let Value::Object(mut fields) = message else {
        return Err((None, ErrorMessage::invalid("message", "must be an object")));
    };
    let id = fields.get("id").and_then(Value::as_u64);
    if let Some(fault) = non_finite.into_iter().next() {
        return Err((id, fault.into()));
    }
    match fields.remove("type") {
        Some(Value::String(kind)) => Ok(ClientMessage { kind, id, fields }),
        Some(_) => Err((id, ErrorMessage::invalid("type", "must be a string"))),
        None => Err((id, ErrorMessage::invalid("type", "is required"))),
    }
}

/// Error for a message of an unknown type.
pub(super) fn unknown_type(kind: &str, known: &str) -> ErrorMessage {
    let kind: String = kind.chars().take(60).collect();
    ErrorMessage::new("unknown_type", format!("must be {known}, got {kind:?}")).at("type")
}

/// Checks the version of the protocol.
fn check_version(version: u16) -> Result<(), ErrorMessage> {
    if version == FRAME_VERSION {
        return Ok(());
    }
    Err(ErrorMessage::new("unsupported_version", format!("must be {FRAME_VERSION}, got {version}"))
        .at("version"))
}

/// Opens or resumes a session, by the type of the first message.
pub(super) async fn open_or_resume(
    SessionRoute { app, client, run }: &SessionRoute,
    text: &str,
) -> Result<OpenedSession, (Option<u64>, ErrorMessage)> {
    let ClientMessage { kind, id, mut fields } = parse_message(text)?;
    let opened = match kind.as_str() {
        "open" => match settle_run(app, run.as_ref(), &mut fields) {
            Ok(()) => open(app, client, fields).await,
            Err(error) => Err(error),
        },
        "resume" => resume(app, client, fields).await,
        other => Err(unknown_type(other, "open or resume in the first message")),
    };
    opened.map_err(|error| (id, error))
}

/// Completes the run of a message by that of the path. Rejects a run of another shard, which is not on this server.
fn settle_run(
    app: &AppState,
    run: Option<&RunId>,
    fields: &mut Map<String, Value>,
) -> Result<(), ErrorMessage> {
    let named = fields.get("run").and_then(Value::as_str);
    match (run, named) {
        (Some(run), None) if fields.get("run").is_none_or(Value::is_null) => {
            fields.insert("run".to_owned(), Value::String(run.to_string()));
            Ok(())
        }
        (Some(run), Some(named)) if named != run.as_str() => {
            Err(ErrorMessage::invalid("run", format!("must be {run}, the run of the path, or left out")))
        }
        (None, Some(named)) => match Shard::of_id(named).zip(app.shards.own()) {
            Some((shard, own)) if shard != *own => {
                let words = format!("is on the shard {shard}; connect to /v1/runs/{named}/sessions");
                Err(ErrorMessage::invalid("run", words))
            }
            _ => Ok(()),
        },
        _ => Ok(()),
    }
}

async fn open(
    app: &AppState,
    who: &ClientIdentity,
    mut fields: Map<String, Value>,
) -> Result<OpenedSession, ErrorMessage> {
    let version: Map<_, _> = fields.remove_entry("version").into_iter().collect();
    check_version(from_value::<VersionField>(Value::Object(version))?.version)?;
    fields.remove("id");
    let vector = fields.remove("vector").filter(|vector| !vector.is_null());
    let request = session_request::session_request(fields);
    let request = request.map_err(|error| error.with_known_fields(OPEN_FIELDS))?;
    let ttl_s = app.sessions.limits().resume_timeout.as_secs();
    let (session, text, frame) = if let Some(vector) = vector {
        let settings = session_request::vector_request(vector)?;
        let vector =
            app.sessions.open_vector(who, settings, session_request::episode_source(request).await?).await?;
        let (text, frame) = (
            messages::vector_status_message("opened", &vector, ttl_s, None),
            vector.last_frame().bytes.clone(),
        );
        (ResumableSession::Vector(Box::new(vector)), text, Some(frame))
    } else {
        let source = session_request::episode_source(request.clone()).await?;
        let mut session = app.sessions.open(who)?;
        session.reset(source, request.episode_id.clone()).await?;
        let single = SingleSession { session, request, last_reply: None };
        let text = messages::status_message("opened", &single, ttl_s, None);
        (ResumableSession::Single(Box::new(single)), text, None)
    };
    let attachment = app.sessions.resumable().register(session, who).ok_or(ResumeError::Unknown)?;
    Ok(OpenedSession { attachment, text, frame, is_resumable: false })
}

async fn resume(
    app: &AppState,
    who: &ClientIdentity,
    mut fields: Map<String, Value>,
) -> Result<OpenedSession, ErrorMessage> {
    fields.remove("id");
    let ResumeFields { session, version } = from_value(Value::Object(fields))?;
    check_version(version.unwrap_or(FRAME_VERSION))?;
    let mut attachment = app.sessions.resumable().resume(&session, who).await?;
    let ttl_s = app.sessions.limits().resume_timeout.as_secs();
    let text = match attachment.session() {
        Some(ResumableSession::Single(single)) => messages::status_message("resumed", single, ttl_s, None),
        Some(ResumableSession::Vector(vector)) => {
            messages::vector_status_message("resumed", vector, ttl_s, None)
        }
        None => return Err(ResumeError::Unknown.into()),
    };
    Ok(OpenedSession { attachment, text, frame: None, is_resumable: true })
}
