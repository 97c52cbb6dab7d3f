//! Check of requests that a browser sends for a page of another site.

use axum::http::{HeaderMap, Method, StatusCode, header};

use super::super::problem::Problem;

/// Rejects requests that may change something and that a browser sends for a page of another site.
///
/// A browser says so in `Sec-Fetch-Site`. It sends no `Origin` with an image or a form of the other page that it loads by GET, so that
/// GET must change nothing. A request for a WebSocket counts as a change.
pub(super) fn check_cross_site(method: &Method, headers: &HeaderMap) -> Result<(), Problem> {
    let is_cross_site = headers.get("sec-fetch-site").is_some_and(|site| site.as_bytes() == b"cross-site");
    let is_read = method.is_safe() && !headers.contains_key(header::UPGRADE);
    if !is_cross_site || is_read {
        return Ok(());
    }
    let detail = "The request comes from a page of another site. Send it from a program, or from the server's own pages.";
    Err(Problem::new(StatusCode::FORBIDDEN, "cross_site", detail))
}
