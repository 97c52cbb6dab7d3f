//! The form of answers: JSON, or what a client asks for by `Accept`.

use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use super::problem::Problem;

/// How MessagePack is called.
pub(super) const MESSAGE_PACK: &str = "application/msgpack";
/// How a group a line is called.
pub(super) const LINES: &str = "application/x-ndjson";

/// A form that an answer can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// What is answered where nobody asks for anything else.
    Json,
    /// JSON, one object a line.
    Lines,
    /// MessagePack.
    MessagePack,
}

impl Form {
    /// Whether a media range of `Accept` names it, and how closely: by itself, by its kind, or with all.
    fn named_by(self, range: &str) -> Option<u8> {
        let own: &[&str] = match self {
            Self::Json => &["application/json", "application/problem+json"],
            Self::Lines => &[LINES, "application/ndjson", "application/jsonl"],
            Self::MessagePack => &[MESSAGE_PACK, "application/x-msgpack", "application/vnd.msgpack"],
        };
        if own.contains(&range) {
            return Some(2);
        }
        match (range, self) {
            ("application/*", Self::Json) => Some(1),
            ("*/*", Self::Json) => Some(0),
            _ => None, // whoever takes anything is given what everybody reads
        }
    }
}

/// What is wanted most of what there is; JSON where nothing of it is asked for.
pub(super) fn wanted(headers: &HeaderMap, there_is: &[Form]) -> Form {
    let lines = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let mut best = (0.0, 0, Form::Json);
    for part in lines.flat_map(|line| line.split(',')) {
        let mut words = part.split(';').map(str::trim);
        let range = words.next().unwrap_or_default().to_ascii_lowercase();
        let quality = words.find_map(|word| word.strip_prefix("q=").or_else(|| word.strip_prefix("Q=")));
        let quality: f64 = quality.map_or(1.0, |quality| quality.trim().parse().unwrap_or(0.0));
        for &form in there_is {
            let Some(close) = form.named_by(&range) else { continue };
            if quality > best.0 || (quality >= best.0 && quality > 0.0 && close > best.1) {
                best = (quality, close, form);
            }
        }
    }
    best.2
}

/// JSON as MessagePack.
///
/// # Errors
/// What is no JSON, or cannot be written.
pub(super) fn packed(json: &[u8]) -> anyhow::Result<Vec<u8>> {
    let value: Value = serde_json::from_slice(json)?;
    Ok(rmp_serde::to_vec(&value)?)
}

/// Turns JSON answers of `/v1` into MessagePack where that is asked for, problem details among them.
pub(super) async fn as_asked(request: Request, next: Next) -> Response {
    let asked = request.uri().path().starts_with("/v1/")
        && wanted(request.headers(), &[Form::Json, Form::MessagePack]) == Form::MessagePack;
    let response = next.run(request).await;
    if !asked {
        return response;
    }
    let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    if !kind.is_some_and(|kind| {
        kind.starts_with("application/json") || kind.starts_with("application/problem+json")
    }) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    // What is answered as JSON is in memory already.
    let turned = match to_bytes(body, usize::MAX).await {
        Ok(json) => packed(&json),
        Err(error) => Err(error.into()),
    };
    match turned {
        Ok(bytes) => {
            parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MESSAGE_PACK));
            parts.headers.remove(header::CONTENT_LENGTH);
            Response::from_parts(parts, Body::from(bytes))
        }
        Err(error) => {
            tracing::error!(%error, "An answer could not be turned into MessagePack.");
            Problem::internal().into_response()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(accept: &str) -> Form {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        wanted(&headers, &[Form::Json, Form::Lines, Form::MessagePack])
    }

    #[test]
    fn what_is_wanted_most_is_given_and_json_to_everybody_else() {
        for json in [
            "*/*",
            "application/*",
            "application/json",
            "text/html",
            "",
            "a/b;q=x",
            "application/msgpack;q=0",
        ] {
            assert_eq!(of(json), Form::Json, "{json}");
        }
        for pack in [
            "application/msgpack",
            "Application/X-MsgPack; q=0.5",
            "application/msgpack, */*",
            "*/*, application/msgpack",
            "application/json;q=0.5, application/vnd.msgpack",
        ] {
            assert_eq!(of(pack), Form::MessagePack, "{pack}");
        }
        assert_eq!(of("application/msgpack;q=0.1, application/json;q=0.9"), Form::Json);
        assert_eq!(of("application/x-ndjson"), Form::Lines);
        assert_eq!(wanted(&HeaderMap::new(), &[Form::Json]), Form::Json);
    }
}
