//! `/mcp`: JSON-RPC by single requests, and over a WebSocket with a session for each connection.

use axum::Extension;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use super::super::super::socket::{self, Received};
use super::super::body::read_body;
use super::super::error_response::ErrorResponse;
use super::rpc::{self, RpcError};
use super::{RpcOrigin, streamable};
use crate::http::access::Caller;
use crate::http::state::AppState;
use crate::sessions::{ClientIdentity, CloseOutcome, SessionKey};

/// Send a JSON-RPC request of the Model Context Protocol (Streamable HTTP).
///
/// `initialize` returns the header `Mcp-Session-Id`; later requests send it, and `DELETE` ends the session. OpenEnv's clients
/// use `openenv/session/create` and `session_id` in the params instead.
#[utoipa::path(
    post, path = "/mcp", tag = "openenv", request_body(content = Option<Object>, content_type = "application/json", description = "An empty body is a parse error (-32700)."),
    responses(
        (status = 200, description = "JSON-RPC: an error is in the body. An event stream with one event if the request accepts it.",
         content((Object = "application/json"), (String = "text/event-stream"))),
        (status = 202, description = "A notification or a response was accepted."),
        (status = 400, body = Object, description = "The version of the protocol is unknown."),
        (status = 404, body = Object, description = "The session does not exist: send `initialize` again."),
        (status = 408, body = Object), (status = 413, body = Object), (status = 415, body = Object)
    )
)]
pub(crate) async fn call_mcp(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    request: Request,
) -> Result<Response, ErrorResponse> {
    let body = read_body(request).await?;
    Ok(match openenv_wire::parse_python_json(&String::from_utf8_lossy(&body)) {
        Ok(message) => streamable::answer(app, caller.identity, &headers, message).await,
        Err(_) => axum::Json(rpc::error_response(&Value::Null, &RpcError::parse_error(None))).into_response(),
    })
}

/// End the session of a client of the Model Context Protocol, named by the header `Mcp-Session-Id`.
#[utoipa::path(
    delete, path = "/mcp", tag = "openenv",
    params(("Mcp-Session-Id" = String, Header, description = "Id of the session.")),
    responses(
        (status = 204), (status = 400, body = Object, description = "The header is missing."),
        (status = 404, body = Object, description = "The session does not exist.")
    )
)]
pub(crate) async fn end_mcp_session(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<StatusCode, ErrorResponse> {
    let missing = || ErrorResponse::new(StatusCode::BAD_REQUEST, "Mcp-Session-Id: the header is required");
    let name = streamable::protocol_session(&headers).ok_or_else(missing)?;
    match app.sessions.close(&SessionKey::new(&caller.identity, name)) {
        CloseOutcome::Closed | CloseOutcome::Closing => Ok(StatusCode::NO_CONTENT),
        CloseOutcome::Unknown => {
            Err(ErrorResponse::new(StatusCode::NOT_FOUND, format!("Unknown session_id: {name}")))
        }
    }
}

/// Serves the protocol over a WebSocket.
pub(crate) async fn connect(
    State(app): State<AppState>,
    client: ClientIdentity,
    upgrade: WebSocketUpgrade,
) -> Response {
    socket::limit_frames(upgrade).on_upgrade(move |socket| serve(socket, app, client))
}

async fn serve(mut socket: WebSocket, app: AppState, client: ClientIdentity) {
    let mut session = match app.sessions.open(&client) {
        Ok(session) => session,
        Err(full) => {
            let response = rpc::error_response(&Value::Null, &RpcError::capacity(full));
            let _ = socket::send_text(&mut socket, response.to_string().into_bytes()).await;
            return socket::close(socket).await;
        }
    };
    let mut closing = app.sessions.close_signal(&client);
    let mut early = None;
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = socket::receive(&mut socket, app.sessions.limits().idle_timeout) => received,
                reason = closing.closed() => Received::Stop(reason),
            },
        };
        let response = match received {
            Received::Text(text) => match openenv_wire::parse_python_json(&text) {
                Ok(request) => {
                    let work = super::respond(&app, &request, RpcOrigin::Connection(&mut session));
                    match socket::run_while_connected(&mut socket, &mut early, work).await {
                        Some(response) => response,
                        None => return,
                    }
                }
                Err(error) => {
                    rpc::error_response(&Value::Null, &RpcError::parse_error(Some(&error.to_string())))
                }
            },
            Received::Binary(_) => rpc::error_response(
                &Value::Null,
                &RpcError::parse_error(Some("binary frames are not supported; send text")),
            ),
            // The place is free before the client learns of the end.
            Received::Idle | Received::Stop(_) => {
                drop(session);
                return socket::close(socket).await;
            }
            Received::TooLarge => {
                drop(session);
                return socket::close_for_size(socket).await;
            }
            Received::Left | Received::Gone => return,
        };
        if socket::send_text(&mut socket, response.to_string().into_bytes()).await.is_err() {
            return;
        }
    }
}
