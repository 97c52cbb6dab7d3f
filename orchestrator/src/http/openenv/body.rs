//! Request bodies as FastAPI reads them: JSON by the content type or without one, otherwise text, which no model accepts.

use axum::extract::{FromRequest, Request};
use axum::http::{StatusCode, header};
use futures_util::StreamExt;
use openenv_wire::{LocSegment, ValidationError};
use serde_json::{Map, Value, json};

use super::error_response::ErrorResponse;
use crate::http::content_encoding::check_decoded;
use crate::http::extract::{BYTE_ORDER_MARK, declared_length};
use crate::limits::constants::{BODY_TIMEOUT, MAX_OPENENV_BODY_BYTES};

/// Extractor of a body that is empty or an object.
pub(super) struct Body(pub(super) Option<Map<String, Value>>);

/// Returns the location of errors in the body.
pub(super) fn body_location() -> Vec<LocSegment> {
    vec![LocSegment::Field("body".to_owned())]
}

impl<S: Send + Sync> FromRequest<S> for Body {
    type Rejection = ErrorResponse;

    async fn from_request(request: Request, _: &S) -> Result<Self, ErrorResponse> {
        let content_type =
            request.headers().get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or("");
        let essence = content_type.split(';').next().unwrap_or("").trim().to_ascii_lowercase();
        let is_json = essence.is_empty() || essence == "application/json" || essence.ends_with("+json");
        let bytes = read_body(request).await?;
        if bytes.is_empty() {
            return Ok(Self(None));
        }
        let value = if is_json {
            openenv_wire::parse_python_json(&String::from_utf8_lossy(&bytes))
                .map_err(|error| not_json(&error))?
        } else {
            Value::String(String::from_utf8_lossy(&bytes).into_owned())
        };
        match value {
            Value::Object(fields) => Ok(Self(Some(fields))),
            other => Err(ErrorResponse::single(
                "model_attributes_type",
                body_location(),
                "Input should be a valid dictionary or object to extract fields from",
                openenv_wire::echo_input(&other),
            )),
        }
    }
}

/// Reads a body within its time and size limits, without a byte order mark.
pub(super) async fn read_body(request: Request) -> Result<Vec<u8>, ErrorResponse> {
    check_decoded(request.headers())
        .map_err(|detail| ErrorResponse::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail))?;
    let too_large = || ErrorResponse::new(StatusCode::PAYLOAD_TOO_LARGE, "The body must have at most 1 MiB.");
    if declared_length(request.headers()).is_some_and(|length| length > MAX_OPENENV_BODY_BYTES as u64) {
        return Err(too_large());
    }
    let read = async {
        let (mut bytes, mut body) = (Vec::new(), request.into_body().into_data_stream());
        while let Some(part) = body.next().await {
            let cut_off = |_| {
                ErrorResponse::new(
                    StatusCode::BAD_REQUEST,
                    "The body could not be read to its end; if its encoding is gzip, it must be valid.",
                )
            };
            bytes.extend_from_slice(&part.map_err(cut_off)?);
            if bytes.len() > MAX_OPENENV_BODY_BYTES {
                return Err(too_large());
            }
        }
        if bytes.starts_with(BYTE_ORDER_MARK) {
            bytes.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(bytes)
    };
    let late = |_| {
        ErrorResponse::new(
            StatusCode::REQUEST_TIMEOUT,
            "The body was not received within 20 s; send it without pauses.",
        )
    };
    tokio::time::timeout(BODY_TIMEOUT, read).await.map_err(late)?
}

fn not_json(error: &serde_json::Error) -> ErrorResponse {
    let mut loc = body_location();
    loc.push(LocSegment::Index(error.column().saturating_sub(1)));
    let msg = "JSON decode error".to_owned();
    let ctx = Some(json!({"error": error.to_string()}));
    ErrorResponse::validation(&[ValidationError { kind: "json_invalid", loc, msg, input: json!({}), ctx }])
}
