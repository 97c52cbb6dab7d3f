//! Extractors whose refusals are problem details with the field at fault.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::rejection::{BytesRejection, PathRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{StatusCode, header};
use serde::de::DeserializeOwned;
use tokio::sync::{Semaphore, SemaphorePermit};

use super::problem::Problem;
use crate::reading::{self, Fault, Unread};
use crate::training::TrainingError;

/// How a body is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// `application/json`, and whatever says that it is some.
    Json,
    /// `application/msgpack`.
    MessagePack,
}

impl Form {
    /// What people call it.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Json => "JSON",
            Self::MessagePack => "MessagePack",
        }
    }

    fn of(request: &Request) -> Result<Self, Problem> {
        let kind = request.headers().get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or("");
        let essence = kind.split(';').next().unwrap_or("").trim().to_ascii_lowercase();
        match essence.as_str() {
            "application/json" => Ok(Self::Json),
            "application/msgpack" | "application/x-msgpack" | "application/vnd.msgpack" => {
                Ok(Self::MessagePack)
            }
            _ if essence.ends_with("+json") => Ok(Self::Json),
            _ => Err(Problem::new(
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "not_json",
                "Send JSON, with the header Content-Type: application/json, or MessagePack, with application/msgpack.",
            )),
        }
    }
}

/// A body, and how it is written.
pub(super) struct Bytes(pub(super) Form, pub(super) axum::body::Bytes);

impl<S: Send + Sync> FromRequest<S> for Bytes {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let form = Form::of(&request)?;
        Ok(Self(form, axum::body::Bytes::from_request(request, state).await.map_err(unread)?))
    }
}

/// Bytes up to which a body is read beside any number of others.
const SMALL: u64 = 1 << 20;
/// How long a large body may take to come: as long as it does, it keeps others waiting.
const COMING: Duration = Duration::from_secs(20);

/// Room for the bodies of trainers: what is read into a log or a column is many times its bytes, and memory has a bound.
///
/// Nobody waits for a body that has not come yet, but large ones for large ones.
#[derive(Debug, Clone)]
pub struct Room {
    reading: Arc<Semaphore>,
    parsing: Arc<Semaphore>,
}

impl Room {
    /// For so many large bodies at a time.
    pub(crate) fn new(bodies: usize) -> Self {
        Self { reading: Arc::new(Semaphore::new(bodies)), parsing: Arc::new(Semaphore::new(bodies)) }
    }

    /// A body, once there is room for what is made of it: as long as the permit is held.
    pub(super) async fn body(&self, request: Request) -> Result<(Bytes, SemaphorePermit<'_>), Problem> {
        let length = request.headers().get(header::CONTENT_LENGTH);
        let length = length.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
        let stopping = |_| Problem::from(TrainingError::Stopping);
        let _large = match length {
            Some(length) if length <= SMALL => None,
            _ => Some(self.reading.acquire().await.map_err(stopping)?),
        };
        let body = tokio::time::timeout(COMING, Bytes::from_request(request, &())).await;
        let body = body.map_err(|_| {
            let words = "The body did not come to its end in 20 s; send it at once, or less at a time.";
            Problem::new(StatusCode::REQUEST_TIMEOUT, "slow_body", words)
        })??;
        Ok((body, self.parsing.acquire().await.map_err(stopping)?))
    }
}

/// Does what takes milliseconds beside the threads that answer: whoever waits for a lease needs those.
pub(super) async fn aside<T, F>(work: F) -> Result<T, Problem>
where
    T: Send + 'static,
    F: FnOnce() -> Result<T, Problem> + Send + 'static,
{
    let done = tokio::task::spawn_blocking(work).await;
    done.map_err(|error| Problem::from(TrainingError::invalid(BODY, error.to_string())))?
}

/// A body of JSON or MessagePack.
pub(super) struct Json<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        Self::of(Bytes::from_request(request, state).await?)
    }
}

impl<T: DeserializeOwned> Json<T> {
    /// From a body that was read.
    pub(super) fn of(Bytes(form, body): Bytes) -> Result<Self, Problem> {
        let value = match form {
            Form::Json => reading::value(&body),
            Form::MessagePack => reading::packed_value(&body),
        };
        let value = value.map_err(|error| match error {
            Unread::Twice(fault) => invalid(fault),
            Unread::Malformed(why) => Problem::malformed(form, &why),
        })?;
        read(value).map(Self)
    }
}

/// The field at fault where it is the whole body.
const BODY: &str = "body";

impl Problem {
    /// A body that is not what it says it is.
    pub(super) fn malformed(form: Form, why: &str) -> Self {
        let code = match form {
            Form::Json => "malformed_json",
            Form::MessagePack => "malformed_msgpack",
        };
        let detail = format!("The body is not {}: {}.", form.name(), shorten(why));
        Self::new(StatusCode::BAD_REQUEST, code, detail).at(BODY)
    }
}

/// A body that was read, as `T`.
pub(super) fn read<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, Problem> {
    reading::read(value).map_err(invalid)
}

fn invalid(fault: Fault) -> Problem {
    let field = if fault.field.is_empty() { BODY.to_owned() } else { fault.field };
    Problem::invalid(field, fault.words)
}

fn unread(rejection: BytesRejection) -> Problem {
    let status = axum::response::IntoResponse::into_response(rejection).status();
    if status == StatusCode::PAYLOAD_TOO_LARGE {
        Problem::too_large()
    } else {
        Problem::new(StatusCode::BAD_REQUEST, "unreadable_body", "The body could not be read to its end.")
    }
}

/// What strangers wrote may be long; a message is not.
fn shorten(text: &str) -> String {
    if text.chars().count() <= 300 {
        text.to_owned()
    } else {
        text.chars().take(297).chain("...".chars()).collect()
    }
}

/// Path segments.
pub(super) struct Path<T>(pub(super) T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match axum::extract::Path::<T>::from_request_parts(parts, state).await {
            Ok(axum::extract::Path(value)) => Ok(Self(value)),
            Err(rejection) => Err(bad_path(&rejection)),
        }
    }
}

fn bad_path(rejection: &PathRejection) -> Problem {
    Problem::new(StatusCode::BAD_REQUEST, "bad_path", shorten(&rejection.body_text())).at("path")
}

/// That there is no query, where none is taken: a parameter that does nothing was meant to do something.
pub(super) struct NoQuery;

impl<S: Send + Sync> FromRequestParts<S> for NoQuery {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let name = parts.uri.query().and_then(|query| query.split(['=', '&']).find(|name| !name.is_empty()));
        match name {
            None => Ok(Self),
            Some(name) => Err(Problem::new(
                StatusCode::BAD_REQUEST,
                "bad_query",
                "There is no such parameter: nothing is asked for in the query here.",
            )
            .at(shorten(name))),
        }
    }
}

/// Query parameters.
pub(super) struct Query<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let bad = |detail: &str| Problem::new(StatusCode::BAD_REQUEST, "bad_query", detail);
        let pairs = axum::extract::Query::<Vec<(String, String)>>::from_request_parts(parts, state).await;
        let axum::extract::Query(pairs) = pairs.map_err(|_| {
            bad("The query cannot be read: it is name=value&name=value, percent-encoded.").at("query")
        })?;
        reading::read_words(pairs).map(Self).map_err(|fault| bad(&fault.words).at(fault.field))
    }
}
