//! What is not done, and why, as a message.

use env_core::batch::BatchError;
use openenv_wire::{LocSegment, ValidationError};
use serde_json::{Value, json};

use super::super::super::problem::Problem;
use crate::input::FieldError;
use crate::sessions::{QuotaExceeded, ResumeError, SessionError, VectorError, SessionRequestError};

/// A refused message. The session goes on unless it `ends`.
#[derive(Debug)]
pub(super) struct Refusal {
    code: String,
    detail: String,
    field: Option<String>,
    retryable: bool,
    /// There is no session any more.
    pub(super) ends: bool,
}

impl Refusal {
    pub(super) fn new(code: &str, detail: impl Into<String>) -> Self {
        Self { code: code.to_owned(), detail: detail.into(), field: None, retryable: false, ends: false }
    }

    /// Something that cannot be, with the field at fault.
    pub(super) fn invalid(field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new("invalid", detail).at(field)
    }

    pub(super) fn at(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    fn again(self) -> Self {
        Self { retryable: true, ..self }
    }

    pub(super) fn ending(self) -> Self {
        Self { ends: true, ..self }
    }

    /// The message, about the one of this number.
    pub(super) fn message(&self, id: Option<u64>) -> Vec<u8> {
        let Self { code, detail, field, retryable, .. } = self;
        let told: Value = json!({
            "type": "error", "id": id, "code": code, "detail": detail, "field": field, "retryable": retryable,
        });
        told.to_string().into_bytes()
    }
}

impl From<FieldError> for Refusal {
    fn from(fault: FieldError) -> Self {
        let field = if fault.field.is_empty() { "message".to_owned() } else { fault.field };
        Self::invalid(field, fault.reason)
    }
}

impl From<SessionRequestError> for Refusal {
    fn from(error: SessionRequestError) -> Self {
        Self::invalid(error.field, error.reason)
    }
}

impl From<QuotaExceeded> for Refusal {
    fn from(full: QuotaExceeded) -> Self {
        Self::new("at_capacity", format!("{} of {} sessions are open", full.active, full.limit)).again()
    }
}

impl From<ResumeError> for Refusal {
    fn from(lost: ResumeError) -> Self {
        let code = if lost == ResumeError::Unknown { "unknown_session" } else { "superseded" };
        Self::new(code, lost.to_string()).at("session")
    }
}

impl From<Problem> for Refusal {
    fn from(problem: Problem) -> Self {
        let retryable = problem.retry_after_s().is_some();
        let (code, detail, field) = problem.parts();
        Self { code, detail, field, retryable, ends: false }
    }
}

/// Faults of an action: the first, and how many more there are.
fn action(faults: &[ValidationError]) -> Refusal {
    let Some(first) = faults.first() else { return Refusal::invalid("action", "it cannot be read") };
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
        n => format!(" (and {} more faults)", n - 1),
    };
    Refusal::new("invalid_action", format!("{}{more}", first.msg)).at(field)
}

impl From<SessionError> for Refusal {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Action(faults) => action(&faults),
            SessionError::Refused(error) => Self::new("invalid_action", error.to_string()).at("action"),
            SessionError::NotStarted => Self::new("not_started", error.to_string()),
            SessionError::Over => Self::new("over", error.to_string()),
            SessionError::Scenario(error) => Self::invalid(error.field().to_owned(), error.to_string()),
            SessionError::Service(error) => Problem::from(error).into(),
        }
    }
}

impl From<VectorError> for Refusal {
    fn from(error: VectorError) -> Self {
        let words = error.to_string();
        match error {
            VectorError::Request(error) => error.into(),
            VectorError::Quota(full) => full.into(),
            VectorError::Service(error) => Problem::from(error).into(),
            VectorError::Memory(memory) if memory.is_permanent() => Self::invalid("vector.envs", words),
            VectorError::Memory(_) => Self::new("at_capacity", words).at("vector.envs").again(),
            VectorError::Frame(error) => Self::new("invalid_frame", error.reason).at(error.field),
            VectorError::Sequence { .. } => Self::new("out_of_turn", words).at("sequence"),
            VectorError::Batch(error) => batch(&error),
            VectorError::Lost => Self::new("internal", words).ending(),
        }
    }
}

fn batch(error: &BatchError) -> Refusal {
    let words = error.to_string();
    match error {
        BatchError::Config { field, .. } => Refusal::invalid(format!("vector.{field}"), words),
        BatchError::Unsupported(_) => Refusal::invalid("vector.observe", words),
        BatchError::NotFinite { .. } => Refusal::new("invalid_frame", words).at("actions"),
        BatchError::Ended { .. } => Refusal::new("over", words).at("actions"),
        BatchError::Size { buffer, .. } => Refusal::new("invalid_frame", words).at(*buffer),
        BatchError::Scenario { source, .. } => Refusal::invalid(source.field().to_owned(), words).ending(),
    }
}
