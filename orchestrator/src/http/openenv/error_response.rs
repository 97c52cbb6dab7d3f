//! Error responses in the format of openenv-core's server: `{"detail": …}`.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use openenv_wire::{LocSegment, ValidationError};
use serde_json::{Value, json};

use super::super::problem::Problem;
use crate::limits::QuotaExceeded;
use crate::sessions::{SessionError, SessionRequestError};

/// Error response of an OpenEnv route.
#[derive(Debug)]
pub(super) struct ErrorResponse {
    status: StatusCode,
    detail: Value,
    retry_after_s: Option<u32>,
}

impl ErrorResponse {
    /// Creates a response with one sentence.
    pub(super) fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        Self { status, detail: Value::String(detail.into()), retry_after_s: None }
    }

    /// Creates the response of validation errors: status 422.
    pub(super) fn validation(errors: &[ValidationError]) -> Self {
        let detail = json!(errors);
        Self { status: StatusCode::UNPROCESSABLE_ENTITY, detail, retry_after_s: None }
    }

    /// Creates the response of one validation error.
    pub(super) fn single(kind: &'static str, loc: Vec<LocSegment>, msg: &str, input: Value) -> Self {
        Self::validation(&[ValidationError { kind, loc, msg: msg.to_owned(), input, ctx: None }])
    }
}

/// Converts the error of a session request to a validation error at a location.
pub(super) fn request_error(error: &SessionRequestError, location: &[LocSegment]) -> ValidationError {
    let mut loc = location.to_vec();
    loc.extend(error.field.split('.').map(|part| LocSegment::Field(part.to_owned())));
    let msg = format!("Value error, {}", error.reason);
    ValidationError { kind: "value_error", loc, msg, input: Value::Null, ctx: None }
}

impl From<QuotaExceeded> for ErrorResponse {
    fn from(error: QuotaExceeded) -> Self {
        let mut response = Self::new(StatusCode::SERVICE_UNAVAILABLE, error.to_string());
        response.retry_after_s = Some(5);
        response
    }
}

impl From<SessionError> for ErrorResponse {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Action(errors) => Self::validation(&errors),
            SessionError::NotStarted | SessionError::OtherEpisode { .. } | SessionError::Over => {
                Self::new(StatusCode::CONFLICT, error.to_string())
            }
            SessionError::Refused(_) | SessionError::Scenario(_) => {
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string())
            }
            SessionError::Service(error) => {
                let problem = Problem::from(error);
                let retry_after_s = problem.retry_after_s();
                Self { retry_after_s, ..Self::new(problem.status(), problem.message()) }
            }
        }
    }
}

impl IntoResponse for ErrorResponse {
    fn into_response(self) -> Response {
        let mut response = (self.status, axum::Json(json!({"detail": self.detail}))).into_response();
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}
