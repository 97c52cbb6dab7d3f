//! Decompression of request bodies with `Content-Encoding: gzip`.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use async_compression::tokio::bufread::GzipDecoder;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::Response;
use env_core::text::shorten;
use futures_util::{StreamExt, TryStreamExt};
use tokio_util::io::{ReaderStream, StreamReader};

use super::problem::MAX_REPEATED_CHARS;
use crate::limits::constants::MAX_GZIP_OVERHEAD;

/// Decompresses the body of a request while it is read. The size of a body is limited after it.
pub(super) async fn decompress(mut request: Request, next: Next) -> Response {
    let encodings = content_encodings(request.headers());
    if matches!(&*encodings, [encoding] if matches!(&**encoding, "gzip" | "x-gzip")) {
        let _ = request.headers_mut().remove(header::CONTENT_ENCODING);
        let _ = request.headers_mut().remove(header::CONTENT_LENGTH);
        request = request.map(decompressed);
    }
    next.run(request).await
}

/// Returns the content of a gzip body. The body may have several members (RFC 1952, section 2.2); other bytes after a member
/// are an error. So are more than [`MAX_GZIP_OVERHEAD`] bytes beyond the length of the content: empty members and long headers
/// cost time and have no content.
fn decompressed(body: Body) -> Body {
    let produced = Arc::new(AtomicUsize::new(0));
    let (counted, mut received) = (Arc::clone(&produced), 0);
    let compressed = body.into_data_stream().map(move |part| {
        let part = part.map_err(io::Error::other)?;
        received += part.len();
        if received > counted.load(Ordering::Relaxed).saturating_add(MAX_GZIP_OVERHEAD) {
            return Err(io::Error::other("the compressed body is longer than its content"));
        }
        Ok(part)
    });
    let mut decoder = GzipDecoder::new(StreamReader::new(compressed));
    decoder.multiple_members(true);
    let content = ReaderStream::new(decoder).inspect_ok(move |part| {
        produced.fetch_add(part.len(), Ordering::Relaxed);
    });
    Body::from_stream(content)
}

/// Rejects a body in an encoding that the server does not decode, which would otherwise fail as JSON that cannot be parsed.
/// [`decompress`] has decoded gzip before.
///
/// # Errors
/// Returns the sentence for the client.
pub(super) fn check_decoded(headers: &HeaderMap) -> Result<(), String> {
    let encodings = content_encodings(headers);
    if encodings.is_empty() {
        return Ok(());
    }
    let encodings = shorten(&encodings.join(", "), MAX_REPEATED_CHARS);
    Err(format!("The body has the encoding {encodings}; send it as gzip or without an encoding."))
}

/// Returns the encodings of a body in lower case, in the order in which they were applied, without `identity`.
fn content_encodings(headers: &HeaderMap) -> Vec<String> {
    let mut encodings = Vec::new();
    for value in headers.get_all(header::CONTENT_ENCODING) {
        let list = String::from_utf8_lossy(value.as_bytes()).to_ascii_lowercase();
        encodings.extend(list.split(',').map(|encoding| encoding.trim().to_owned()));
    }
    encodings.retain(|encoding| !encoding.is_empty() && encoding != "identity");
    encodings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(values: &[&str]) -> Result<(), String> {
        let headers = values.iter().map(|value| (header::CONTENT_ENCODING, value.parse().expect("a value")));
        check_decoded(&headers.collect())
    }

    #[test]
    fn unknown_encodings_are_rejected() {
        assert_eq!(check(&[]), Ok(()));
        assert_eq!(check(&["identity"]), Ok(()));
        assert_eq!(check(&["Identity, ", "identity"]), Ok(()));
        let sentence = "The body has the encoding br; send it as gzip or without an encoding.";
        assert_eq!(check(&["BR"]), Err(sentence.to_owned()));
        let sentence = "The body has the encoding gzip, br; send it as gzip or without an encoding.";
        assert_eq!(check(&["gzip", "br"]), Err(sentence.to_owned()));
    }
}
