//! Middleware that records the requests by which trainers work on runs.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method};
use axum::middleware::Next;
use axum::response::Response;

use crate::http::access::Caller;
use crate::trainer_activity::{MAX_NAME_CHARS, TrainerActivity, TrainerKey, TrainerRequest, TrainerWork};

/// Header by which a trainer names itself, such as `host:pid`.
pub(super) const CLIENT_HEADER: &str = "sparring-client";
/// Route of requests for leases.
const LEASES: &str = "/v1/runs/{run}/leases";
/// Further routes of trainers.
const ROUTES: [&str; 5] = [
    "/v1/runs/{run}/results",
    "/v1/runs/{run}/leases/{lease}/columns",
    "/v1/runs/{run}/leases/{lease}/groups/begin",
    "/v1/runs/{run}/leases/{lease}/renew",
    "/v1/runs/{run}/trajectories/claim",
];

/// Records the duration and the result of a request of a trainer. A handler adds its [`TrainerWork`] to the response.
pub(super) async fn record(
    State(activity): State<Arc<TrainerActivity>>,
    request: Request,
    next: Next,
) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
    let is_lease = route == LEASES;
    if request.method() != Method::POST || !(is_lease || ROUTES.contains(&route)) {
        return next.run(request).await;
    }
    let (key, started) = (key_of(&request), Instant::now());
    let response = next.run(request).await;
    if let Some(key) = key.filter(|_| response.status() != axum::http::StatusCode::NOT_FOUND) {
        let work = response.extensions().get::<TrainerWork>().copied().unwrap_or_default();
        let is_error = !response.status().is_success();
        activity.record(key, TrainerRequest { duration: started.elapsed(), is_lease, is_error, work });
    }
    response
}

/// Returns the trainer of a request; `None` without a caller.
fn key_of(request: &Request) -> Option<TrainerKey> {
    let caller = request.extensions().get::<Caller>()?;
    let run = request.uri().path().strip_prefix("/v1/runs/")?.split('/').next()?;
    Some(TrainerKey {
        run: run.to_owned(),
        client: caller.identity.name.clone(),
        name: client_name(request.headers()),
    })
}

/// Returns the name that a client gives itself, without characters that are not printed.
fn client_name(headers: &HeaderMap) -> Option<String> {
    let text = headers.get(CLIENT_HEADER)?.to_str().ok()?; // visible ASCII
    let name: String = text.trim().chars().take(MAX_NAME_CHARS).collect();
    (!name.is_empty()).then_some(name)
}
