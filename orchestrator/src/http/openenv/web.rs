//! Web mode: a page with a form that resets and steps, and what it asks.

use std::sync::LazyLock;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{Html, IntoResponse, Response};
use env_core::ActionLog;
use env_core::log::Precision;
use serde_json::{Map, Value};

use super::super::access::Caller;
use super::super::dashboard;
use super::answer;
use super::body::Body;
use super::read::WALK;
use super::refusal::Refusal;
use super::simulation::{self, COOKIE_NAME, HEADER};
use crate::http::state::AppState;
use crate::sessions::{SessionKey, SessionError};

/// The page. It asks nothing of any other address.
const PAGE: &str = include_str!("page.html");

static PAGE_WITH_TASKS: LazyLock<String> = LazyLock::new(|| {
    // Each with an action to begin with, in its world's form.
    let option = |task: &'static dyn env_core::TaskSpec| {
        let mut log = ActionLog::new(task.action_space().columns.len(), Precision::F64);
        log.push_entry(0, &[0.1]);
        log.end_step();
        let action = openenv_wire::wire_format(task).write_action(log.step(0)).replace('"', "&quot;");
        format!("<option data-action=\"{action}\">{}</option>", task.id())
    };
    let options = env_core::tasks().map(option);
    PAGE.replace("{{tasks}}", &options.collect::<String>())
});

/// Which web session a request is for: that of its cookie or header, or the one all others share.
pub(super) fn name(headers: &HeaderMap, caller: &Caller) -> Result<SessionKey, Refusal> {
    let named = headers.contains_key(HEADER) || simulation::cookie(headers).is_some();
    if named { simulation::session_name(headers, caller) } else { Ok(SessionKey::new(&caller.who, "web")) }
}

/// The way to the page.
pub(super) async fn home() -> Response {
    (StatusCode::TEMPORARY_REDIRECT, [(header::LOCATION, "/web/")]).into_response()
}

/// The page, with a session of its own: the dashboard's, opened where one plays. Where that was not built it is a form, and where OpenEnv alone
/// is for anybody, since the dashboard asks `/v1`.
pub(super) async fn page(State(app): State<AppState>, headers: HeaderMap) -> Response {
    let form = || {
        let policy =
            "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'";
        ([(header::CONTENT_SECURITY_POLICY, policy)], Html(PAGE_WITH_TASKS.as_str())).into_response()
    };
    let built = if app.openenv_public { None } else { dashboard::page(&headers) };
    let mut response = built.unwrap_or_else(form);
    if simulation::cookie(&headers).is_none() {
        let id = uuid::Uuid::new_v4();
        let cookie = format!("{COOKIE_NAME}={id}; Path=/; SameSite=Strict; HttpOnly");
        if let Ok(cookie) = cookie.parse() {
            response.headers_mut().insert(header::SET_COOKIE, cookie);
        }
    }
    response
}

/// Where the web session stands.
pub(super) async fn state(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<axum::Json<Value>, Refusal> {
    simulation::standing(&app, &name(&headers, &caller)?).await
}

/// Begins an episode: the next task of the original's walk, unless one is named.
pub(super) async fn reset(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, Refusal> {
    let name = name(&headers, &caller)?;
    let session = app.sessions.get_or_open(&caller.who, &name)?;
    let mut session = session.lock().await;
    let walked = WALK[usize::try_from(session.resets()).unwrap_or_default() % WALK.len()];
    let answer = simulation::restart(&mut session, fields.unwrap_or_default(), walked).await;
    simulation::let_go(&app, &name, &session);
    let answer = answer?;
    app.boards.began(&name, &session);
    Ok(answer)
}

/// One step; without an action nobody does anything.
pub(super) async fn step(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, Refusal> {
    let name = name(&headers, &caller)?;
    let fields = fields.filter(|fields| !fields.is_empty());
    let action = fields.map_or_else(|| Ok(Value::Object(Map::new())), simulation::action)?;
    let session = app.sessions.get(&name).ok_or(SessionError::NotStarted)?;
    let mut session = session.lock().await;
    let answer = answer::observed(&session.step(&action).await?);
    app.boards.stepped(&name, &session, &action, app.clock.now());
    Ok(answer)
}
