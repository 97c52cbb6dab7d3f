//! Flying by requests: `/reset`, `/step` and `/state` of a session that lasts from one to the next.

use axum::Extension;
use axum::extract::State;
use axum::http::header::COOKIE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde_json::{Map, Value};

use super::super::access::Caller;
use super::answer;
use super::body::{self, Body};
use super::read::{Fields, WALK, wish};
use super::refusal::{Refusal, wish_fault};
use crate::http::state::AppState;
use crate::sessions::{MAX_NAME_CHARS, SessionKey, SessionStatus};

/// The header that names a session, and the cookie that does for browsers.
pub(super) const HEADER: &str = "x-session-id";
pub(super) const COOKIE_NAME: &str = "sparring_session";
/// The session of whoever names none.
const SHARED: &str = "shared";

/// Which session a request is for.
pub(super) fn session_name(headers: &HeaderMap, caller: &Caller) -> Result<SessionKey, Refusal> {
    let named = headers.get(HEADER).map(|value| value.to_str().unwrap_or_default().to_owned());
    let name = named.or_else(|| cookie(headers)).unwrap_or_else(|| SHARED.to_owned());
    if name.is_empty() || name.len() > MAX_NAME_CHARS {
        let words = format!("{HEADER}: a session's name is 1 to {MAX_NAME_CHARS} printable characters");
        return Err(Refusal::new(StatusCode::BAD_REQUEST, words));
    }
    Ok(SessionKey::new(&caller.who, name))
}

pub(super) fn cookie(headers: &HeaderMap) -> Option<String> {
    let all = headers.get_all(COOKIE).into_iter().filter_map(|value| value.to_str().ok());
    let mut pairs = all.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value.to_owned())
}

/// Begin an episode. Without a body any scenario of the first task; with one, what it says: `seed`, `episode_id`, `task`,
/// `params`, `physics`, `scenario`, or `run`, `lease_id`, `group_id` for what a curriculum proposes.
#[utoipa::path(
    post, path = "/reset", tag = "openenv", request_body(content = Option<Object>, content_type = "application/json", description = "May be left out."),
    responses(
        (status = 200, body = Object), (status = 404, body = Object), (status = 409, body = Object),
        (status = 408, body = Object), (status = 413, body = Object), (status = 422, body = Object),
        (status = 429, body = Object), (status = 503, body = Object)
    )
)]
pub(super) async fn reset(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, Refusal> {
    let name = session_name(&headers, &caller)?;
    let session = app.sessions.get_or_open(&caller.who, &name)?;
    let mut session = session.lock().await;
    let answer = restart(&mut session, fields.unwrap_or_default(), WALK[0]).await;
    let_go(&app, &name, &session);
    answer
}

/// A session that never flew anything takes nobody's place.
pub(super) fn let_go(app: &AppState, name: &SessionKey, session: &crate::sessions::Session) {
    if session.resets() == 0 {
        app.sessions.close(name);
    }
}

/// Begins an episode; where nobody names a task it is `usual`.
pub(super) async fn restart(
    session: &mut crate::sessions::Session,
    fields: Map<String, Value>,
    usual: &str,
) -> Result<Response, Refusal> {
    let mut fields = Fields::new(&fields, body::place());
    let wish = wish(&mut fields);
    if !fields.faults.is_empty() {
        return Err(Refusal::faults(&fields.faults));
    }
    let name = wish.episode_id.clone();
    let usual = super::usual(usual);
    let wished = wish.resolve(usual).map_err(|error| Refusal::faults(&[wish_fault(&error, &body::place())]))?;
    Ok(answer::observed(&session.reset(wished, name).await?))
}

/// Step the environment: `{"action": …}`, or the action as it is.
#[utoipa::path(
    post, path = "/step", tag = "openenv", request_body(content = Object, content_type = "application/json"),
    responses(
        (status = 200, body = Object), (status = 409, body = Object, description = "Nothing flies, or the episode is over."),
        (status = 408, body = Object), (status = 413, body = Object), (status = 422, body = Object),
        (status = 429, body = Object), (status = 503, body = Object)
    )
)]
pub(super) async fn step(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, Refusal> {
    let name = session_name(&headers, &caller)?;
    let missing = |loc| Refusal::fault("missing", loc, "Field required", Value::Null);
    let action = action(fields.ok_or_else(|| missing(body::place()))?)?;
    let session = app.sessions.get(&name).ok_or(crate::sessions::SessionError::NotStarted)?;
    let mut session = session.lock().await;
    Ok(answer::observed(&session.step(&action).await?))
}

/// The action of a step's body: under `action`, or, as the public kessler-env's README has it, all that is not about the
/// request.
pub(super) fn action(mut body: Map<String, Value>) -> Result<Value, Refusal> {
    let mut fields = Fields::new(&body, body::place());
    // Of what is about the request only faults are told: a step takes microseconds.
    fields.above_zero("timeout_s");
    fields.text("request_id");
    let bare = body.keys().any(|key| !["timeout_s", "request_id", "action"].contains(&key.as_str()));
    match fields.get("action") {
        Some(action) if !action.is_object() => {
            fields.fault("action", "dict_type", "Input should be a valid dictionary", action);
        }
        None if !bare => {
            let input = Value::Object(body.clone());
            fields.fault("action", "missing", "Field required", &input);
        }
        _ => {}
    }
    if !fields.faults.is_empty() {
        return Err(Refusal::faults(&fields.faults));
    }
    if let Some(action) = body.remove("action").filter(|action| !action.is_null()) {
        return Ok(action);
    }
    body.retain(|key, _| !["timeout_s", "request_id", "action"].contains(&key.as_str()));
    Ok(Value::Object(body))
}

/// Where the session stands.
#[utoipa::path(get, path = "/state", tag = "openenv", responses((status = 200, body = Object), (status = 503, body = Object)))]
pub(super) async fn state(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<axum::Json<Value>, Refusal> {
    standing(&app, &session_name(&headers, &caller)?).await
}

/// Where a session of this name stands.
pub(super) async fn standing(app: &AppState, name: &SessionKey) -> Result<axum::Json<Value>, Refusal> {
    let Some(session) = app.sessions.get(name) else {
        // Looking takes nobody's place.
        let (episode_id, steps) = (&*uuid::Uuid::new_v4().to_string(), 0);
        let nothing = SessionStatus { episode_id, steps, scenario: None, run: None, outcome: None };
        return Ok(axum::Json(answer::state(&nothing)));
    };
    let session = session.lock().await;
    Ok(axum::Json(answer::state(&session.status())))
}
