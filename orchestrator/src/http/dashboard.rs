//! The dashboard: files that npm built (`dashboard/`), part of the binary. A binary built without them says how they are built.

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{Html, IntoResponse, Redirect, Response};
use axum::routing::get;
use rust_embed::{EmbeddedFile, RustEmbed};

use crate::http::state::AppState;

/// What npm built; nothing where it did not.
#[derive(RustEmbed)]
#[folder = "../dashboard/dist/"]
#[allow_missing = true]
struct Built;

const PAGE: &str = "index.html";
/// It loads what is its own, and draws pictures by itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// Files that are named by what is in them never change.
const FOR_EVER: &str = "public, max-age=31536000, immutable";

pub(super) fn routes() -> axum::Router<AppState> {
    axum::Router::new()
        .route("/dashboard", get(|| async { Redirect::permanent("/dashboard/") }))
        .route("/dashboard/", get(index))
        .route("/dashboard/{*file}", get(file))
}

async fn index(headers: HeaderMap) -> Response {
    page(&headers).unwrap_or_else(|| Html(include_str!("not_built.html")).into_response())
}

/// The page; none where it was not built.
pub(super) fn page(headers: &HeaderMap) -> Option<Response> {
    sent(PAGE, headers)
}

async fn file(Path(name): Path<String>, headers: HeaderMap) -> Response {
    sent(&name, &headers).unwrap_or_else(|| super::no_such_file().into_response())
}

/// Encodings in which files lie ready, the smallest first, and how their names end.
const ENCODINGS: [(&str, &str); 2] = [("br", ".br"), ("gzip", ".gz")];

/// A file, as small as the client takes it, or that it has it already.
fn sent(name: &str, headers: &HeaderMap) -> Option<Response> {
    if ENCODINGS.iter().any(|(_, ending)| name.ends_with(ending)) {
        return None; // they are not files of their own
    }
    let plain = Built::get(name)?;
    let kind = HeaderValue::from_str(plain.metadata.mimetype()).ok()?;
    let ready = ENCODINGS.iter().filter(|(encoding, _)| takes(headers, encoding));
    let ready =
        ready.filter_map(|(encoding, ending)| Some((*encoding, Built::get(&format!("{name}{ending}"))?)));
    let (encoding, file) =
        ready.map(|(encoding, file)| (Some(encoding), file)).next().unwrap_or((None, plain));
    let tag = tag(&file);
    let known = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let known =
        known.flat_map(|tags| tags.split(',')).any(|known| known.trim().trim_start_matches("W/") == tag);
    let mut response =
        if known { StatusCode::NOT_MODIFIED.into_response() } else { file.data.into_owned().into_response() };
    let said = response.headers_mut();
    said.insert(header::CONTENT_TYPE, kind);
    said.insert(header::ETAG, HeaderValue::from_str(&tag).ok()?);
    said.insert(header::VARY, HeaderValue::from_static("Accept-Encoding"));
    said.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    let kept = if name.starts_with("assets/") { FOR_EVER } else { "no-cache" };
    said.insert(header::CACHE_CONTROL, HeaderValue::from_static(kept));
    if let Some(encoding) = encoding {
        said.insert(header::CONTENT_ENCODING, HeaderValue::from_static(encoding));
    }
    Some(response)
}

/// A name for what is in a file.
fn tag(file: &EmbeddedFile) -> String {
    let hash = file.metadata.sha256_hash();
    format!("\"{}\"", blake3::Hash::from_bytes(hash).to_hex())
}

/// Whether a client takes an encoding: it names it, and not with q=0.
fn takes(headers: &HeaderMap, encoding: &str) -> bool {
    let said = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    said.flat_map(|said| said.split(',')).any(|part| {
        let mut words = part.split(';').map(str::trim);
        let named = words.next().is_some_and(|name| name.eq_ignore_ascii_case(encoding));
        let refused =
            words.any(|word| word.strip_prefix("q=").and_then(|q| q.parse::<f32>().ok()) == Some(0.0));
        named && !refused
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_taken_as_they_are_asked_for() {
        let asked = |text: &'static str, encoding: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static(text));
            takes(&headers, encoding)
        };
        assert!(asked("gzip, deflate, br", "br"));
        assert!(asked("BR;q=0.5", "br"));
        assert!(!asked("gzip, br;q=0", "br"));
        assert!(!asked("gzip", "br"));
        assert!(!asked("brotli", "br"));
        assert!(!takes(&HeaderMap::new(), "gzip"));
    }
}
