//! HTTP: a handler parses, calls one use case, and maps the answer.

mod access;
mod answers;
mod column;
mod connections;
mod dashboard;
mod document;
mod extract;
mod health;
mod metrics;
mod openenv;
mod places;
mod polish;
mod polls;
mod problem;
mod room;
mod socket;
pub mod state;
mod turns;
mod v1;

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::http::{HeaderValue, Method, StatusCode, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_swagger_ui::SwaggerUi;

pub use self::access::{Each, Gate};
pub use self::connections::serve;
pub use self::health::Looked;
pub use self::metrics::begin as begin_counting;
pub use self::openenv::Boards;
pub use self::polls::Polls;
pub use self::problem::Problem;
pub use self::room::Room;
pub use self::turns::AllTurns;
use self::state::AppState;
use crate::tokens::redact;

/// Largest request body, bytes.
const MAX_BODY: usize = 16 * 1024 * 1024;
/// Longest time one request may take.
const TIMEOUT: Duration = Duration::from_secs(60);
/// How much longer one may take that waits by itself, for up to a minute.
const WAITING: Duration = Duration::from_secs(30);

/// What the API is, for its document.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "Sparring",
        description = "An adaptive curriculum for agents that fly satellites. A trainer creates a run, \
            leases groups of scenarios, flies them, and reports the actions; the server replays them and decides what \
            comes next. Errors are problem details (RFC 9457) with the field at fault."
    ),
    tags(
        (name = "runs", description = "One agent's training effort each."),
        (name = "leases", description = "Groups of scenarios handed to a trainer for a time."),
        (name = "results", description = "What was flown, scored by replay."),
        (name = "trajectories", description = "What the server itself flies for a run: its policy, and the feed of finished groups."),
        (name = "mastery", description = "What the agent has mastered, and on what evidence."),
        (name = "episodes", description = "Single attempts, and their replay."),
        (name = "failures", description = "Why episodes lose score: the critique, and the failure profile of a run."),
        (name = "designs", description = "Layouts designed for what the agent fails at, and asking for more."),
        (name = "scenarios", description = "Scenarios by hand: validate, bracket, replay."),
        (name = "sessions", description = "Environments on the server, stepped over a WebSocket: one by text, many by binary frames."),
        (name = "openenv", description = "OpenEnv: what openenv-core's clients ask, at the root; sessions over WebSockets at /ws and /mcp."),
        (name = "health", description = "Whether the server lives and is ready."),
    )
)]
struct Document;

/// What a server shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// Everything.
    Whole,
    /// OpenEnv's routes and whether it lives: nothing that is of a run.
    OpenEnv,
}

fn parts(surface: Surface) -> (Router<AppState>, utoipa::openapi::OpenApi) {
    let always = OpenApiRouter::with_openapi(Document::openapi()).merge(health::routes());
    let routes = match surface {
        Surface::Whole => always.merge(metrics::routes()).nest("/v1", v1::routes()),
        Surface::OpenEnv => always,
    };
    let (routes, mut document) = routes.merge(openenv::routes()).split_for_parts();
    document::name_forms(&mut document);
    document::name_roles(&mut document);
    document::name_problems(&mut document);
    (routes, polish::polished(document))
}

/// The API as an OpenAPI 3.1 document.
#[must_use]
pub fn openapi() -> utoipa::openapi::OpenApi {
    parts(Surface::Whole).1
}

/// Its routes.
pub fn router(app: AppState, gate: Arc<Gate>, surface: Surface) -> Router {
    let (routes, mut document) = parts(surface);
    if surface == Surface::OpenEnv {
        let shown = ["openenv", "health"];
        document.tags.iter_mut().for_each(|tags| tags.retain(|tag| shown.contains(&tag.name.as_str())));
    }
    let routes = if surface == Surface::Whole { routes.merge(dashboard::routes()) } else { routes };
    routes
        .merge(SwaggerUi::new("/docs").url("/openapi.json", document))
        .fallback(no_such_route)
        .method_not_allowed_fallback(no_such_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(axum::middleware::from_fn_with_state(gate, access::gate))
        .layer(axum::extract::DefaultBodyLimit::max(MAX_BODY))
        .layer(axum::middleware::from_fn(bounded))
        .layer(axum::middleware::from_fn(answers::as_asked))
        .layer(axum::middleware::from_fn(shielded))
        .layer(axum::middleware::from_fn(metrics::measured))
        .layer(PropagateRequestIdLayer::x_request_id())
        .layer(TraceLayer::new_for_http().make_span_with(span).on_failure(()))
        .layer(SetRequestIdLayer::x_request_id(MakeRequestUuid))
        .with_state(app)
}

/// Refuses bodies that say they are too large before reading them, and cuts off what takes too long.
async fn bounded(request: Request, next: Next) -> Response {
    let length = request.headers().get(header::CONTENT_LENGTH).and_then(|v| v.to_str().ok());
    let too_large =
        length.and_then(|text| text.parse::<usize>().ok()).is_some_and(|length| length > MAX_BODY);
    let persistent = request.version() <= Version::HTTP_11;
    let waits = request.method() == Method::GET && request.uri().path().ends_with("/trajectories");
    let timeout = if waits { TIMEOUT + WAITING } else { TIMEOUT };
    let response = if too_large {
        Problem::too_large().into_response()
    } else {
        let answered = tokio::time::timeout(timeout, next.run(request)).await;
        answered.unwrap_or_else(|_| Problem::timed_out().into_response())
    };
    // Of a body that is too large or too slow the rest is not read: the connection ends with it, and says so.
    let unread = matches!(response.status(), StatusCode::PAYLOAD_TOO_LARGE | StatusCode::REQUEST_TIMEOUT);
    if unread && persistent { cut_off(response) } else { response }
}

/// Says that the connection ends with this.
fn cut_off(mut response: Response) -> Response {
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}

/// Says to browsers what nothing here is for: to be guessed at, framed, kept, or to load what is elsewhere.
async fn shielded(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let policy = if path.starts_with("/docs") {
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"
    } else {
        "default-src 'none'; frame-ancestors 'none'"
    };
    let private = path.starts_with("/v1/");
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    // A page of its own says what it needs.
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(policy));
    if private {
        headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    }
    response
}

fn span(request: &Request) -> tracing::Span {
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
        "There is nothing at this path; /docs lists what there is.",
    )
}

/// A file that is not there.
fn no_such_file() -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "no_such_file", "There is no such file; /dashboard/ has the page.")
}

async fn no_such_method() -> Problem {
    Problem::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "no_such_method",
        "This path does not take this method; /docs lists what it takes.",
    )
}

fn panicked(_: Box<dyn std::any::Any + Send>) -> Response {
    tracing::error!("A request handler panicked; the request was answered with 500.");
    Problem::internal().into_response()
}
