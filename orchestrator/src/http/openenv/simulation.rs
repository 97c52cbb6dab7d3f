//! `/reset`, `/step` and `/state`: a session over single HTTP requests.

use axum::Extension;
use axum::extract::{Query, State};
use axum::http::header::COOKIE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde_json::{Map, Value};

use super::super::access::Caller;
use openenv_wire::LocSegment;

use super::body::{self, Body};
use super::error_response::{ErrorResponse, request_error};
use super::fields::{FieldReader, QueryParams, misplaced_field, read_session_request};
use super::step_response;
use super::tasks::{RESET_ORDER, built_in_task};
use crate::http::state::AppState;
use crate::sessions::{EpisodeSource, MAX_NAME_CHARS, SessionError, SessionKey, SessionStatus};

/// Header that names the session of a request.
pub(super) const SESSION_HEADER: &str = "x-session-id";
/// Cookie that names the session of a browser.
pub(super) const SESSION_COOKIE: &str = "sparring_session";
/// Session of requests that name none.
const SHARED_SESSION: &str = "shared";

/// Returns the key of the session that a request names.
pub(super) fn session_key(headers: &HeaderMap, caller: &Caller) -> Result<SessionKey, ErrorResponse> {
    let named = headers.get(SESSION_HEADER).map(|value| value.to_str().unwrap_or_default().to_owned());
    let name = named.or_else(|| session_cookie(headers)).unwrap_or_else(|| SHARED_SESSION.to_owned());
    if name.is_empty() || name.len() > MAX_NAME_CHARS {
        let detail = format!("{SESSION_HEADER}: must be 1 to {MAX_NAME_CHARS} printable characters");
        return Err(ErrorResponse::new(StatusCode::BAD_REQUEST, detail));
    }
    Ok(SessionKey::new(&caller.identity, name))
}

/// Returns the key of the web session that a request names, by header or cookie, or of the shared web session.
pub(super) fn web_session_key(headers: &HeaderMap, caller: &Caller) -> Result<SessionKey, ErrorResponse> {
    if names_session(headers) {
        session_key(headers, caller)
    } else {
        Ok(SessionKey::new(&caller.identity, "web"))
    }
}

/// Returns true if a request names its session, by header or by the cookie of a browser.
pub(super) fn names_session(headers: &HeaderMap) -> bool {
    headers.contains_key(SESSION_HEADER) || session_cookie(headers).is_some()
}

/// Returns the value of the session cookie.
pub(super) fn session_cookie(headers: &HeaderMap) -> Option<String> {
    let all = headers.get_all(COOKIE).into_iter().filter_map(|value| value.to_str().ok());
    let mut pairs = all.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == SESSION_COOKIE).map(|(_, value)| value.to_owned())
}

