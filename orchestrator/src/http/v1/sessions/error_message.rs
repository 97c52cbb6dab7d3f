//! Error messages of sessions.

use env_core::batch::BatchError;
use openenv_wire::{LocSegment, ValidationError};
use serde_json::{Value, json};

use crate::http::problem::{Problem, ProblemParts};
use crate::limits::QuotaExceeded;
use crate::sessions::{ResumeError, SessionError, SessionRequestError, VectorError};
use strict_input::{FieldError, KNOWN_FIELDS};

/// Error that is sent in response to a message. The session goes on unless it `ends_session`.
#[derive(Debug)]
pub(in crate::http) struct ErrorMessage {
    code: String,
    detail: String,
    field: Option<String>,
    retryable: bool,
    /// True if the session has ended.
    pub(super) ends_session: bool,
}

impl ErrorMessage {
    /// Builds an error from its code and a sentence.
    pub(super) fn new(code: &str, detail: impl Into<String>) -> Self {
        Self {
            code: code.to_owned(),
            detail: detail.into(),
            field: None,
            retryable: false,
            ends_session: false,
        }
    }

    /// Error of an invalid field.
    pub(super) fn invalid(field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new("invalid", detail).at(field)
    }

    /// Sets the field at fault.
    pub(super) fn at(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// Adds fields to the list of known ones, if the error is about an unknown field.
    pub(super) fn with_known_fields(mut self, names: &str) -> Self {
        self.detail = self.detail.replace(KNOWN_FIELDS, &format!("{KNOWN_FIELDS} {names},"));
        self
    }

    /// Marks the error as temporary.
    fn retryable(self) -> Self {
        Self { retryable: true, ..self }
    }

    /// Marks the session as ended.
    pub(super) fn ending(self) -> Self {
        Self { ends_session: true, ..self }
    }

    /// Returns the JSON of the error; `id` is the id of the client's message.
    pub(in crate::http) fn to_json(&self, id: Option<u64>) -> Vec<u8> {
        let Self { code, detail, field, retryable, .. } = self;
        let message: Value = json!({
            "type": "error", "id": id, "code": code, "detail": detail, "field": field, "retryable": retryable,
        });
        message.to_string().into_bytes()
    }
}

impl From<FieldError> for ErrorMessage {
    fn from(fault: FieldError) -> Self {
        let field = if fault.field.is_empty() { "message".to_owned() } else { fault.field };
        Self::invalid(field, fault.reason)
    }
}

impl From<SessionRequestError> for ErrorMessage {
    fn from(error: SessionRequestError) -> Self {
        Self::invalid(error.field, error.reason)
    }
}

impl From<QuotaExceeded> for ErrorMessage {
    fn from(full: QuotaExceeded) -> Self {
        Self::new(
            "at_capacity",
            format!("{} of {} sessions are open; close one, or retry later", full.active, full.limit),
        )
        .retryable()
    }
}

impl From<ResumeError> for ErrorMessage {
    fn from(lost: ResumeError) -> Self {
        let code = if lost == ResumeError::Unknown { "unknown_session" } else { "superseded" };
        Self::new(code, lost.to_string()).at("session")
    }
}

impl From<Problem> for ErrorMessage {
    fn from(problem: Problem) -> Self {
        let retryable = problem.retry_after_s().is_some();
        let ProblemParts { code, detail, field } = problem.into_parts();
        Self { code, detail, field, retryable, ends_session: false }
    }
}

/// Error of an invalid action: its first fault, and the number of further faults.
fn action_error(faults: &[ValidationError]) -> ErrorMessage {
    let Some(first) = faults.first() else { return ErrorMessage::invalid("action", "cannot be read") };
    let mut field = "action".to_owned();
    for place in &first.loc {
        field.push('.');
        match place {
            LocSegment::Field(name) => field.push_str(name),
            LocSegment::Index(index) => field.push_str(&index.to_string()),
        }
    }
    let more = match faults.len() {
        1 => String::new(),
        n => format!(" (and {} more errors)", n - 1),
    };
    ErrorMessage::new("invalid_action", format!("{}{more}", first.msg)).at(field)
}

impl From<SessionError> for ErrorMessage {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Action(faults) => action_error(&faults),
            SessionError::Refused(error) => Self::new("invalid_action", error.to_string()).at("action"),
            SessionError::NotStarted => Self::new("not_started", error.to_string()),
            SessionError::OtherEpisode { .. } => Self::new("other_episode", error.to_string()),
            SessionError::Over => Self::new("episode_over", error.to_string()),
            SessionError::Scenario(error) => Self::invalid(error.field().to_owned(), error.reason()),
            SessionError::Service(error) => Problem::from(error).into(),
        }
    }
}

impl From<VectorError> for ErrorMessage {
    fn from(error: VectorError) -> Self {
        let words = error.to_string();
        match error {
            VectorError::Request(error) => error.into(),
            VectorError::Quota(full) => full.into(),
            VectorError::Service(error) => Problem::from(error).into(),
            VectorError::Memory(memory) if memory.is_permanent() => Self::invalid("vector.envs", words),
            VectorError::Memory(_) => Self::new("at_capacity", words).at("vector.envs").retryable(),
            VectorError::Frame(error) => Self::new("invalid_frame", error.reason).at(error.field),
            VectorError::Sequence { .. } => Self::new("out_of_order", words).at("sequence"),
            VectorError::Batch(error) => batch_error(&error),
            VectorError::Lost => Self::new("internal", words).ending(),
        }
    }
}

/// Error of a batch of environments.
fn batch_error(error: &BatchError) -> ErrorMessage {
    let words = error.to_string();
    match error {
        BatchError::Config { field, .. } => ErrorMessage::invalid(format!("vector.{field}"), words),
        BatchError::Unsupported(_) => ErrorMessage::invalid("vector.observe", words),
        BatchError::NotFinite { .. } | BatchError::UnknownAction { .. } => {
            ErrorMessage::new("invalid_frame", words).at("actions")
        }
        BatchError::Ended { .. } => ErrorMessage::new("episode_over", words).at("actions"),
        BatchError::Size { buffer, .. } => ErrorMessage::new("invalid_frame", words).at(*buffer),
        BatchError::Scenario { source, .. } => {
            ErrorMessage::invalid(source.field().to_owned(), words).ending()
        }
    }
}
