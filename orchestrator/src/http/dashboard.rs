//! The dashboard: files that npm builds in `dashboard/` and that the binary embeds. A binary without them explains the build.

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{Html, IntoResponse, Redirect, Response};
use axum::routing::get;
use rust_embed::{EmbeddedFile, RustEmbed};

use crate::http::state::AppState;

/// Embedded files of the dashboard; empty if npm did not build it.
#[derive(RustEmbed)]
#[folder = "../dashboard/dist/"]
#[allow_missing = true]
struct DashboardFiles;

/// Name of the page's file.
const INDEX_FILE: &str = "index.html";
/// Policy of the page, which loads only its own files and draws images itself.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// Caching of files whose name has the hash of their content.
const IMMUTABLE: &str = "public, max-age=31536000, immutable";

pub(super) fn routes() -> axum::Router<AppState> {
    axum::Router::new()
        .route("/dashboard", get(|| async { Redirect::permanent("/dashboard/") }))
        .route("/dashboard/", get(index))
        .route("/dashboard/{*file}", get(file))
}

async fn index(headers: HeaderMap) -> Response {
    page(&headers).unwrap_or_else(|| Html(include_str!("not_built.html")).into_response())
}

/// Returns the page, if the dashboard was built.
pub(super) fn page(headers: &HeaderMap) -> Option<Response> {
    file_response(INDEX_FILE, headers)
}

async fn file(Path(name): Path<String>, headers: HeaderMap) -> Response {
    file_response(&name, &headers).unwrap_or_else(|| super::no_such_file().into_response())
}

/// Encoding in which files are stored compressed.
struct StoredEncoding {
    name: &'static str,
    suffix: &'static str,
}

/// Encodings of compressed files, the smallest first.
const STORED_ENCODINGS: [StoredEncoding; 2] =
    [StoredEncoding { name: "br", suffix: ".br" }, StoredEncoding { name: "gzip", suffix: ".gz" }];

/// Returns a file in the smallest encoding that the client accepts, or 304 if the client has it.
fn file_response(name: &str, headers: &HeaderMap) -> Option<Response> {
    if STORED_ENCODINGS.iter().any(|encoding| name.ends_with(encoding.suffix)) {
        return None; // a compressed file is not served by its own name
    }
    let plain = DashboardFiles::get(name)?;
    let content_type = HeaderValue::from_str(plain.metadata.mimetype()).ok()?;
    let accepted = STORED_ENCODINGS.iter().filter(|encoding| accepts_encoding(headers, encoding.name));
    let mut compressed = accepted.filter_map(|encoding| {
        Some((encoding.name, DashboardFiles::get(&format!("{name}{}", encoding.suffix))?))
    });
    let (encoding, file) = compressed.next().map_or((None, plain), |(encoding, file)| (Some(encoding), file));
    let etag = etag(&file);
    let known = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let known =
        known.flat_map(|tags| tags.split(',')).any(|known| known.trim().trim_start_matches("W/") == etag);
    let mut response =
        if known { StatusCode::NOT_MODIFIED.into_response() } else { file.data.into_owned().into_response() };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, content_type);
    headers.insert(header::ETAG, HeaderValue::from_str(&etag).ok()?);
    headers.insert(header::VARY, HeaderValue::from_static("Accept-Encoding"));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(CONTENT_SECURITY_POLICY));
    let cache_control = if name.starts_with("assets/") { IMMUTABLE } else { "no-cache" };
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(cache_control));
    if let Some(encoding) = encoding {
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static(encoding));
    }
    Some(response)
}

/// Returns the entity tag of a file's content.
fn etag(file: &EmbeddedFile) -> String {
    let hash = file.metadata.sha256_hash();
    format!("\"{}\"", blake3::Hash::from_bytes(hash).to_hex())
}

/// Returns true if a client names an encoding, and not with q=0.
fn accepts_encoding(headers: &HeaderMap, encoding: &str) -> bool {
    let values = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|part| {
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
    fn only_named_encodings_are_accepted() {
        let accepts = |text: &'static str, encoding: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static(text));
            accepts_encoding(&headers, encoding)
        };
        assert!(accepts("gzip, deflate, br", "br"));
        assert!(accepts("BR;q=0.5", "br"));
        assert!(!accepts("gzip, br;q=0", "br"));
        assert!(!accepts("gzip", "br"));
        assert!(!accepts("brotli", "br"));
        assert!(!accepts_encoding(&HeaderMap::new(), "gzip"));
    }
}
