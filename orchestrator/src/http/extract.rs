//! Extractors that reject invalid requests with problem details that name the field.

use axum::extract::rejection::PathRejection;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use env_core::text::shorten;
use serde::de::DeserializeOwned;

use super::content_encoding::check_decoded;
use super::problem::{MAX_REPEATED_CHARS, Problem};
use crate::limits::constants::{
    BODY_TIMEOUT, BULK_INPUT_LIMITS, MAX_BODY_BYTES, MAX_ORDINARY_BODY_BYTES, ORDINARY_INPUT_LIMITS,
};
use strict_input::{FieldError, InputError, InputLimits, ParsedInput};

/// Mark that some programs write before UTF-8 text.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Format of a request body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyFormat {
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

/// Size class of the request bodies of an operation. Routes of bulk bodies have it as an extension of their requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BodyClass {
    /// Settings, scenarios, and the actions of one episode.
    Ordinary,
    /// Results and columns of many episodes.
    Bulk,
}

impl BodyClass {
    /// Largest body in bytes.
    const fn max_bytes(self) -> usize {
        match self {
            Self::Ordinary => MAX_ORDINARY_BODY_BYTES,
            Self::Bulk => MAX_BODY_BYTES,
        }
    }

    /// Largest content of a body.
    const fn input_limits(self) -> InputLimits {
        match self {
            Self::Ordinary => ORDINARY_INPUT_LIMITS,
            Self::Bulk => BULK_INPUT_LIMITS,
        }
    }
}

/// Request body in its format.
pub(super) struct EncodedBody {
    pub(super) format: BodyFormat,
    pub(super) bytes: axum::body::Bytes,
    pub(super) class: BodyClass,
}

impl<S: Send + Sync> FromRequest<S> for EncodedBody {
    type Rejection = Problem;

    async fn from_request(request: Request, _: &S) -> Result<Self, Problem> {
        let format = BodyFormat::from_request(&request)?;
        check_decoded(request.headers()).map_err(|detail| {
            Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "encoded_body", detail).at("Content-Encoding")
        })?;
        let class = request.extensions().get().copied().unwrap_or(BodyClass::Ordinary);
        // A declared length is checked before any of the body is read.
        if declared_length(request.headers()).is_some_and(|length| length > class.max_bytes() as u64) {
            return Err(Problem::body_too_large(class.max_bytes()));
        }
        let read = axum::body::to_bytes(request.into_body(), class.max_bytes());
        let body = tokio::time::timeout(BODY_TIMEOUT, read).await.map_err(|_| {
            let detail =
                "The body was not received within 20 s; send it without pauses, or in smaller requests.";
            Problem::new(StatusCode::REQUEST_TIMEOUT, "body_timeout", detail)
        })?;
        let bytes = body.map_err(|error| body_problem(&error, class))?;
        Ok(Self { format, bytes: without_byte_order_mark(bytes, format), class })
    }
}

impl EncodedBody {
    /// Parses the body within the limits of its class.
    pub(super) fn parse(self) -> Result<ParsedInput, Problem> {
        let Self { format, bytes, class } = self;
        let parsed = match format {
            BodyFormat::Json => strict_input::parse_json(&bytes, class.input_limits()),
            BodyFormat::MessagePack => strict_input::parse_messagepack(&bytes, class.input_limits()),
        };
        parsed.map_err(|error| match error {
            InputError::Field(error) => invalid(error),
            InputError::Malformed(reason) => Problem::malformed(format, &reason),
            InputError::TooLarge(reason) => Problem::too_large(format!("The body is too large: {reason}.")),
        })
    }
}

/// Returns the length of a body that its request declares. A compressed body has none.
pub(super) fn declared_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// Removes the byte order mark that some programs write before JSON.
fn without_byte_order_mark(bytes: axum::body::Bytes, format: BodyFormat) -> axum::body::Bytes {
    if format == BodyFormat::Json && bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.slice(BYTE_ORDER_MARK.len()..)
    } else {
        bytes
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
    fn parse(body: EncodedBody) -> Result<Self, Problem> {
        let ParsedInput { value, non_finite } = body.parse()?;
        match non_finite.into_iter().next() {
            Some(error) => Err(invalid(error)),
            None => parse_value(value).map(Self),
        }
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

fn body_problem(error: &axum::Error, class: BodyClass) -> Problem {
    let source = std::error::Error::source(error);
    if source.is_some_and(|source| source.is::<http_body_util::LengthLimitError>()) {
        Problem::body_too_large(class.max_bytes())
    } else {
        let detail = "The body could not be read to its end; send all of it, as its headers describe it, and valid gzip if that is its encoding.";
        Problem::new(StatusCode::BAD_REQUEST, "unreadable_body", detail)
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
