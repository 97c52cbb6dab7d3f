//! Refusals in the form that openenv-core's server gives them: `{"detail": …}`.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use openenv_wire::{LocSegment, ValidationError};
use serde_json::{Value, json};

use super::super::problem::Problem;
use crate::sessions::{QuotaExceeded, SessionError, SessionRequestError};

/// A refused request.
#[derive(Debug)]
pub(super) struct Refusal {
    status: StatusCode,
    detail: Value,
    retry_after_s: Option<u32>,
}

impl Refusal {
    /// One sentence.
    pub(super) fn new(status: StatusCode, words: impl Into<String>) -> Self {
        Self { status, detail: Value::String(words.into()), retry_after_s: None }
    }

    /// Faults of a body: 422.
    pub(super) fn faults(faults: &[ValidationError]) -> Self {
        let detail = json!(faults);
        Self { status: StatusCode::UNPROCESSABLE_ENTITY, detail, retry_after_s: None }
    }

    /// One fault of the body.
    pub(super) fn fault(kind: &'static str, loc: Vec<LocSegment>, msg: &str, input: Value) -> Self {
        Self::faults(&[ValidationError { kind, loc, msg: msg.to_owned(), input, ctx: None }])
    }
}

/// A wish that cannot be, as a fault of the place under `at`.
pub(super) fn wish_fault(error: &SessionRequestError, at: &[LocSegment]) -> ValidationError {
    let mut loc = at.to_vec();
    loc.extend(error.field.split('.').map(|part| LocSegment::Field(part.to_owned())));
    let msg = format!("Value error, {}", error.reason);
    ValidationError { kind: "value_error", loc, msg, input: Value::Null, ctx: None }
}

impl From<QuotaExceeded> for Refusal {
    fn from(full: QuotaExceeded) -> Self {
        let mut refusal = Self::new(StatusCode::SERVICE_UNAVAILABLE, full.to_string());
        refusal.retry_after_s = Some(5);
        refusal
    }
}

impl From<SessionError> for Refusal {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Action(faults) => Self::faults(&faults),
            SessionError::NotStarted | SessionError::Over => {
                Self::new(StatusCode::CONFLICT, error.to_string())
            }
            SessionError::Refused(_) | SessionError::Scenario(_) => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string())
            }
            SessionError::Service(error) => {
                let problem = Problem::from(error);
                let retry_after_s = problem.retry_after_s();
                Self { retry_after_s, ..Self::new(problem.status(), problem.words()) }
            }
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let mut response = (self.status, axum::Json(json!({"detail": self.detail}))).into_response();
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}
