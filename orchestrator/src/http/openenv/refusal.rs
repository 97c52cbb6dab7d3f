//! Refusals in the form that openenv-core's server gives them: `{"detail": …}`.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use env_core::wire::{Place, WireFault};
use serde_json::{Value, json};

use super::super::problem::Problem;
use crate::sessions::{Full, SessionError, WishError};

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
    pub(super) fn faults(faults: &[WireFault]) -> Self {
        let detail = json!(faults);
        Self { status: StatusCode::UNPROCESSABLE_ENTITY, detail, retry_after_s: None }
    }

    /// One fault of the body.
    pub(super) fn fault(kind: &'static str, loc: Vec<Place>, msg: &str, input: Value) -> Self {
        Self::faults(&[WireFault { kind, loc, msg: msg.to_owned(), input, ctx: None }])
    }
}

/// A wish that cannot be, as a fault of the place under `at`.
pub(super) fn wish_fault(error: &WishError, at: &[Place]) -> WireFault {
    let mut loc = at.to_vec();
    loc.extend(error.field.split('.').map(|part| Place::Field(part.to_owned())));
    let msg = format!("Value error, {}", error.reason);
    WireFault { kind: "value_error", loc, msg, input: Value::Null, ctx: None }
}

impl From<Full> for Refusal {
    fn from(full: Full) -> Self {
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
            SessionError::Training(error) => {
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
