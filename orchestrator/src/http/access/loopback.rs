//! Check of requests to a server without tokens, which answers only this machine.

use std::net::IpAddr;

use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};

use super::super::problem::Problem;

/// Rejects requests that do not address this machine by a loopback name, or that another site's page sends.
///
/// A browser may send requests for a page of another site (DNS rebinding, cross-site requests). Without tokens, only pages
/// and programs of this machine may use the server.
pub(super) fn check_loopback(headers: &HeaderMap, uri: &Uri) -> Result<(), Problem> {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let host = uri.host().or_else(|| text(header::HOST));
    let origin = text(header::ORIGIN).map(|origin| origin.split_once("://").map_or(origin, |(_, host)| host));
    // Only HTTP/1.0 has requests without a host. Browsers always name one, and only this machine reaches the server.
    let has_host = uri.host().is_some() || headers.contains_key(header::HOST);
    if (!has_host || host.is_some_and(is_loopback)) && origin.is_none_or(is_loopback) {
        return Ok(());
    }
    let detail = "The server has no tokens and accepts only local requests. Send the request to 127.0.0.1 or localhost, from no other \
        site, or create a token with `sparring token create`.";
    Err(Problem::new(StatusCode::FORBIDDEN, "loopback_only", detail))
}

/// Returns true if a host, with or without a port, is a loopback name or address.
fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((name, _)) => name,
        None => host.rsplit_once(':').filter(|(name, _)| !name.contains(':')).map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn only_loopback_names_are_accepted() {
        for loopback in [
            "localhost",
            "localhost:8700",
            "LOCALHOST",
            "127.0.0.1:1",
            "127.9.9.9",
            "[::1]:8700",
            "[::1]",
            "::1",
        ] {
            assert!(is_loopback(loopback), "{loopback}");
        }
        for other in [
            "",
            "null",
            "localhost.evil.example",
            "127.0.0.1.evil.example:80",
            "10.0.0.1",
            "0.0.0.0",
            "[::2]:1",
            "evil@127.0.0.1",
        ] {
            assert!(!is_loopback(other), "{other}");
        }
    }

    proptest! {
        /// No host header makes the check panic.
        #[test]
        fn any_host_is_classified(host in ".{0,60}") {
            let loopback = is_loopback(&host);
            prop_assert!(!loopback || host.to_ascii_lowercase().contains("localhost") || host.contains("127.") || host.contains(':'));
        }
    }
}
