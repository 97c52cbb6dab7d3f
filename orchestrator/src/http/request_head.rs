//! Checks and changes of a request's head, before a route or a permission depends on it.

use axum::extract::Request;
use axum::http::{HeaderMap, StatusCode, Uri, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::openenv;
use super::problem::Problem;

/// Rejects a request whose host is unclear: a proxy may have checked another `Host` than the one that the server uses.
pub(super) async fn check_host(request: Request, next: Next) -> Response {
    match host_problem(request.version(), request.headers()) {
        None => next.run(request).await,
        Some(problem) => problem.into_response(),
    }
}

/// Returns the problem of the `Host` headers of a request (RFC 9112, section 3.2). HTTP/1.0 does not require the header.
fn host_problem(version: Version, headers: &HeaderMap) -> Option<Problem> {
    let detail = match headers.get_all(header::HOST).iter().count() {
        1 => return None,
        0 if version < Version::HTTP_11 => return None,
        0 => "must be sent with a request of HTTP/1.1".to_owned(),
        count => format!("must be sent once, got {count} headers"),
    };
    Some(Problem::new(StatusCode::BAD_REQUEST, "bad_host", detail).at("Host"))
}

/// Removes the slash at the end of a path of OpenEnv. Its original server redirects such paths, and clients rely on it.
pub(super) async fn remove_trailing_slash(mut request: Request, next: Next) -> Response {
    if let Some(uri) = without_slash(request.uri()) {
        *request.uri_mut() = uri;
    }
    next.run(request).await
}

/// Returns the URI without the slash at the end of its path, if the path is one of OpenEnv.
fn without_slash(uri: &Uri) -> Option<Uri> {
    let path = uri.path().strip_suffix('/')?;
    if !openenv::PATHS.contains(&path) {
        return None;
    }
    let path_and_query = match uri.query() {
        Some(query) => format!("{path}?{query}"),
        None => path.to_owned(),
    };
    let mut parts = uri.clone().into_parts();
    parts.path_and_query = path_and_query.parse().ok();
    Uri::from_parts(parts).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_slashes_of_openenv_paths_are_removed() {
        let of = |text: &str| without_slash(&text.parse().expect("a URI")).map(|uri| uri.to_string());
        assert_eq!(of("/reset/"), Some("/reset".to_owned()));
        assert_eq!(of("/schema/?task=survival"), Some("/schema?task=survival".to_owned()));
        assert_eq!(of("http://h:1/ws/ui/"), Some("http://h:1/ws/ui".to_owned()));
        for unchanged in ["/", "/reset", "/reset//", "/web/", "/docs/", "/dashboard/", "/v1/runs/"] {
            assert_eq!(of(unchanged), None, "{unchanged}");
        }
    }
}
