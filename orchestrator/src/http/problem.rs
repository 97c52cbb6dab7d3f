//! Errors as problem details (RFC 9457).

use std::borrow::Cow;

use api_types::ProblemDetails;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use store::{Outage, StoreError};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use crate::engine::error::ServiceError;
use crate::limits::{ConcurrencyError, LimitClosed, RateLimited, TooManyLongPolls};

/// Longest text of a client that an error repeats, in characters.
pub(super) const MAX_REPEATED_CHARS: usize = 300;

/// Error response: problem details, and the time after which the client may retry.
#[derive(Debug, Clone)]
pub struct Problem {
    details: ProblemDetails,
    retry_after_s: Option<u32>,
    /// Outage of the database that caused the problem.
    outage: Option<Outage>,
}

/// Outage behind a response, for the server's knowledge of its database.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReportedOutage(pub(super) Outage);

/// The body of a problem is its details.
impl PartialSchema for Problem {
    fn schema() -> RefOr<Schema> {
        ProblemDetails::schema()
    }
}

impl ToSchema for Problem {
    fn name() -> Cow<'static, str> {
        ProblemDetails::name()
    }
}

/// Parts of a [`Problem`].
pub(super) struct ProblemParts {
    /// Code of the kind of problem, for programs.
    pub(super) code: String,
    pub(super) detail: String,
    pub(super) field: Option<String>,
}

impl Problem {
    /// Creates a problem with a status and a code.
    pub(super) fn new(status: StatusCode, code: &str, detail: impl Into<String>) -> Self {
        let details = ProblemDetails {
            kind: format!("urn:sparring:problem:{code}"),
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
        };
        Self { details, retry_after_s: None, outage: None }
    }

    /// Sets the field that caused the problem.
    pub(super) fn at(mut self, field: impl Into<String>) -> Self {
        self.details.field = Some(field.into());
        self
    }

    /// Returns the HTTP status.
    pub(super) fn status(&self) -> StatusCode {
        StatusCode::from_u16(self.details.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// Returns the detail, with the field if there is one.
    pub(super) fn message(&self) -> String {
        self.details.message_with_field()
    }

    /// Returns the parts of the problem, for protocols with their own error format.
    pub(super) fn into_parts(self) -> ProblemParts {
        let code = self.details.code().to_owned();
        let ProblemDetails { detail, field, .. } = self.details;
        ProblemParts { code, detail, field }
    }

    /// Returns the time after which the client may retry, in seconds.
    pub(super) const fn retry_after_s(&self) -> Option<u32> {
        self.retry_after_s
    }

    /// Sets the `Retry-After` header, in seconds.
    pub(super) const fn with_retry_after(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self
    }

    /// Returns the problem of an invalid field: status 422.
    pub(super) fn invalid(field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid", detail).at(field)
    }

    /// Returns the problem of a body of more than `max_bytes`.
    pub(super) fn body_too_large(max_bytes: usize) -> Self {
        let mib = max_bytes >> 20;
        Self::too_large(format!("The body must have at most {mib} MiB; send it in smaller requests."))
    }

    /// Returns the problem of a body that is too large.
    pub(super) fn too_large(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too_large", detail)
    }

    /// Returns the problem of a request that took too long. The change may have been made; a retry is safe.
    pub(super) fn timed_out() -> Self {
        let detail = "The request exceeded its time limit of one minute; a retry is safe.";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "timed_out", detail).with_retry_after(5)
    }

    /// Returns true if the client was denied access.
    pub(super) fn is_denial(&self) -> bool {
        matches!(self.status(), StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN)
    }

    /// Returns the problem of an unexpected failure. The details are only in the log.
    pub(super) fn internal() -> Self {
        Self::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            "The server failed to handle the request; its log has the reason.",
        )
    }
}

