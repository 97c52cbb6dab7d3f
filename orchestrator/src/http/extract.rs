//! Extractors whose refusals are problem details with the field at fault.

use std::time::Duration;

use axum::extract::rejection::{BytesRejection, PathRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{StatusCode, header};
use serde::de::DeserializeOwned;

use super::problem::Problem;
use crate::input::{self, FieldError, InputError};

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

/// How long a body may take to come: as long as a large one does, it keeps others waiting.
pub(super) const COMING: Duration = Duration::from_secs(20);

/// A body, and how it is written.
pub(super) struct Bytes(pub(super) Form, pub(super) axum::body::Bytes);

impl<S: Send + Sync> FromRequest<S> for Bytes {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let form = Form::of(&request)?;
        let body = tokio::time::timeout(COMING, axum::body::Bytes::from_request(request, state)).await;
        let body = body.map_err(|_| {
            let words = "The body did not come to its end in 20 s; send it at once, or less at a time.";
            Problem::new(StatusCode::REQUEST_TIMEOUT, "slow_body", words)
        })?;
        Ok(Self(form, body.map_err(unread)?))
    }
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
            Form::Json => input::parse_json(&body),
            Form::MessagePack => input::parse_messagepack(&body),
        };
        let value = value.map_err(|error| match error {
            InputError::DuplicateKey(fault) => invalid(fault),
            InputError::Malformed(why) => Problem::malformed(form, &why),
        })?;
        read(value).map(Self)
    }
}

/// The field at fault where it is the whole body.
pub(super) const BODY: &str = "body";

impl Problem {
    /// A body that is not what it says it is.
    pub(super) fn malformed(form: Form, why: &str) -> Self {
        let code = match form {
            Form::Json => "malformed_json",
            Form::MessagePack => "malformed_msgpack",
        };
        let why = match why {
            // What rmp says of bytes that end too early, and of types that JSON has not.
            _ if why.contains("failed to fill whole buffer") => "it ends too early".to_owned(),
            _ if why.contains("newtype struct") => "it has an extension type".to_owned(),
            _ => shorten(why),
        };
        let detail = format!("The body is not {}: {why}.", form.name());
        Self::new(StatusCode::BAD_REQUEST, code, detail).at(BODY)
    }
}

/// A body that was read, as `T`.
pub(super) fn read<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, Problem> {
    input::from_value(value).map_err(invalid)
}

fn invalid(fault: FieldError) -> Problem {
    let field = if fault.field.is_empty() { BODY.to_owned() } else { fault.field };
    Problem::invalid(field, fault.reason)
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
        input::from_query_pairs(pairs).map(Self).map_err(|fault| bad(&fault.reason).at(fault.field))
    }
}
