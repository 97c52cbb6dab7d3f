//! The HTTP interface: routes, middleware, and the conversion between requests and use cases.
//!
//! [`router`] assembles the routes: `v1` is the API of trainers, `openenv` serves the clients of openenv-core, `dashboard`
//! the web page. A handler parses the request, calls one use case, and maps the result; every error is a [`Problem`].
//! `access` authorizes requests, `connections` accepts them, and [`state::AppState`] is what handlers share.
//! Limits are in `crate::limits`, use cases in `runs`, `leases`, `results` and others. Start reading at [`router`].

mod access;
mod blocking;
mod connections;
mod content_encoding;
mod content_negotiation;
mod counted_stream;
mod dashboard;
mod date_header;
mod extract;
mod filters;
#[doc(hidden)]
pub mod fuzzing;
mod health;
mod large_body;
mod metrics;
mod number_column;
mod openapi_annotations;
mod openapi_fixups;
mod openenv;
mod paging;
mod path_ids;
mod problem;
mod readiness;
mod request_head;
mod run_reader;
mod shard_routing;
mod socket;
pub mod state;
mod tls;
mod trainer_requests;
mod v1;

use std::sync::Arc;

use api_types::{VERSION, VERSION_HEADER};
use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use store::Outage;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_swagger_ui::SwaggerUi;

pub use self::access::{AccessConfig, AccessControl};
pub use self::connections::serve;
pub use self::metrics::install_recorder as install_metrics_recorder;
pub use self::openenv::EpisodeBoards;
pub use self::problem::Problem;
use self::problem::ReportedOutage;
pub use self::readiness::ReadinessProbe;
use self::state::AppState;
pub use self::tls::{ServerTls, TlsError, TlsFiles};
use crate::engine::writer::Writer;
use crate::limits::constants::{LONG_POLL_EXTRA_TIMEOUT, REQUEST_TIMEOUT};
use crate::tokens::redact;

/// OpenAPI document without its operations.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "Sparring",
        description = "An adaptive curriculum for agents that fly satellites. A trainer creates a run, \
            leases groups of scenarios, rolls them out, and reports the actions. The server replays the actions and decides which \
            scenarios come next. Errors are problem details (RFC 9457) that name the field at fault."
    ),
    tags(
        (name = "runs", description = "Runs: the training of one agent each."),
        (name = "leases", description = "Groups of scenarios that a trainer may run until a deadline."),
        (name = "results", description = "Reports of episodes, scored by replay."),
        (name = "trajectories", description = "Policies that the server itself rolls out for a run, and the feed of finished groups."),
        (name = "mastery", description = "Mastery of a run's tasks, and its evidence."),
        (name = "episodes", description = "Single episodes and their replays."),
        (name = "failures", description = "Failures of episodes: critiques, and the failure profiles of a run."),
        (name = "designs", description = "Layouts that aim at the agent's failures, and design requests."),
        (name = "curriculum", description = "Strategies of the curriculum, and their settings."),
        (name = "tasks", description = "Tasks of the worlds, with their levels, params and actions."),
        (name = "scenarios", description = "Single scenarios: check, evaluate and roll out."),
        (name = "evaluations", description = "Evaluations of policies on frozen suites, and their comparison."),
        (name = "sessions", description = "Environments on the server, stepped over a WebSocket: one by text messages, many by binary frames."),
        (name = "openenv", description = "Routes of OpenEnv for openenv-core's clients, at the root; sessions over WebSockets at /ws and /mcp."),
        (name = "alerts", description = "Conditions and events of the server and its runs, for operators."),
        (name = "access", description = "Audit log: changes by API requests, and denied requests."),
        (name = "health", description = "Liveness, readiness and metrics of the server."),
    )
)]
struct ApiDocument;

/// Set of routes that a server serves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ApiSurface {
    /// All routes of the server.
    Whole,
    /// OpenEnv's routes and the health probes; nothing that concerns a run.
    OpenEnv,
}

/// Returns the documented routes and their OpenAPI document.
fn documented_routes(surface: ApiSurface) -> (Router<AppState>, utoipa::openapi::OpenApi) {
    let common = OpenApiRouter::with_openapi(ApiDocument::openapi()).merge(health::routes());
    let routes = match surface {
        ApiSurface::Whole => common.merge(metrics::routes()).nest("/v1", v1::routes()),
        ApiSurface::OpenEnv => common,
    };
    let (routes, mut document) = routes.merge(openenv::routes()).split_for_parts();
    openapi_annotations::add_messagepack(&mut document);
    openapi_annotations::add_roles(&mut document);
    openapi_annotations::set_problem_media_type(&mut document);
    (routes, openapi_fixups::apply_fixups(document))
}

/// Returns the OpenAPI 3.1 document of all routes.
#[must_use]
pub fn openapi() -> utoipa::openapi::OpenApi {
    documented_routes(ApiSurface::Whole).1
}

