//! The first message: a session is opened, or come back to.

use axum::body::Bytes;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::refusal::Refusal;
use super::{answer, wish};
use crate::input::{InputError, from_value, parse_json};
use crate::http::state::AppState;
use crate::sessions::vector::frame::FRAME_VERSION;
use crate::sessions::{ResumableSession, ResumeError, SessionAttachment, SingleSession, ClientIdentity};

/// A session, and what is said of it.
pub(super) struct Opened {
    pub(super) mooring: SessionAttachment,
    pub(super) text: Vec<u8>,
    /// The first observations of a vector session.
    pub(super) frame: Option<Bytes>,
    /// Whether the client knows how to come back to it, told or not.
    pub(super) known: bool,
}

/// A message: what it is, its number where it has one that can be read, and its other fields.
pub(super) struct Message {
    pub(super) kind: String,
    pub(super) id: Option<u64>,
    pub(super) fields: Map<String, Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Version {
    version: u16,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Resume {
    session: String,
    version: Option<u16>,
}

/// Reads what all messages have.
pub(super) fn message(text: &str) -> Result<Message, (Option<u64>, Refusal)> {
    let read = parse_json(text.as_bytes()).map_err(|unread| match unread {
        InputError::DuplicateKey(fault) => (None, fault.into()),
        InputError::Malformed(why) => {
            let why: String = why.chars().take(200).collect();
            (None, Refusal::new("malformed_json", format!("the message is not JSON: {why}")).at("message"))
        }
    })?;
    let Value::Object(mut fields) = read else {
        return Err((None, Refusal::invalid("message", "it must be an object")));
    };
    let id = fields.get("id").and_then(Value::as_u64);
    match fields.remove("type") {
        Some(Value::String(kind)) => Ok(Message { kind, id, fields }),
        Some(_) => Err((id, Refusal::invalid("type", "it must be a text"))),
        None => Err((id, Refusal::invalid("type", "it is missing"))),
    }
}

/// What a message is that is not known.
pub(super) fn unknown(kind: &str, known: &str) -> Refusal {
    let kind: String = kind.chars().take(60).collect();
    Refusal::new("unknown_type", format!("it is {kind:?}; known are {known}")).at("type")
}

fn spoken(version: u16) -> Result<(), Refusal> {
    if version == FRAME_VERSION {
        return Ok(());
    }
    Err(Refusal::new("version", format!("it is {version}; this server supports {FRAME_VERSION}")).at("version"))
}

/// Opens a session, or comes back to one.
pub(super) async fn begin(app: &AppState, who: &ClientIdentity, text: &str) -> Result<Opened, (Option<u64>, Refusal)> {
    let Message { kind, id, fields } = message(text)?;
    let begun = match kind.as_str() {
        "open" => open(app, who, fields).await,
        "resume" => resume(app, who, fields).await,
        other => Err(unknown(other, "open, resume: the first message opens a session")),
    };
    begun.map_err(|refusal| (id, refusal))
}

async fn open(app: &AppState, who: &ClientIdentity, mut fields: Map<String, Value>) -> Result<Opened, Refusal> {
    let version: Map<_, _> = fields.remove_entry("version").into_iter().collect();
    spoken(from_value::<Version>(Value::Object(version))?.version)?;
    fields.remove("id");
    let vector = fields.remove("vector").filter(|vector| !vector.is_null());
    let wish = wish::wish(fields)?;
    let ttl_s = app.sessions.limits().resume_timeout.as_secs();
    let (session, text, frame) = if let Some(vector) = vector {
        let how = wish::vector(vector)?;
        let vector = app.sessions.open_vector(who, how, wish::sorted(wish)?).await?;
        let (text, frame) = (answer::vector("opened", &vector, ttl_s, None), vector.last_frame().bytes.clone());
        (ResumableSession::Vector(Box::new(vector)), text, Some(frame))
    } else {
        let wished = wish::sorted(wish.clone())?;
        let mut session = app.sessions.open(who)?;
        session.reset(wished, wish.episode_id.clone()).await?;
        let single = SingleSession { session, request: wish, last_reply: None };
        let text = answer::standing("opened", &single, ttl_s, None);
        (ResumableSession::Single(Box::new(single)), text, None)
    };
    let mooring = app.sessions.resumable().register(session, who).ok_or(ResumeError::Unknown)?;
    Ok(Opened { mooring, text, frame, known: false })
}

async fn resume(app: &AppState, who: &ClientIdentity, mut fields: Map<String, Value>) -> Result<Opened, Refusal> {
    fields.remove("id");
    let Resume { session, version } = from_value(Value::Object(fields))?;
    spoken(version.unwrap_or(FRAME_VERSION))?;
    let mut mooring = app.sessions.resumable().resume(&session, who).await?;
    let ttl_s = app.sessions.limits().resume_timeout.as_secs();
    let text = match mooring.session() {
        Some(ResumableSession::Single(single)) => answer::standing("resumed", single, ttl_s, None),
        Some(ResumableSession::Vector(vector)) => answer::vector("resumed", vector, ttl_s, None),
        None => return Err(ResumeError::Unknown.into()),
    };
    Ok(Opened { mooring, text, frame: None, known: true })
}