/// Reset the environment to a new episode.
///
/// Without a body the episode has a random scenario of the first task. The body selects a scenario by `seed`,
/// `episode_id`, `task`, `params`, `physics` and `scenario`, or by `run`, `lease_id` and `group_id` from a curriculum.
#[utoipa::path(
    post, path = "/reset", tag = "openenv", request_body(content = Option<Object>, content_type = "application/json", description = "Optional."),
    responses(
        (status = 200, body = Object), (status = 404, body = Object), (status = 409, body = Object),
        (status = 408, body = Object), (status = 413, body = Object), (status = 415, body = Object), (status = 422, body = Object),
        (status = 429, body = Object), (status = 503, body = Object)
    )
)]
pub(super) async fn reset_environment(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Query(query): Query<QueryParams>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, ErrorResponse> {
    if let Some(reason) = misplaced_field(&query) {
        let location = vec![LocSegment::Field("query".to_owned())];
        return Err(ErrorResponse::single(
            "value_error",
            location,
            &format!("Value error, {reason}"),
            Value::Null,
        ));
    }
    let name = session_key(&headers, &caller)?;
    let session = app.sessions.get_or_open(&caller.identity, &name)?;
    let mut session = session.lock().await;
    // A cookie is shared by all requests of a client, so it does not tell its rollouts apart.
    let is_own = headers.contains_key(SESSION_HEADER);
    let response = begin_episode(&mut session, fields.unwrap_or_default(), RESET_ORDER[0], is_own).await;
    close_if_unused(&app, &name, &session);
    response
}

/// Closes a session that never had an episode, so that it does not use the quota.
pub(super) fn close_if_unused(app: &AppState, name: &SessionKey, session: &crate::sessions::Session) {
    if session.resets() == 0 {
        app.sessions.close(name);
    }
}

/// Begins an episode. The task is `default_task` if the request names none. Only a session that the client does not share
/// (`is_own`) runs episodes of a run: in a shared one, the steps of two rollouts would alternate in one log.
pub(super) async fn begin_episode(
    session: &mut crate::sessions::Session,
    fields: Map<String, Value>,
    default_task: &str,
    is_own: bool,
) -> Result<Response, ErrorResponse> {
    let mut fields = FieldReader::new(&fields, body::body_location());
    let request = read_session_request(&mut fields);
    if !fields.errors.is_empty() {
        return Err(ErrorResponse::validation(&fields.errors));
    }
    let name = request.episode_id.clone();
    let resolved = request
        .resolve(built_in_task(default_task))
        .await
        .map_err(|error| ErrorResponse::validation(&[request_error(&error, &body::body_location())]))?;
    if !is_own && !matches!(resolved, EpisodeSource::Scenario(_)) {
        let location =
            vec![LocSegment::Field("header".to_owned()), LocSegment::Field("X-Session-Id".to_owned())];
        let message = "an episode of a run needs a session of its own: send the header X-Session-Id with a name of your \
                       choice, another one for each rollout, and send it with each step";
        return Err(ErrorResponse::single("missing", location, message, Value::Null));
    }
    session.reset(resolved, name).await?;
    Ok(step_response::http_response(session)?)
}

/// Step the environment by `{"action": …}` or by the fields of the action.
///
/// With `episode_id`, the id of a reset, the step is refused if another client has reset the session since.
#[utoipa::path(
    post, path = "/step", tag = "openenv", request_body(content = Object, content_type = "application/json"),
    responses(
        (status = 200, body = Object), (status = 409, body = Object, description = "No episode is running, or another one than `episode_id`; reset first."),
        (status = 408, body = Object), (status = 413, body = Object), (status = 415, body = Object), (status = 422, body = Object),
        (status = 429, body = Object), (status = 503, body = Object)
    )
)]
pub(super) async fn step_environment(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Body(fields): Body,
) -> Result<Response, ErrorResponse> {
    let name = session_key(&headers, &caller)?;
    let missing = |loc| ErrorResponse::single("missing", loc, "Field required", Value::Null);
    let mut fields = fields.ok_or_else(|| missing(body::body_location()))?;
    let named = fields.get("episode_id").and_then(Value::as_str).map(str::to_owned);
    if named.is_some() {
        fields.remove("episode_id");
    }
    let action = action_from_body(fields)?;
    let session = app.sessions.get(&name).ok_or(SessionError::NotStarted)?;
    let mut session = session.lock().await;
    let running = session.status().episode_id;
    if let Some(named) = named.filter(|named| named != running) {
        return Err(SessionError::OtherEpisode { running: running.to_owned(), named }.into());
    }
    session.step(&action).await?;
    Ok(step_response::http_response(&session)?)
}

/// Returns the action of a step: the field `action` or, as in the README of the public kessler-env, all fields that do not
/// concern the request.
pub(super) fn action_from_body(mut body: Map<String, Value>) -> Result<Value, ErrorResponse> {
    let mut fields = FieldReader::new(&body, body::body_location());
    // These fields are only validated, not used: a step takes microseconds.
    fields.positive_number("timeout_s");
    fields.text("request_id");
    let has_action_fields =
        body.keys().any(|key| !["timeout_s", "request_id", "action"].contains(&key.as_str()));
    match fields.get("action") {
        Some(action) if !action.is_object() => {
            fields.add_error("action", "dict_type", "Input should be a valid dictionary", action);
        }
        None if !has_action_fields => {
            let input = Value::Object(body.clone());
            fields.add_error("action", "missing", "Field required", &input);
        }
        _ => {}
    }
    if !fields.errors.is_empty() {
        return Err(ErrorResponse::validation(&fields.errors));
    }
    if let Some(action) = body.remove("action").filter(|action| !action.is_null()) {
        return Ok(action);
    }
    body.retain(|key, _| !["timeout_s", "request_id", "action"].contains(&key.as_str()));
    Ok(Value::Object(body))
}

/// Get the state of the session.
#[utoipa::path(get, path = "/state", tag = "openenv", responses((status = 200, body = Object), (status = 503, body = Object)))]
pub(super) async fn get_environment_state(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<axum::Json<Value>, ErrorResponse> {
    session_state(&app, &session_key(&headers, &caller)?).await
}

/// Returns the state of a session, or an empty state without one.
pub(super) async fn session_state(
    app: &AppState,
    name: &SessionKey,
) -> Result<axum::Json<Value>, ErrorResponse> {
    let Some(session) = app.sessions.get(name) else {
        // Reading the state does not open a session.
        let (episode_id, steps) = (&*uuid::Uuid::new_v4().to_string(), 0);
        let empty = SessionStatus { episode_id, steps, scenario: None, run: None, outcome: None };
        return Ok(axum::Json(step_response::state_value(&empty)));
    };
    let session = session.lock().await;
    Ok(axum::Json(step_response::state_value(&session.status())))
}
