//! Web mode: a page with a form that resets and steps, and its routes.

use std::sync::LazyLock;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{Html, IntoResponse, Response};
use env_core::ActionLog;
use env_core::log::Precision;
use env_core::space::ActionKind;
use serde_json::{Map, Value};

use super::super::access::Caller;
use super::super::dashboard;
use super::body::Body;
use super::error_response::ErrorResponse;
use super::simulation::{self, SESSION_COOKIE, web_session_key};
use super::step_response;
use super::tasks::RESET_ORDER;
use crate::http::state::AppState;
use crate::sessions::SessionError;

/// Template of the page, which loads nothing from other hosts.
const PAGE: &str = include_str!("page.html");

/// Page with the options of all tasks.
static PAGE_WITH_TASKS: LazyLock<String> = LazyLock::new(|| {
    // Each option has an example action in its world's format.
    let option = |task: &'static dyn env_core::TaskSpec| {
        let space = task.action_space();
        let mut log = ActionLog::new(space.dim(), Precision::F64);
        log.push_entry(0, &[if space.kind == ActionKind::Box { 0.1 } else { 0.0 }]);
        log.end_step();
        let action = openenv_wire::wire_format(task).write_action(log.step(0)).replace('"', "&quot;");
        format!("<option data-action=\"{action}\">{}</option>", task.id())
    };
    let options = env_core::tasks().map(option);
    PAGE.replace("{{tasks}}", &options.collect::<String>())
});

/// Redirects to the dashboard, or to OpenEnv's page if OpenEnv's routes are public, since the dashboard needs `/v1`.
pub(super) async fn home(State(app): State<AppState>) -> Response {
    redirect(if app.openenv_public { "/web/" } else { "/dashboard/" })
}

/// Redirects from `/web` to OpenEnv's page.
pub(super) async fn without_slash() -> Response {
    redirect("/web/")
}

fn redirect(page: &'static str) -> Response {
    (StatusCode::TEMPORARY_REDIRECT, [(header::LOCATION, page)]).into_response()
}

/// Returns the page with a session cookie: the dashboard, which opens its play view.
///
/// A simple form replaces it if the dashboard was not built, or if OpenEnv's routes are public, since the dashboard
/// needs `/v1`.
pub(super) async fn page(State(app): State<AppState>, headers: HeaderMap) -> Response {
    let form = || {
        let policy =
            "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'";
        ([(header::CONTENT_SECURITY_POLICY, policy)], Html(PAGE_WITH_TASKS.as_str())).into_response()
    };
    let built = if app.openenv_public { None } else { dashboard::page(&headers) };
    let mut response = built.unwrap_or_else(form);
    if simulation::session_cookie(&headers).is_none() {
        let id = uuid::Uuid::new_v4();
        let cookie = format!("{SESSION_COOKIE}={id}; Path=/; SameSite=Strict; HttpOnly");
        if let Ok(cookie) = cookie.parse() {
            response.headers_mut().insert(header::SET_COOKIE, cookie);
        }
    }
    response
}

/// Returns the state of the web session.
pub(super) async fn state(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<axum::Json<Value>, ErrorResponse> {
    simulation::session_state(&app, &web_session_key(&headers, &caller)?).await
}

/// Begins an episode, of the next task in the reset order unless the request names one.
pub(super) async fn reset(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, ErrorResponse> {
    let name = web_session_key(&headers, &caller)?;
    let session = app.sessions.get_or_open(&caller.identity, &name)?;
    let mut session = session.lock().await;
    let default_task = RESET_ORDER[usize::try_from(session.resets()).unwrap_or_default() % RESET_ORDER.len()];
    let is_own = simulation::names_session(&headers);
    let response =
        simulation::begin_episode(&mut session, fields.unwrap_or_default(), default_task, is_own).await;
    simulation::close_if_unused(&app, &name, &session);
    let response = response?;
    app.episode_boards.show_reset(&name, &session);
    Ok(response)
}

/// Steps the environment. Without an action the step has no command.
pub(super) async fn step(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, ErrorResponse> {
    let name = web_session_key(&headers, &caller)?;
    let fields = fields.filter(|fields| !fields.is_empty());
    let action = fields.map_or_else(|| Ok(Value::Object(Map::new())), simulation::action_from_body)?;
    let session = app.sessions.get(&name).ok_or(SessionError::NotStarted)?;
    let mut session = session.lock().await;
    session.step(&action).await?;
    let response = step_response::http_response(&session)?;
    app.episode_boards.show_step(&name, &session, &action, app.clock.now());
    Ok(response)
}
