//! Content negotiation: responses are JSON, or the format that the client requests by `Accept`.

use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use super::problem::Problem;

/// Media type of MessagePack.
pub(super) const MESSAGE_PACK: &str = "application/msgpack";
/// Media type of JSON Lines.
pub(super) const LINES: &str = "application/x-ndjson";

/// Format of a response body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ResponseFormat {
    /// JSON, the default format.
    Json,
    /// JSON Lines: one object on each line.
    Lines,
    /// MessagePack, with the structure of the JSON.
    MessagePack,
}

impl ResponseFormat {
    /// Returns how specifically a media range of `Accept` matches: 2 by its subtype, 1 by its type, 0 by `*/*`.
    fn match_specificity(self, range: &str) -> Option<u8> {
        let media_types: &[&str] = match self {
            Self::Json => &["application/json", "application/problem+json"],
            Self::Lines => &[LINES, "application/ndjson", "application/jsonl"],
            Self::MessagePack => &[MESSAGE_PACK, "application/x-msgpack", "application/vnd.msgpack"],
        };
        if media_types.contains(&range) {
            return Some(2);
        }
        match (range, self) {
            ("application/*", Self::Json) => Some(1),
            ("*/*", Self::Json) => Some(0),
            _ => None, // a wildcard selects JSON only
        }
    }
}

/// Selects the available format that the client prefers, and JSON if it requests none of them.
pub(super) fn negotiate(headers: &HeaderMap, available: &[ResponseFormat]) -> ResponseFormat {
    let lines = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let mut best = (0.0, 0, ResponseFormat::Json);
    for part in lines.flat_map(|line| line.split(',')) {
        let mut words = part.split(';').map(str::trim);
        let range = words.next().unwrap_or_default().to_ascii_lowercase();
        let quality = words.find_map(|word| word.strip_prefix("q=").or_else(|| word.strip_prefix("Q=")));
        let quality: f64 = quality.map_or(1.0, |quality| quality.trim().parse().unwrap_or(0.0));
        for &format in available {
            let Some(specificity) = format.match_specificity(&range) else { continue };
            if quality > best.0 || (quality >= best.0 && quality > 0.0 && specificity > best.1) {
                best = (quality, specificity, format);
            }
        }
    }
    best.2
}

/// Converts JSON to MessagePack.
///
/// # Errors
/// Returns an error if `json` is not JSON or has a value that MessagePack cannot represent.
pub(super) fn json_to_messagepack(json: &[u8]) -> anyhow::Result<Vec<u8>> {
    let value: Value = serde_json::from_slice(json)?;
    Ok(rmp_serde::to_vec(&value)?)
}

/// Middleware that converts JSON responses of `/v1`, problems included, to MessagePack if the client requests it.
pub(super) async fn convert_response(request: Request, next: Next) -> Response {
    let wants_messagepack = request.uri().path().starts_with("/v1/")
        && negotiate(request.headers(), &[ResponseFormat::Json, ResponseFormat::MessagePack])
            == ResponseFormat::MessagePack;
    let response = next.run(request).await;
    if !wants_messagepack {
        return response;
    }
    let media_type = response.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    if !media_type.is_some_and(|name| {
        name.starts_with("application/json") || name.starts_with("application/problem+json")
    }) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    // JSON responses are in memory already, so no limit is needed.
    let converted = match to_bytes(body, usize::MAX).await {
        Ok(json) => json_to_messagepack(&json),
        Err(error) => Err(error.into()),
    };
    match converted {
        Ok(bytes) => {
            parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MESSAGE_PACK));
            parts.headers.remove(header::CONTENT_LENGTH);
            Response::from_parts(parts, Body::from(bytes))
        }
        Err(error) => {
            tracing::error!(%error, "A response could not be converted to MessagePack.");
            Problem::internal().into_response()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn negotiated(accept: &str) -> ResponseFormat {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        negotiate(&headers, &[ResponseFormat::Json, ResponseFormat::Lines, ResponseFormat::MessagePack])
    }

    #[test]
    fn preferred_format_is_selected_and_json_by_default() {
        for json in [
            "*/*",
            "application/*",
            "application/json",
            "text/html",
            "",
            "a/b;q=x",
            "application/msgpack;q=0",
        ] {
            assert_eq!(negotiated(json), ResponseFormat::Json, "{json}");
        }
        for pack in [
            "application/msgpack",
            "Application/X-MsgPack; q=0.5",
            "application/msgpack, */*",
            "*/*, application/msgpack",
            "application/json;q=0.5, application/vnd.msgpack",
        ] {
            assert_eq!(negotiated(pack), ResponseFormat::MessagePack, "{pack}");
        }
        assert_eq!(negotiated("application/msgpack;q=0.1, application/json;q=0.9"), ResponseFormat::Json);
        assert_eq!(negotiated("application/x-ndjson"), ResponseFormat::Lines);
        assert_eq!(negotiate(&HeaderMap::new(), &[ResponseFormat::Json]), ResponseFormat::Json);
    }
}
