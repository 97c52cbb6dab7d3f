//! Requests for other shards: rejected if their path names another shard, passed on to a peer if their body does.

use std::sync::Arc;

use axum::body::HttpBody;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Version};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use store::shard::Shard;

use super::close_connection;
use super::problem::Problem;
use super::state::AppState;
use crate::shards::{ForwardError, SHARD_HEADER, Shards};

/// Resources of `/v1` whose ids begin with a shard.
const SHARDED_RESOURCES: [&str; 3] = ["runs", "evaluations", "layouts"];

/// Rejects a request whose path has an id of another shard, and names the shard of this server in all responses.
pub(super) async fn check_shard(State(shards): State<Arc<Shards>>, request: Request, next: Next) -> Response {
    let Some(own) = shards.own() else { return next.run(request).await };
    let mut response = match shard_of_path(request.uri().path()).filter(|shard| shard != own) {
        None => next.run(request).await,
        Some(other) => {
            let is_unread = request.version() <= Version::HTTP_11 && !request.body().is_end_stream();
            let response = wrong_shard(&other, own).into_response();
            if is_unread { close_connection(response) } else { response }
        }
    };
    if let Ok(name) = HeaderValue::from_str(own.as_str()) {
        response.headers_mut().insert(HeaderName::from_static(SHARD_HEADER), name);
    }
    response
}

/// Returns the shard of the id in a path, if the path has one.
fn shard_of_path(path: &str) -> Option<Shard> {
    let (resource, rest) = path.strip_prefix("/v1/")?.split_once('/')?;
    if !SHARDED_RESOURCES.contains(&resource) {
        return None;
    }
    Shard::of_id(rest.split('/').next()?)
}

/// Returns the problem of a request for another shard.
fn wrong_shard(other: &Shard, own: &Shard) -> Problem {
    let detail = format!(
        "The id begins with the shard {other}, and this server is the shard {own}; send the request to the proxy that routes by \
         shard, or to the server of the shard {other}."
    );
    Problem::new(StatusCode::MISDIRECTED_REQUEST, "other_shard", detail)
}

/// Passes a request on to the server of a shard, if the shard is a peer's and no peer sent the request. Returns `None` if this
/// server answers the request.
///
/// # Errors
/// Returns the problem of the peer, or one with status 503 if the peer does not answer.
pub(super) async fn forward<T: DeserializeOwned>(
    app: &AppState,
    headers: &HeaderMap,
    shard: Option<&Shard>,
    request: ForwardedRequest<'_, impl Serialize + Sync>,
) -> Result<Option<T>, Problem> {
    let Some(peer) = app.shards.forward_target(headers, shard) else { return Ok(None) };
    let ForwardedRequest { method, path, body } = request;
    match app.shards.forward(peer, headers, method, path, body).await {
        Ok(answer) => Ok(Some(answer)),
        Err(ForwardError::Rejected(problem)) => Err(Problem::from(*problem)),
        Err(ForwardError::NoAnswer(shard, error)) => {
            let detail = format!("The shard {shard} did not answer: {error}.");
            Err(Problem::new(StatusCode::SERVICE_UNAVAILABLE, "shard_unavailable", detail)
                .with_retry_after(5))
        }
    }
}

/// Request to pass on.
pub(super) struct ForwardedRequest<'a, B> {
    pub(super) method: Method,
    /// Path with its query.
    pub(super) path: &'a str,
    /// Body; none for GET.
    pub(super) body: Option<&'a B>,
}

impl<'a, B> ForwardedRequest<'a, B> {
    /// A POST request with its body.
    pub(super) const fn post(path: &'a str, body: &'a B) -> Self {
        Self { method: Method::POST, path, body: Some(body) }
    }
}

impl<'a> ForwardedRequest<'a, ()> {
    /// A GET request, which has no body.
    pub(super) const fn get(path: &'a str) -> Self {
        Self { method: Method::GET, path, body: None }
    }
}

/// Returns the one shard that all ids of a request have. An id without a shard is of this server, as are no ids.
///
/// # Errors
/// Returns a problem for the field if the ids have several shards.
pub(super) fn common_shard<'a>(
    field: &str,
    own: &Shard,
    ids: impl IntoIterator<Item = &'a str>,
) -> Result<Shard, Problem> {
    let mut shards = ids.into_iter().map(|id| Shard::of_id(id).unwrap_or_else(|| own.clone()));
    let Some(first) = shards.next() else { return Ok(own.clone()) };
    if shards.all(|shard| shard == first) {
        return Ok(first);
    }
    Err(Problem::invalid(field, "must be of one shard; send a request for each shard"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_have_the_shard_of_their_id() {
        let of = |path| shard_of_path(path).map(|shard| shard.to_string());
        assert_eq!(of("/v1/runs/east.run-1/leases").as_deref(), Some("east"));
        assert_eq!(of("/v1/evaluations/west.eval-7").as_deref(), Some("west"));
        assert_eq!(of("/v1/layouts/west.layout-7").as_deref(), Some("west"));
        for path in [
            "/v1/runs",
            "/v1/runs/",
            "/v1/runs/run-1",
            "/v1/runs/run-1/episodes/a.b",
            "/v1/runs/East.run-1",
            "/v1/suites/a.b",
            "/dashboard/a.b",
        ] {
            assert_eq!(of(path), None, "{path}");
        }
    }

    #[test]
    fn ids_of_several_shards_are_refused() {
        let own: Shard = "own".parse().expect("a shard");
        let of = |ids: &[&str]| {
            let shard = common_shard("runs", &own, ids.iter().copied());
            shard.map(|shard| shard.to_string()).map_err(|problem| problem.message())
        };
        assert_eq!(of(&["a.x", "a.y"]).as_deref(), Ok("a"));
        assert_eq!(of(&["x", "own.y"]).as_deref(), Ok("own"));
        assert_eq!(of(&[]).as_deref(), Ok("own"));
        assert!(of(&["a.x", "b.y"]).is_err());
        assert!(of(&["a.x", "y"]).is_err());
    }
}
