//! `/mcp`: JSON-RPC by request, and over a WebSocket with a session of its own.

use axum::Extension;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::extract::{Request, State};
use axum::response::Response;
use serde_json::Value;

use super::super::super::socket::{self, Received, bounded};
use super::super::body::whole;
use super::super::refusal::Refusal;
use super::By;
use super::rpc::{self, Failure};
use crate::http::access::Caller;
use crate::http::state::AppState;
use crate::sessions::ClientIdentity;

/// JSON-RPC of the Model Context Protocol: `tools/list`, `tools/call`, `openenv/session/create` and `close`.
#[utoipa::path(
    post, path = "/mcp", tag = "openenv", request_body(content = Option<Object>, content_type = "application/json", description = "Left out, it is what cannot be read: JSON-RPC's -32700."),
    responses(
        (status = 200, body = Object, description = "JSON-RPC: an error is in the body."),
        (status = 408, body = Object), (status = 413, body = Object)
    )
)]
pub(in super::super) async fn post(
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    request: Request,
) -> Result<axum::Json<Value>, Refusal> {
    let body = whole(request).await?;
    Ok(axum::Json(match openenv_wire::parse_python_json(&String::from_utf8_lossy(&body)) {
        Ok(request) => super::answer(&app, &request, By::Itself(&caller.who)).await,
        Err(_) => rpc::failed(&Value::Null, &Failure::unread(None)),
    }))
}

/// The same over a WebSocket.
pub(in super::super) async fn connect(
    State(app): State<AppState>,
    who: ClientIdentity,
    upgrade: WebSocketUpgrade,
) -> Response {
    bounded(upgrade).on_upgrade(move |socket| serve(socket, app, who))
}

async fn serve(mut socket: WebSocket, app: AppState, who: ClientIdentity) {
    let mut session = match app.sessions.open(&who) {
        Ok(session) => session,
        Err(full) => {
            let told = rpc::failed(&Value::Null, &Failure::capacity(full));
            let _ = socket::send(&mut socket, told.to_string().into_bytes()).await;
            return socket::close(socket).await;
        }
    };
    let mut closing = app.sessions.close_signal(&who);
    let mut early = None;
    loop {
        let received = match closing.reason().map(Received::Stop).or_else(|| early.take()) {
            Some(received) => received,
            None => tokio::select! {
                received = socket::next(&mut socket, app.sessions.limits().idle_timeout) => received,
                why = closing.closed() => Received::Stop(why),
            },
        };
        let told = match received {
            Received::Text(text) => match openenv_wire::parse_python_json(&text) {
                Ok(request) => {
                    let work = super::answer(&app, &request, By::Own(&mut session));
                    match socket::meanwhile(&mut socket, &mut early, work).await {
                        Some(told) => told,
                        None => return,
                    }
                }
                Err(error) => rpc::failed(&Value::Null, &Failure::unread(Some(&error.to_string()))),
            },
            Received::Binary(_) => {
                rpc::failed(&Value::Null, &Failure::unread(Some("binary frames are not read here")))
            }
            Received::Idle | Received::Stop(_) => return socket::close(socket).await,
            Received::TooLarge => return socket::close_for_size(socket).await,
            Received::Left | Received::Gone => return,
        };
        if socket::send(&mut socket, told.to_string().into_bytes()).await.is_err() {
            return;
        }
    }
}
