//! Extractors that reject invalid requests with problem details that name the field.

use axum::extract::rejection::{BytesRejection, PathRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{StatusCode, header};
use env_core::text::shorten;
use serde::de::DeserializeOwned;

use super::problem::Problem;
use crate::limits::constants::BODY_TIMEOUT;
use strict_input::{FieldError, InputError};

/// Longest text of a client that an error repeats, in characters.
const MAX_REPEATED_CHARS: usize = 300;

/// Format of a request body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BodyFormat {
    /// `application/json`, or a type with the suffix `+json`.
    Json,
    /// `application/msgpack` or one of its older names.
    MessagePack,
}

impl BodyFormat {
    /// Returns the name of the format.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Json => "JSON",
            Self::MessagePack => "MessagePack",
        }
    }

    /// Reads the format from the `Content-Type` header.
    fn from_request(request: &Request) -> Result<Self, Problem> {
        let content_type =
            request.headers().get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or("");
        let essence = content_type.split(';').next().unwrap_or("").trim().to_ascii_lowercase();
        match essence.as_str() {
            "application/json" => Ok(Self::Json),
            "application/msgpack" | "application/x-msgpack" | "application/vnd.msgpack" => {
                Ok(Self::MessagePack)
            }
            _ if essence.ends_with("+json") => Ok(Self::Json),
            _ => Err(Problem::new(
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "not_json",
                "The Content-Type must be application/json or application/msgpack.",
            )),
        }
    }
}

/// Request body in its format.
pub(super) struct EncodedBody {
    pub(super) format: BodyFormat,
    pub(super) bytes: axum::body::Bytes,
}

impl<S: Send + Sync> FromRequest<S> for EncodedBody {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let format = BodyFormat::from_request(&request)?;
        check_encoding(&request)?;
        let body = tokio::time::timeout(BODY_TIMEOUT, axum::body::Bytes::from_request(request, state)).await;
        let body = body.map_err(|_| {
            let detail =
                "The body was not received within 20 s; send it without pauses, or in smaller requests.";
            Problem::new(StatusCode::REQUEST_TIMEOUT, "body_timeout", detail)
        })?;
        Ok(Self { format, bytes: body.map_err(body_problem)? })
    }
}

/// Rejects a compressed body, which would otherwise fail as JSON that cannot be parsed.
fn check_encoding(request: &Request) -> Result<(), Problem> {
    let encoding = request.headers().get(header::CONTENT_ENCODING).and_then(|value| value.to_str().ok());
    match encoding.filter(|encoding| !encoding.eq_ignore_ascii_case("identity")) {
        None => Ok(()),
        Some(encoding) => {
            let encoding = shorten(encoding, MAX_REPEATED_CHARS);
            let detail = format!("The body must not be compressed, got the encoding {encoding}.");
            Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "encoded_body", detail)
                .at("Content-Encoding"))
        }
    }
}

/// Extractor of a JSON or MessagePack body.
pub(super) struct Json<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        Self::parse(EncodedBody::from_request(request, state).await?)
    }
}

impl<T: DeserializeOwned> Json<T> {
    /// Parses a body that was received.
    pub(super) fn parse(EncodedBody { format, bytes }: EncodedBody) -> Result<Self, Problem> {
        let value = match format {
            BodyFormat::Json => strict_input::parse_json(&bytes),
            BodyFormat::MessagePack => strict_input::parse_messagepack(&bytes),
        };
        let value = value.map_err(|error| match error {
            InputError::DuplicateKey(error) => invalid(error),
            InputError::Malformed(reason) => Problem::malformed(format, &reason),
        })?;
        parse_value(value).map(Self)
    }
}

/// Name of the field in a problem with the whole body.
pub(super) const BODY: &str = "body";

impl Problem {
    /// Returns the problem of a body that is not in its format.
    pub(super) fn malformed(format: BodyFormat, reason: &str) -> Self {
        let code = match format {
            BodyFormat::Json => "malformed_json",
            BodyFormat::MessagePack => "malformed_msgpack",
        };
        let reason = match reason {
            // Messages of rmp for truncated bytes and for types that JSON does not have.
            _ if reason.contains("failed to fill whole buffer") => "it ends too early".to_owned(),
            _ if reason.contains("newtype struct") => "it has an extension type".to_owned(),
            _ => shorten(reason, MAX_REPEATED_CHARS),
        };
        let detail = format!("The body is not {}: {reason}.", format.name());
        Self::new(StatusCode::BAD_REQUEST, code, detail).at(BODY)
    }
}

/// Converts a parsed body to a request type.
pub(super) fn parse_value<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, Problem> {
    strict_input::from_value(value).map_err(invalid)
}

fn invalid(error: FieldError) -> Problem {
    let field = if error.field.is_empty() { BODY.to_owned() } else { error.field };
    Problem::invalid(field, error.reason)
}

fn body_problem(rejection: BytesRejection) -> Problem {
    let status = axum::response::IntoResponse::into_response(rejection).status();
    if status == StatusCode::PAYLOAD_TOO_LARGE {
        Problem::too_large()
    } else {
        Problem::new(StatusCode::BAD_REQUEST, "unreadable_body", "The body could not be read to its end.")
    }
}

/// Extractor of path segments.
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
    Problem::new(StatusCode::BAD_REQUEST, "bad_path", shorten(&rejection.body_text(), MAX_REPEATED_CHARS))
        .at("path")
}

/// Extractor that rejects any query parameter, for routes without parameters. An ignored parameter would hide a mistake.
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
                "is not a query parameter; this operation has none",
            )
            .at(shorten(name, MAX_REPEATED_CHARS))),
        }
    }
}

/// Extractor of query parameters.
pub(super) struct Query<T>(pub(super) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let bad = |detail: &str| Problem::new(StatusCode::BAD_REQUEST, "bad_query", detail);
        let pairs = axum::extract::Query::<Vec<(String, String)>>::from_request_parts(parts, state).await;
        let axum::extract::Query(pairs) = pairs.map_err(|_| {
            bad("The query must have the form name=value&name=value, percent-encoded.").at("query")
        })?;
        strict_input::from_query_pairs(pairs).map(Self).map_err(|error| bad(&error.reason).at(error.field))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compressed_bodies_are_rejected() {
        let check = |encoding: &str| {
            let request = Request::builder().header(header::CONTENT_ENCODING, encoding);
            check_encoding(&request.body(axum::body::Body::empty()).expect("a request"))
        };
        assert!(check("identity").is_ok());
        let problem = check("gzip").expect_err("a problem");
        assert_eq!(problem.status(), StatusCode::UNSUPPORTED_MEDIA_TYPE);
        assert_eq!(
            problem.message(),
            "Content-Encoding: The body must not be compressed, got the encoding gzip."
        );
    }
}
