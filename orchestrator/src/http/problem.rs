//! Errors as problem details (RFC 9457).

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::engine::error::ServiceError;

/// What went wrong, for programs and for people.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Problem {
    /// A URN that names the kind of problem.
    #[serde(rename = "type")]
    #[schema(example = "urn:sparring:problem:invalid")]
    kind: String,
    /// The HTTP status in words.
    title: String,
    /// The HTTP status.
    status: u16,
    /// One sentence about this occurrence.
    detail: String,
    /// The field at fault, as a dotted path.
    #[serde(skip_serializing_if = "Option::is_none")]
    field: Option<String>,
    #[serde(skip)]
    retry_after_s: Option<u32>,
}

impl Problem {
    /// A problem of a kind.
    pub(super) fn new(status: StatusCode, code: &str, detail: impl Into<String>) -> Self {
        Self {
            kind: format!("urn:sparring:problem:{code}"),
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
            retry_after_s: None,
        }
    }

    /// The same, naming the field at fault.
    pub(super) fn at(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// The HTTP status.
    pub(super) fn status(&self) -> StatusCode {
        StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR)
    }

    /// One sentence, with the field at fault.
    pub(super) fn words(&self) -> String {
        self.field.as_ref().map_or_else(|| self.detail.clone(), |field| format!("{field}: {}", self.detail))
    }

    /// The word for programs, the sentence, and the field at fault.
    pub(super) fn parts(self) -> (String, String, Option<String>) {
        let code = self.kind.rsplit(':').next().unwrap_or_default().to_owned();
        (code, self.detail, self.field)
    }

    /// When to come again, seconds.
    pub(super) const fn retry_after_s(&self) -> Option<u32> {
        self.retry_after_s
    }

    /// The same, asking to come again.
    pub(super) const fn again_in(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self
    }

    /// Something that cannot be: 422 with the field at fault.
    pub(super) fn invalid(field: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid", detail).at(field)
    }

    /// A body beyond what is taken.
    pub(super) fn too_large() -> Self {
        let detail = "The body is larger than 16 MiB; send less at a time.";
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too_large", detail)
    }

    /// A request that took too long. Whether it was done is not known: sending it again is safe.
    pub(super) fn timed_out() -> Self {
        let detail = "The request took longer than a minute and was cut off; sending it again is safe.";
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "timed_out", detail).again_in(5)
    }

    /// Too much of something is under way: "scenarios are being planned on".
    pub(super) fn busy(what: &str) -> Self {
        let detail = format!("Too many {what}; try again in a moment.");
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail).again_in(5)
    }

    /// More wait for groups than may.
    pub(super) fn too_many_polls(most: usize) -> Self {
        let detail = format!("{most} requests wait for groups already; come again when some are answered");
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too_many_polls", detail).again_in(5)
    }

    /// Who asks asks too often; in so many seconds it is fine.
    pub(super) fn too_often(seconds: u32) -> Self {
        let detail = format!("You ask more often than you may; ask again in {seconds} s.");
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too_often", detail).again_in(seconds)
    }

    /// Whether it keeps somebody out.
    pub(super) fn is_denial(&self) -> bool {
        matches!(self.status(), StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN)
    }

    /// Something unexpected. The details are in the log, not in the answer.
    pub(super) fn internal() -> Self {
        Self::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            "Something failed here; the server's log says what.",
        )
    }
}

impl Problem {
    /// The store failed. What is for a while is told, and to be tried again; else the log alone has the words.
    fn of_store(error: &ServiceError) -> Self {
        tracing::error!(error = %error, "A request failed.");
        let unavailable =
            |code, detail: String| Self::new(StatusCode::SERVICE_UNAVAILABLE, code, detail).again_in(5);
        match (error.outage(), error) {
            (Some(outage), _) => unavailable("unavailable", format!("Nothing was changed: {outage}.")),
            (None, ServiceError::NotCommitted { .. }) => {
                let detail = "The change could not be written and was undone; the server's log says why.";
                unavailable("not_committed", detail.to_owned())
            }
            _ => Self::internal(),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = self.status();
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let mut response =
            (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response();
        if status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Some(seconds) = self.retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
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
            E::EvaluationOver(_) => problem(StatusCode::CONFLICT, "evaluation_over"),
            E::UnknownAsk(_) => problem(StatusCode::NOT_FOUND, "unknown_ask"),
            E::Refused(_) => problem(StatusCode::CONFLICT, "refused"),
            E::TooManyAsks(_) => problem(StatusCode::TOO_MANY_REQUESTS, "too_many_asks").again_in(5),
            E::RunExists(_) => problem(StatusCode::CONFLICT, "run_exists").at("id"),
            E::Paused(_) => problem(StatusCode::CONFLICT, "paused"),
            E::ClaimedOtherwise(_) => problem(StatusCode::CONFLICT, "claimed_otherwise"),
            E::AuditDue(_) => problem(StatusCode::CONFLICT, "audit_due"),
            E::LeaseOver { .. } => problem(StatusCode::CONFLICT, "lease_over"),
            E::TooManyLeases(_) | E::TooManyLeasesOfToken(_) => {
                problem(StatusCode::TOO_MANY_REQUESTS, "too_many_leases").again_in(5)
            }
            // Time alone does not mend it.
            E::TooManyRuns(_) => problem(StatusCode::FORBIDDEN, "too_many_runs"),
            E::Busy => problem(StatusCode::TOO_MANY_REQUESTS, "busy").again_in(1),
            E::NotReady => problem(StatusCode::SERVICE_UNAVAILABLE, "not_ready").again_in(1),
            E::Stopping => problem(StatusCode::SERVICE_UNAVAILABLE, "stopping").again_in(5),
            E::Invalid { field, reason } => Self::invalid(field, reason),
            E::NotCommitted { .. } | E::Restore(_) | E::Store(_) => Self::of_store(&error),
        }
    }
}

impl From<crate::store::StoreError> for Problem {
    fn from(error: crate::store::StoreError) -> Self {
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
        Self::invalid(error.field().to_owned(), error.to_string())
    }
}
