//! Who speaks to a server without tokens: this machine alone.

use std::net::IpAddr;

use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};

use super::super::problem::Problem;

/// A browser that shows somebody else's page may send what that page wants: to whoever listens without tokens only this
/// machine's own pages and programs speak.
pub(super) fn from_here(headers: &HeaderMap, uri: &Uri) -> Result<(), Problem> {
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    let host = uri.host().or_else(|| text(header::HOST)).unwrap_or("");
    let origin = text(header::ORIGIN).map(|origin| origin.split_once("://").map_or(origin, |(_, host)| host));
    if is_here(host) && origin.is_none_or(is_here) {
        return Ok(());
    }
    let detail = "This server has no tokens and speaks to this machine alone: ask it by 127.0.0.1 or localhost, from no other site's \
        page. `sparring token create` makes tokens.";
    Err(Problem::new(StatusCode::FORBIDDEN, "not_from_here", detail))
}

/// Whether a host, with a port or without, is this machine.
fn is_here(host: &str) -> bool {
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
    fn this_machine_is_known_by_its_names() {
        for here in [
            "localhost",
            "localhost:8700",
            "LOCALHOST",
            "127.0.0.1:1",
            "127.9.9.9",
            "[::1]:8700",
            "[::1]",
            "::1",
        ] {
            assert!(is_here(here), "{here}");
        }
        for not in [
            "",
            "null",
            "localhost.evil.example",
            "127.0.0.1.evil.example:80",
            "10.0.0.1",
            "0.0.0.0",
            "[::2]:1",
            "evil@127.0.0.1",
        ] {
            assert!(!is_here(not), "{not}");
        }
    }

    proptest! {
        /// Whatever a client says it asked, what is looked at does not fail.
        #[test]
        fn any_host_is_here_or_not(host in ".{0,60}") {
            let here = is_here(&host);
            prop_assert!(!here || host.to_ascii_lowercase().contains("localhost") || host.contains("127.") || host.contains(':'));
        }
    }
}