impl Problem {
    /// Returns the problem of a database failure. Temporary failures ask for a retry; the text of others is only in the log.
    fn from_store_failure(error: &ServiceError) -> Self {
        tracing::error!(error = %error, "A request failed.");
        let unavailable = |code, detail: String| {
            Self::new(StatusCode::SERVICE_UNAVAILABLE, code, detail).with_retry_after(5)
        };
        match (error.outage(), error) {
            (Some(outage), _) => {
                let problem = unavailable("unavailable", format!("Nothing was changed: {outage}."));
                Self { outage: Some(outage), ..problem }
            }
            (None, ServiceError::NotCommitted { .. }) => {
                let detail =
                    "The change could not be committed and was undone; the server's log has the reason.";
                unavailable("not_committed", detail.to_owned())
            }
            _ => Self::internal(),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = self.status();
        let body = serde_json::to_vec(&self.details).unwrap_or_default();
        let mut response =
            (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Some(outage) = self.outage {
            response.extensions_mut().insert(ReportedOutage(outage));
        }
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

impl From<ProblemDetails> for Problem {
    /// The problem of another server, without its time to retry.
    fn from(details: ProblemDetails) -> Self {
        Self { details, retry_after_s: None, outage: None }
    }
}

impl From<ServiceError> for Problem {
    fn from(error: ServiceError) -> Self {
        use ServiceError as E;
        let detail = error.to_string();
        let problem = |status, code| Self::new(status, code, detail.clone());
        match error {
            E::UnknownRun(_) => problem(StatusCode::NOT_FOUND, "unknown_run"),
            E::UnknownLease(_) => problem(StatusCode::NOT_FOUND, "unknown_lease"),
            E::UnknownEpisode(_) => problem(StatusCode::NOT_FOUND, "unknown_episode"),
            E::Expired(_) => problem(StatusCode::GONE, "expired"),
            E::UnknownLayout(_) => problem(StatusCode::NOT_FOUND, "unknown_layout"),
            E::UnknownEvaluation(_) => problem(StatusCode::NOT_FOUND, "unknown_evaluation"),
            E::EvaluationEnded(_) => problem(StatusCode::CONFLICT, "evaluation_ended"),
            E::UnknownDesignRequest(_) => problem(StatusCode::NOT_FOUND, "unknown_design_request"),
            E::Refused(_) => problem(StatusCode::CONFLICT, "refused"),
            E::TooManyDesignRequests(_) => {
                problem(StatusCode::TOO_MANY_REQUESTS, "too_many_design_requests").with_retry_after(5)
            }
            E::RunExists(_) => problem(StatusCode::CONFLICT, "run_exists").at("id"),
            E::RunBeingDeleted(_) => problem(StatusCode::CONFLICT, "run_being_deleted").at("id"),
            E::RunNotArchived(_) => problem(StatusCode::CONFLICT, "run_not_archived"),
            E::RunNameMismatch { .. } => problem(StatusCode::CONFLICT, "name_mismatch").at("name"),
            E::Paused(_) => problem(StatusCode::CONFLICT, "paused"),
            E::NotBegun(_) => problem(StatusCode::CONFLICT, "not_begun"),
            E::ColumnsConflict(_) => problem(StatusCode::CONFLICT, "columns_conflict"),
            E::AuditDue(_) => problem(StatusCode::CONFLICT, "audit_due"),
            E::LeaseClosed { .. } => problem(StatusCode::CONFLICT, "lease_closed"),
            E::ForeignLease(_) => problem(StatusCode::FORBIDDEN, "foreign_lease"),
            E::ForeignEvaluation(_) => problem(StatusCode::FORBIDDEN, "foreign_evaluation"),
            E::NotRunMember { .. } => problem(StatusCode::FORBIDDEN, "not_run_member"),
            E::NotRunOwner { .. } | E::RunWithoutOwner(_) => problem(StatusCode::FORBIDDEN, "not_run_owner"),
            E::OwnerNeedsAdmin => problem(StatusCode::FORBIDDEN, "forbidden").at("owner"),
            E::TooManyLeases(_) | E::TooManyLeasesOfPrincipal(_) => {
                problem(StatusCode::TOO_MANY_REQUESTS, "too_many_leases").with_retry_after(5)
            }
            // Waiting does not help, so the status is not 429.
            E::TooManyRuns(_) => problem(StatusCode::FORBIDDEN, "too_many_runs"),
            E::Busy => problem(StatusCode::TOO_MANY_REQUESTS, "busy").with_retry_after(1),
            E::NotReady => problem(StatusCode::SERVICE_UNAVAILABLE, "not_ready").with_retry_after(1),
            E::Stopping => problem(StatusCode::SERVICE_UNAVAILABLE, "stopping").with_retry_after(5),
            E::Invalid { field, reason } => Self::invalid(field, reason),
            E::Store(StoreError::ReadersBusy) => {
                problem(StatusCode::SERVICE_UNAVAILABLE, "busy").with_retry_after(5)
            }
            E::NotCommitted { .. } | E::Restore(_) | E::Store(_) => Self::from_store_failure(&error),
        }
    }
}

impl From<ConcurrencyError> for Problem {
    fn from(error: ConcurrencyError) -> Self {
        match error {
            ConcurrencyError::Overloaded(_) => {
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", error.to_string()).with_retry_after(5)
            }
            ConcurrencyError::Panicked => Self::internal(),
        }
    }
}

impl From<TooManyLongPolls> for Problem {
    fn from(error: TooManyLongPolls) -> Self {
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too_many_polls", error.to_string()).with_retry_after(5)
    }
}

impl From<RateLimited> for Problem {
    fn from(RateLimited { retry_after_s }: RateLimited) -> Self {
        let detail = format!("The request rate limit is exceeded; retry in {retry_after_s} s.");
        Self::new(StatusCode::TOO_MANY_REQUESTS, "rate_limited", detail).with_retry_after(retry_after_s)
    }
}

impl From<LimitClosed> for Problem {
    fn from(_: LimitClosed) -> Self {
        ServiceError::Stopping.into()
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        ServiceError::from(error).into()
    }
}

impl From<sqlx::Error> for Problem {
    fn from(error: sqlx::Error) -> Self {
        ServiceError::from(error).into()
    }
}

impl From<env_core::ScenarioError> for Problem {
    fn from(error: env_core::ScenarioError) -> Self {
        Self::invalid(error.field().to_owned(), error.reason())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn busy_readers_are_temporary() {
        let problem = Problem::from(sqlx::Error::PoolTimedOut);
        let response = problem.into_response();
        assert_eq!(response.status(), StatusCode::SERVICE_UNAVAILABLE);
        assert_eq!(response.headers()[header::RETRY_AFTER], "5");
    }
}