/// Returns the routes of a server with all middleware.
pub fn router(app: AppState, access_control: Arc<AccessControl>, surface: ApiSurface) -> Router {
    let (routes, mut document) = documented_routes(surface);
    if surface == ApiSurface::OpenEnv {
        let visible_tags = ["openenv", "health"];
        document
            .tags
            .iter_mut()
            .for_each(|tags| tags.retain(|tag| visible_tags.contains(&tag.name.as_str())));
    }
    let routes = if surface == ApiSurface::Whole { routes.merge(dashboard::routes()) } else { routes };
    let (clock, trainers, shards) = (app.clock.clone(), Arc::clone(&app.trainers), Arc::clone(&app.shards));
    let routes = routes
        .merge(SwaggerUi::new("/docs").url("/openapi.json", document))
        .fallback(no_such_route)
        .method_not_allowed_fallback(no_such_method)
        .layer(axum::middleware::from_fn(content_encoding::decompress))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(axum::middleware::from_fn_with_state(trainers, trainer_requests::record))
        .layer(axum::middleware::from_fn_with_state(access_control, access::middleware::authorize))
        .layer(axum::middleware::from_fn_with_state(app.writer.clone(), report_outage))
        .layer(axum::middleware::from_fn_with_state(shards, shard_routing::check_shard))
        .layer(axum::middleware::from_fn(limit_request))
        .layer(axum::middleware::from_fn(request_head::check_host))
        .layer(axum::middleware::from_fn(content_negotiation::convert_response))
        .layer(axum::middleware::from_fn(add_common_headers))
        .layer(axum::middleware::from_fn(metrics::record_requests))
        .layer(PropagateRequestIdLayer::x_request_id())
        .layer(TraceLayer::new_for_http().make_span_with(request_span).on_failure(()))
        .layer(SetRequestIdLayer::x_request_id(MakeRequestUuid))
        .with_state(app);
    // The path of a request must be final before it selects a route.
    Router::new()
        .fallback_service(routes)
        .layer(axum::middleware::from_fn(request_head::remove_trailing_slash))
        .layer(axum::middleware::from_fn_with_state(clock, date_header::set_date))
}

/// Applies the request timeout, and closes the connection of a request whose body is not read to its end.
async fn limit_request(request: Request, next: Next) -> Response {
    let persistent = request.version() <= Version::HTTP_11;
    let is_long_poll =
        ["/trajectories", "/trajectories/claim"].iter().any(|end| request.uri().path().ends_with(end));
    let timeout = if is_long_poll { REQUEST_TIMEOUT + LONG_POLL_EXTRA_TIMEOUT } else { REQUEST_TIMEOUT };
    let response = tokio::time::timeout(timeout, next.run(request)).await;
    let response = response.unwrap_or_else(|_| Problem::timed_out().into_response());
    // The rest of a body that is too large or too slow is not read, so the connection cannot be reused.
    let unread = matches!(response.status(), StatusCode::PAYLOAD_TOO_LARGE | StatusCode::REQUEST_TIMEOUT);
    if unread && persistent { close_connection(response) } else { response }
}

/// Announces that the server closes the connection after the response.
fn close_connection(mut response: Response) -> Response {
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}

/// Records an outage that a handler met while it read the database. The writer records those of changes.
async fn report_outage(State(writer): State<Writer>, request: Request, next: Next) -> Response {
    let is_read = matches!(*request.method(), Method::GET | Method::HEAD);
    let response = next.run(request).await;
    if let Some(ReportedOutage(outage)) = response.extensions().get().copied()
        && (is_read || outage == Outage::Damaged)
    {
        writer.health().report_failed_read(outage);
    }
    response
}

/// Adds the version of the server and the security headers: no content sniffing, framing, referrers, foreign resources, or caching of `/v1`. Proxies must
/// neither buffer nor compress event streams, since both delay events.
async fn add_common_headers(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let policy = if path.starts_with("/docs") {
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"
    } else {
        "default-src 'none'; frame-ancestors 'none'"
    };
    let is_private = path.starts_with("/v1/");
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(HeaderName::from_static(VERSION_HEADER), HeaderValue::from_static(VERSION));
    // The dashboard sets a policy of its own.
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(policy));
    let content_type = headers.get(header::CONTENT_TYPE).map(HeaderValue::as_bytes);
    if content_type.is_some_and(|name| name.starts_with(b"text/event-stream")) {
        headers.insert(HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store, no-transform"));
    }
    if is_private {
        headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    }
    response
}

/// Creates the tracing span of a request, without secrets.
fn request_span(request: &Request) -> tracing::Span {
    let id = request.headers().get("x-request-id").and_then(|v| v.to_str().ok()).unwrap_or("");
    let path = request.uri().path();
    let run = path.strip_prefix("/v1/runs/").and_then(|rest| rest.split('/').next());
    let (path, run) = (redact(path), run.map(redact));
    tracing::info_span!("request", method = %request.method(), %path, run = run.as_deref(), request_id = id)
}

async fn no_such_route() -> Problem {
    Problem::new(
        StatusCode::NOT_FOUND,
        "no_such_route",
        "This path does not exist; /docs lists all operations.",
    )
}

/// Returns the problem of an unknown file of the dashboard.
fn no_such_file() -> Problem {
    Problem::new(
        StatusCode::NOT_FOUND,
        "no_such_file",
        "This file does not exist; the dashboard is at /dashboard/.",
    )
}

async fn no_such_method() -> Problem {
    Problem::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "no_such_method",
        "This path does not support this method; /docs lists all operations.",
    )
}

fn panicked(_: Box<dyn std::any::Any + Send>) -> Response {
    tracing::error!("A request handler panicked; the response has status 500.");
    Problem::internal().into_response()
}
